"""What rays see that meet nothing: device functions."""

from __future__ import annotations

import math

from plenoptic.core.jit import device
from plenoptic.core.kernels.vectors import dot, sub
from plenoptic.scene.lights.kernels.environment import environment_texel


@device
def weight(pdf, other):
    """How much a direction counts that was drawn by `pdf` and could have been by `other` (power heuristic)."""
    if pdf < 0.0 or other <= 0.0:
        return 1.0
    if not pdf > 0.0:
        return 0.0
    ratio = other / pdf
    return 1.0 / (1.0 + ratio * ratio)


@device
def add_suns(color, direction, pdf, suns, sun_colors):
    """Add the discs of suns that lie in a direction, which was drawn with a density."""
    for s in range(suns.shape[0]):
        sun = suns[s]
        if sun.cap > 0.0:
            off = sub(direction, (sun.x, sun.y, sun.z))
            # |d - s|^2 = 2 (1 - cos), without the cancellation of 1 - cos.
            if 0.5 * dot(off, off) < sun.cap:
                counts = weight(pdf, sun.pdf / (2.0 * math.pi * sun.cap))
                for c in range(color.size):
                    color[c] += counts * sun_colors[s, c]


@device
def add_environment(color, direction, pdf, texels, texel_pdf, rotation, probability):
    """Add the texel that lies in a direction, which was drawn with a density."""
    row, column = environment_texel(direction, texels.shape[0], texels.shape[1], rotation)
    counts = weight(pdf, probability * texel_pdf[row, column])
    for c in range(color.size):
        color[c] += counts * texels[row, column, c]
