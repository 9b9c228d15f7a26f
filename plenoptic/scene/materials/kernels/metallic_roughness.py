"""A rough reflecting layer on a matt base: device functions. See `bsdf` for directions and f.

`coupling` is that of `materials.material_records.Bsdf`.
"""

from __future__ import annotations

import math

from plenoptic.core.numba.jit import device
from plenoptic.scene.materials.kernels.diffuse import OVER_PI, sample_cosine
from plenoptic.scene.materials.kernels.fresnel import schlick
from plenoptic.scene.materials.kernels.microfacets import half_way, nothing, sample_reflection, smith_lambda
from plenoptic.scene.materials.material_records import COUPLING_COSINES

PLASTIC = 0.04
"""Reflectance of the layer at normal incidence (glTF 2.0, appendix B)."""


@device
def layer_albedo(coupling, cosine, roughness):
    """Fraction that the layer does not reflect, seen at a cosine; bilinear in a table.

    Columns are at equal steps of the root of the cosine, rows at equal steps of the root of the roughness.
    """
    x = math.sqrt(min(max(cosine, 0.0), 1.0)) * (COUPLING_COSINES - 1)
    y = math.sqrt(min(max(roughness, 0.0), 1.0)) * (coupling.shape[0] - 1)
    i, j = min(int(x), COUPLING_COSINES - 2), min(int(y), coupling.shape[0] - 2)
    fx, fy = x - i, y - j
    low = coupling[j, i] + fx * (coupling[j, i + 1] - coupling[j, i])
    high = coupling[j + 1, i] + fx * (coupling[j + 1, i + 1] - coupling[j + 1, i])
    return low + fy * (high - low)


@device
def _mean_albedo(coupling, roughness, column):
    """A mean over the cosine of `layer_albedo`: alone, or times that of one of the roughnesses of a coat."""
    y = math.sqrt(min(max(roughness, 0.0), 1.0)) * (coupling.shape[0] - 1)
    j = min(int(y), coupling.shape[0] - 2)
    return coupling[j, column] + (y - j) * (coupling[j + 1, column] - coupling[j, column])


@device
def _coat_passes(coupling, cosine, coat):
    """Fraction of light that a clear coat, a layer on part of the surface, does not reflect."""
    return 1.0 - coat[0] * (1.0 - layer_albedo(coupling, cosine, coat[1]))


@device
def _coated_mean_albedo(coupling, roughness, coat):
    """Mean over the cosine of the transmission of both the coat and the layer."""
    z = math.sqrt(min(max(coat[1], 0.0), 1.0)) * (coupling.shape[0] - 1)
    k = min(int(z), coupling.shape[0] - 2)
    low = _mean_albedo(coupling, roughness, COUPLING_COSINES + 1 + k)
    high = _mean_albedo(coupling, roughness, COUPLING_COSINES + 2 + k)
    both = low + (z - k) * (high - low)
    return (1.0 - coat[0]) * _mean_albedo(coupling, roughness, COUPLING_COSINES) + coat[0] * both


@device
def _coat_fraction(f, metallic, cosine, inward, passed):
    """Probability of sampling the coat, not the layer below, by the coat's transmission for a direction."""
    largest = 0.0
    for c in range(f.size):
        largest = max(largest, f[c])
    above = 1.0 - passed
    below = passed * (schlick(PLASTIC + metallic * (largest - PLASTIC), cosine) + (1.0 - metallic) * largest * inward)
    return min(max(above / (above + below), 0.1), 0.9)


@device
def _layer_fraction(base_color, metallic, cosine, inward):
    """Probability of sampling the layer, not the base below."""
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
    mean = _mean_albedo(coupling, roughness, COUPLING_COSINES)
    below = (1.0 - metallic) * inward * layer_albedo(coupling, i[2], roughness)
    above = d / (4.0 * o[2] * (1.0 + hidden_o + hidden_i))
    pdf = fraction * d / (4.0 * o[2] * (1.0 + hidden_o)) + (1.0 - fraction) * i[2] * OVER_PI
    coated = 0.0
    if surface.extra is not None:
        if surface.extra[0] > 0.0:
            # The base is weighted by the transmission in both directions, its layer by the smaller one.
            coat = surface.extra
            to_o, to_i = _coat_passes(coupling, o[2], coat), _coat_passes(coupling, i[2], coat)
            drawn = _coat_fraction(f, metallic, o[2], inward, to_o)
            coated, coat_pdf = _eval_coat(o, i, coat)
            mean = _coated_mean_albedo(coupling, roughness, coat)
            below *= to_o * to_i
            above *= min(to_o, to_i)
            pdf = drawn * coat_pdf + (1.0 - drawn) * pdf
    below /= mean
    for c in range(f.size):
        normal = PLASTIC + metallic * (f[c] - PLASTIC)
        f[c] = schlick(normal, cosine) * above + f[c] * below * (i[2] * OVER_PI)
        if surface.extra is not None:
            f[c] += coated
    return pdf


@device
def _eval_coat(o, i, coat):
    """F |cos i| of the coat alone, and the density by which its facets reflect."""
    alpha = max(coat[1] * coat[1], 1e-3)
    cosine, d = half_way(o, i, alpha)
    hidden_o, hidden_i = smith_lambda(o, alpha), smith_lambda(i, alpha)
    value = coat[0] * schlick(PLASTIC, cosine) * d / (4.0 * o[2] * (1.0 + hidden_o + hidden_i))
    return value, d / (4.0 * o[2] * (1.0 + hidden_o))


@device
def sample_metallic_roughness(f, surface, o, u, coupling):
    """See `bsdf.sample`."""
    roughness, metallic, chance = surface.roughness, surface.metallic, u[0]
    inward = layer_albedo(coupling, o[2], roughness)
    fraction = _layer_fraction(f, metallic, o[2], inward)
    if surface.extra is not None:
        if surface.extra[0] > 0.0:
            coated = _coat_fraction(f, metallic, o[2], inward, _coat_passes(coupling, o[2], surface.extra))
            if chance < coated:
                roughness, fraction, chance = surface.extra[1], 1.0, chance / coated
            else:
                chance = (chance - coated) / (1.0 - coated)
    if chance < fraction:
        i, _, _ = sample_reflection(o, max(roughness * roughness, 1e-3), chance / fraction, u[1])
    else:
        i = sample_cosine((chance - fraction) / (1.0 - fraction), u[1])
    if not i[2] > 0.0:
        return (0.0, 0.0, 1.0), 0.0, 1.0
    pdf = eval_metallic_roughness(f, surface, o, i, coupling)
    for c in range(f.size):
        f[c] = f[c] / pdf if pdf > 0.0 else 0.0
    return i, pdf, 1.0
