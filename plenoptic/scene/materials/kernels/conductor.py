"""Metals, polished and rough: device functions. See `bsdf` for directions and f."""

from __future__ import annotations

from plenoptic.core.numba.jit import device
from plenoptic.scene.lights.light_records import DELTA
from plenoptic.scene.materials.kernels.fresnel import conductor
from plenoptic.scene.materials.kernels.microfacets import half_way, nothing, sample_reflection, smith_lambda
from plenoptic.scene.materials.material_records import EXTINCTION, INDEX, SMOOTH


@device
def _reflectance(f, cosine, metal_index, material, basis, wave):
    """Multiply f by the reflectance of small mirrors, where it depends on the cosine."""
    if not metal_index[material, 0, INDEX] > 0.0:
        return
    channels = metal_index.shape[1]
    if basis is None or channels == 1:
        for c in range(f.size):
            k = min(c, channels - 1)
            f[c] *= conductor(cosine, metal_index[material, k, INDEX], metal_index[material, k, EXTINCTION])
    else:
        lifted = 0.0
        for k in range(3):
            lifted += basis[wave, k] * conductor(
                cosine, metal_index[material, k, INDEX], metal_index[material, k, EXTINCTION]
            )
        f[0] *= lifted


@device
def eval_conductor(f, surface, o, i, metal_index, basis):
    """See `bsdf.evaluate`."""
    alpha = surface.roughness
    if i[2] <= 0.0 or alpha < SMOOTH:
        return nothing(f)
    cosine, d = half_way(o, i, alpha)
    if not d > 0.0:
        return nothing(f)
    _reflectance(f, cosine, metal_index, surface.material, basis, surface.wave)
    hidden_o, hidden_i = smith_lambda(o, alpha), smith_lambda(i, alpha)
    reflected = d / (4.0 * o[2] * (1.0 + hidden_o + hidden_i))
    for c in range(f.size):
        f[c] *= reflected
    return d / (4.0 * o[2] * (1.0 + hidden_o))


@device
def sample_conductor(f, surface, o, u, metal_index, basis):
    """See `bsdf.sample`."""
    alpha = surface.roughness
    if alpha < SMOOTH:
        _reflectance(f, o[2], metal_index, surface.material, basis, surface.wave)
        return (-o[0], -o[1], o[2]), DELTA, 1.0
    i, cosine, pdf = sample_reflection(o, alpha, u[0], u[1])
    if not i[2] > 0.0:
        return (0.0, 0.0, 1.0), 0.0, 1.0
    hidden_o, hidden_i = smith_lambda(o, alpha), smith_lambda(i, alpha)
    _reflectance(f, cosine, metal_index, surface.material, basis, surface.wave)
    unshadowed = (1.0 + hidden_o) / (1.0 + hidden_o + hidden_i)
    for c in range(f.size):
        f[c] *= unshadowed
    return i, pdf, 1.0
