"""A rough reflecting layer on a matt base: device functions. See `bsdf` for directions and f.

`coupling` is that of `materials.record.Bsdf`.
"""

from __future__ import annotations

import math

from plenoptic.core.jit import device
from plenoptic.scene.materials.kernels.diffuse import OVER_PI, sample_cosine
from plenoptic.scene.materials.kernels.fresnel import schlick
from plenoptic.scene.materials.kernels.microfacets import half_way, nothing, sample_reflected, smith_lambda

PLASTIC = 0.04
"""Reflectance of the layer at normal incidence (glTF 2.0, appendix B)."""


@device
def layer_albedo(coupling, cosine, roughness):
    """Fraction that the layer does not reflect, seen at a cosine; bilinear in a table.

    Columns are at equal steps of the root of the cosine, rows at equal steps of the root of the roughness; the last
    column is their mean over the cosine.
    """
    cosines = coupling.shape[1] - 1
    x = math.sqrt(min(max(cosine, 0.0), 1.0)) * (cosines - 1)
    y = math.sqrt(min(max(roughness, 0.0), 1.0)) * (coupling.shape[0] - 1)
    i, j = min(int(x), cosines - 2), min(int(y), coupling.shape[0] - 2)
    fx, fy = x - i, y - j
    low = coupling[j, i] + fx * (coupling[j, i + 1] - coupling[j, i])
    high = coupling[j + 1, i] + fx * (coupling[j + 1, i + 1] - coupling[j + 1, i])
    return low + fy * (high - low)


@device
def _mean_albedo(coupling, roughness):
    """The mean over the cosine of `layer_albedo`."""
    last = coupling.shape[1] - 1
    y = math.sqrt(min(max(roughness, 0.0), 1.0)) * (coupling.shape[0] - 1)
    j = min(int(y), coupling.shape[0] - 2)
    return coupling[j, last] + (y - j) * (coupling[j + 1, last] - coupling[j, last])


@device
def _layer_fraction(base_color, metallic, cosine, inward):
    """Probability of drawing the layer, not what is below."""
    largest = 0.0
    for c in range(base_color.size):
        largest = max(largest, base_color[c])
    below = (1.0 - metallic) * largest * inward
    if not below > 0.0:
        return 1.0
    above = schlick(PLASTIC + metallic * (largest - PLASTIC), cosine)
    return min(max(above / (above + below), 0.1), 0.9)


@device
def eval_metallic_roughness(f, surface, o, i, coupling):
    """See `bsdf.evaluate`."""
    if i[2] <= 0.0:
        return nothing(f)
    roughness, metallic = surface.roughness, surface.metallic
    alpha = max(roughness * roughness, 1e-3)
    cosine, d = half_way(o, i, alpha)
    hidden_o, hidden_i = smith_lambda(o, alpha), smith_lambda(i, alpha)
    inward = layer_albedo(coupling, o[2], roughness)
    fraction = _layer_fraction(f, metallic, o[2], inward)
    below = (1.0 - metallic) * inward * layer_albedo(coupling, i[2], roughness) / _mean_albedo(coupling, roughness)
    above = d / (4.0 * o[2] * (1.0 + hidden_o + hidden_i))
    for c in range(f.size):
        normal = PLASTIC + metallic * (f[c] - PLASTIC)
        f[c] = schlick(normal, cosine) * above + f[c] * below * (i[2] * OVER_PI)
    return fraction * d / (4.0 * o[2] * (1.0 + hidden_o)) + (1.0 - fraction) * i[2] * OVER_PI


@device
def sample_metallic_roughness(f, surface, o, u, coupling):
    """See `bsdf.sample`."""
    roughness = surface.roughness
    fraction = _layer_fraction(f, surface.metallic, o[2], layer_albedo(coupling, o[2], roughness))
    if u[0] < fraction:
        i, _, _ = sample_reflected(o, max(roughness * roughness, 1e-3), u[0] / fraction, u[1])
    else:
        i = sample_cosine((u[0] - fraction) / (1.0 - fraction), u[1])
    if not i[2] > 0.0:
        return (0.0, 0.0, 1.0), 0.0, 1.0
    pdf = eval_metallic_roughness(f, surface, o, i, coupling)
    for c in range(f.size):
        f[c] = f[c] / pdf if pdf > 0.0 else 0.0
    return i, pdf, 1.0
