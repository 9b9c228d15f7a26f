"""Panes without thickness: a device function. See `bsdf` for directions and f."""

from __future__ import annotations

from plenoptic.core.jit import device
from plenoptic.scene.lights.record import DELTA
from plenoptic.scene.materials.kernels.fresnel import dielectric


@device
def sample_thin_dielectric(f, index, o, u):
    """See `bsdf.sample`: with all reflections inside, a pane reflects 2 R / (1 + R)."""
    once, _ = dielectric(min(o[2], 1.0), index)
    if u < 2.0 * once / (1.0 + once):
        for c in range(f.size):
            f[c] = 1.0
        return (-o[0], -o[1], o[2]), DELTA, 1.0
    return (-o[0], -o[1], -o[2]), DELTA, 1.0
