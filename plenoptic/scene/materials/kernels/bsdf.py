"""What surfaces do with light, in a frame whose z is the shading normal: device functions.

o is the unit direction to the viewer, z above 0; i that to the light, z below 0 behind the surface. `f` (channels,) is
filled with f |cos i|; densities are per steradian. Columns are those of `bsdf_tables`; one that no material of a scene
has is None.
"""

from __future__ import annotations

import math

from plenoptic.core.jit import device
from plenoptic.core.kernels.sincos import turn
from plenoptic.scene.materials.kernels.fresnel import conductor, dielectric, schlick
from plenoptic.scene.materials.kernels.microfacets import distribution, hidden, visible_normal
from plenoptic.scene.materials.kernels.oren_nayar import groove_albedo, groove_terms
from plenoptic.scene.materials.record import (
    CONDUCTOR,
    DIELECTRIC,
    LAMBERTIAN,
    METALLIC_ROUGHNESS,
    OREN_NAYAR,
    SMOOTH,
    THIN_DIELECTRIC,
)

EXACT = -1.0
"""The density of a direction that is the only one: a mirror's."""
_OVER_PI = 1.0 / math.pi
PLASTIC = 0.04
"""Reflectance of the layer of METALLIC_ROUGHNESS materials at normal incidence (glTF 2.0, appendix B)."""


@device
def row_channel(colours, k, c, basis, wave):
    """Channel c of row k of colours of the scene, as `one_channel` sees it."""
    if basis is None or colours.shape[1] == 1:
        return colours[k, c]
    return colours[k, 0] * basis[wave, 0] + colours[k, 1] * basis[wave, 1] + colours[k, 2] * basis[wave, 2]


@device
def one_channel(colour, c, basis, wave):
    """Channel c of a colour of the scene or, with a basis (wavelengths, 3), what the colour is at a wavelength."""
    if basis is None or colour.size == 1:
        return colour[c]
    return colour[0] * basis[wave, 0] + colour[1] * basis[wave, 1] + colour[2] * basis[wave, 2]


@device
def _metal_reflectance(f, base, i, cosine, metal_index, material, basis, wave):
    """Fill f with the reflectance of small mirrors."""
    for c in range(f.size):
        f[c] = base[i, c]
    if metal_index is None:
        return
    if metal_index[material, 0, 0] > 0.0:
        channels = metal_index.shape[1]
        if basis is None or channels == 1:
            for c in range(f.size):
                k = min(c, channels - 1)
                f[c] *= conductor(cosine, metal_index[material, k, 0], metal_index[material, k, 1])
        else:
            lifted = 0.0
            for k in range(3):
                lifted += basis[wave, k] * conductor(cosine, metal_index[material, k, 0], metal_index[material, k, 1])
            f[0] *= lifted


@device
def _relative_index(glass_index, material, front):
    """Index behind the surface over that on the viewer's side."""
    inside, outside = glass_index[material, 0], glass_index[material, 1]
    return inside / outside if front else outside / inside


@device
def layer_albedo(coupling, cosine, roughness):
    """Share that the layer of a METALLIC_ROUGHNESS material does not reflect, seen at a cosine; bilinear in a table.

    Columns are at equal steps of the root of the cosine, rows at equal steps of the root of the roughness.
    """
    x = math.sqrt(min(max(cosine, 0.0), 1.0)) * (coupling.shape[1] - 1)
    y = math.sqrt(min(max(roughness, 0.0), 1.0)) * (coupling.shape[0] - 1)
    i, j = min(int(x), coupling.shape[1] - 2), min(int(y), coupling.shape[0] - 2)
    fx, fy = x - i, y - j
    low = coupling[j, i] + fx * (coupling[j, i + 1] - coupling[j, i])
    high = coupling[j + 1, i] + fx * (coupling[j + 1, i + 1] - coupling[j + 1, i])
    return low + fy * (high - low)


@device
def _mean_row(coupling_mean, roughness):
    y = math.sqrt(min(max(roughness, 0.0), 1.0)) * (coupling_mean.size - 1)
    j = min(int(y), coupling_mean.size - 2)
    return coupling_mean[j] + (y - j) * (coupling_mean[j + 1] - coupling_mean[j])


@device
def _layer_share(base, i, metallic, oz, inward):
    """Probability of drawing the layer of a METALLIC_ROUGHNESS material, not what is below."""
    largest = 0.0
    for c in range(base.shape[1]):
        largest = max(largest, base[i, c])
    below = (1.0 - metallic) * largest * inward
    if not below > 0.0:
        return 1.0
    above = schlick(PLASTIC + metallic * (largest - PLASTIC), oz)
    return min(max(above / (above + below), 0.1), 0.9)


@device
def evaluate(
    f,
    kind,
    base,
    i,
    roughness,
    metallic,
    front,
    material,
    ox,
    oy,
    oz,
    ix,
    iy,
    iz,
    basis,
    wave,
    metal_index,
    glass_index,
    coupling,
    coupling_mean,
):
    """Fill f with f |cos i| and return the density by which `draw` would draw i; 0 for exact directions."""
    for c in range(f.size):
        f[c] = 0.0
    if kind <= OREN_NAYAR:
        if iz <= 0.0:
            return 0.0
        if kind == LAMBERTIAN:
            for c in range(f.size):
                f[c] = base[i, c] * (iz * _OVER_PI)
        else:
            single, multiple, mean = groove_terms(ox, oy, oz, ix, iy, iz, roughness)
            for c in range(f.size):
                f[c] = (base[i, c] * single + groove_albedo(base[i, c], mean) * multiple) * (iz * _OVER_PI)
        return iz * _OVER_PI
    if metal_index is not None and kind == CONDUCTOR:
        if iz <= 0.0 or roughness < SMOOTH:
            return 0.0
        cosine, d = _half_way(ox, oy, oz, ix, iy, iz, roughness)
        if not d > 0.0:
            return 0.0
        _metal_reflectance(f, base, i, cosine, metal_index, material, basis, wave)
        hidden_o, hidden_i = hidden(ox, oy, oz, roughness), hidden(ix, iy, iz, roughness)
        seen = d / (4.0 * oz * (1.0 + hidden_o + hidden_i))
        for c in range(f.size):
            f[c] *= seen
        return d / (4.0 * oz * (1.0 + hidden_o))
    if glass_index is not None and kind == DIELECTRIC:
        if roughness < SMOOTH:
            return 0.0
        return _evaluate_rough_glass(
            f, base, i, roughness, _relative_index(glass_index, material, front), ox, oy, oz, ix, iy, iz
        )
    if coupling is not None and kind == METALLIC_ROUGHNESS:
        if iz <= 0.0:
            return 0.0
        alpha = max(roughness * roughness, 1e-3)
        cosine, d = _half_way(ox, oy, oz, ix, iy, iz, alpha)
        hidden_o, hidden_i = hidden(ox, oy, oz, alpha), hidden(ix, iy, iz, alpha)
        inward = layer_albedo(coupling, oz, roughness)
        below = (1.0 - metallic) * inward * layer_albedo(coupling, iz, roughness) / _mean_row(coupling_mean, roughness)
        above = d / (4.0 * oz * (1.0 + hidden_o + hidden_i))
        for c in range(f.size):
            normal = PLASTIC + metallic * (base[i, c] - PLASTIC)
            f[c] = schlick(normal, cosine) * above + base[i, c] * below * (iz * _OVER_PI)
        share = _layer_share(base, i, metallic, oz, inward)
        return share * d / (4.0 * oz * (1.0 + hidden_o)) + (1.0 - share) * iz * _OVER_PI
    return 0.0


@device
def _half_way(ox, oy, oz, ix, iy, iz, alpha):
    """Cosine between a direction and the normal half-way between both, and D of that normal; 0 where there is none."""
    hx, hy, hz = ox + ix, oy + iy, oz + iz
    length = math.sqrt(hx * hx + hy * hy + hz * hz)
    if not length > 0.0 or not hz > 0.0:
        return 0.0, 0.0
    over = 1.0 / length
    hx, hy, hz = hx * over, hy * over, hz * over
    return min(ox * hx + oy * hy + oz * hz, 1.0), distribution(hx, hy, hz, alpha)


@device
def _evaluate_rough_glass(f, base, i, alpha, eta, ox, oy, oz, ix, iy, iz):
    """Reflected or refracted by small facets; the change of radiance between media is left to the caller."""
    if iz == 0.0:
        return 0.0
    reflected = iz > 0.0
    scale = 1.0 if reflected else eta
    hx, hy, hz = ox + scale * ix, oy + scale * iy, oz + scale * iz
    length = math.sqrt(hx * hx + hy * hy + hz * hz)
    if not length > 0.0:
        return 0.0
    if hz < 0.0:
        length = -length
    hx, hy, hz = hx / length, hy / length, hz / length
    at_o, at_i = ox * hx + oy * hy + oz * hz, ix * hx + iy * hy + iz * hz
    # Facets seen from behind do not count.
    if not hz > 0.0 or at_o <= 0.0 or at_i * iz <= 0.0:
        return 0.0
    share, _ = dielectric(min(at_o, 1.0), eta)
    d = distribution(hx, hy, hz, alpha)
    hidden_o, hidden_i = hidden(ox, oy, oz, alpha), hidden(ix, iy, iz, alpha)
    if reflected:
        density = share * d / (4.0 * oz * (1.0 + hidden_o))
        value = share * d / (4.0 * oz * (1.0 + hidden_o + hidden_i))
    else:
        spread = at_i + at_o / eta
        jacobian = abs(at_i) / (spread * spread)
        density = (1.0 - share) * d * at_o / (oz * (1.0 + hidden_o)) * jacobian
        value = density / (1.0 + hidden_i)
    for c in range(f.size):
        f[c] = base[i, c] * value
    return density


@device
def draw(
    f,
    kind,
    base,
    i,
    roughness,
    metallic,
    front,
    material,
    ox,
    oy,
    oz,
    u,
    v,
    w,
    basis,
    wave,
    metal_index,
    glass_index,
    pane_index,
    coupling,
    coupling_mean,
):
    """Draw a direction i by three numbers; fills f with f |cos i| / density.

    Returns i, its density (EXACT for a mirror's direction, 0 where the path ends), and 1 / eta^2 where light changes
    into another medium (1 otherwise), by which radiance is to be multiplied besides.
    """
    if glass_index is not None and kind == DIELECTRIC:
        return _draw_glass(f, base, i, roughness, _relative_index(glass_index, material, front), ox, oy, oz, u, v, w)
    if pane_index is not None and kind == THIN_DIELECTRIC:
        once, _ = dielectric(min(oz, 1.0), pane_index[material])
        if u < 2.0 * once / (1.0 + once):
            for c in range(f.size):
                f[c] = 1.0
            return -ox, -oy, oz, EXACT, 1.0
        for c in range(f.size):
            f[c] = base[i, c]
        return -ox, -oy, -oz, EXACT, 1.0
    if metal_index is not None and kind == CONDUCTOR:
        if roughness < SMOOTH:
            _metal_reflectance(f, base, i, oz, metal_index, material, basis, wave)
            return -ox, -oy, oz, EXACT, 1.0
        ix, iy, iz, cosine, density = _draw_reflected(ox, oy, oz, roughness, u, v)
        if not iz > 0.0:
            return 0.0, 0.0, 1.0, 0.0, 1.0
        hidden_o, hidden_i = hidden(ox, oy, oz, roughness), hidden(ix, iy, iz, roughness)
        _metal_reflectance(f, base, i, cosine, metal_index, material, basis, wave)
        seen = (1.0 + hidden_o) / (1.0 + hidden_o + hidden_i)
        for c in range(f.size):
            f[c] *= seen
        return ix, iy, iz, density, 1.0
    if coupling is not None and kind == METALLIC_ROUGHNESS:
        share = _layer_share(base, i, metallic, oz, layer_albedo(coupling, oz, roughness))
        if u < share:
            ix, iy, iz, _, _ = _draw_reflected(ox, oy, oz, max(roughness * roughness, 1e-3), u / share, v)
        else:
            ix, iy, iz = _draw_cosine((u - share) / (1.0 - share), v)
        if not iz > 0.0:
            return 0.0, 0.0, 1.0, 0.0, 1.0
        density = evaluate(
            f,
            kind,
            base,
            i,
            roughness,
            metallic,
            front,
            material,
            ox,
            oy,
            oz,
            ix,
            iy,
            iz,
            basis,
            wave,
            metal_index,
            glass_index,
            coupling,
            coupling_mean,
        )
        for c in range(f.size):
            f[c] = f[c] / density if density > 0.0 else 0.0
        return ix, iy, iz, density, 1.0
    ix, iy, iz = _draw_cosine(u, v)
    if kind == OREN_NAYAR:
        single, multiple, mean = groove_terms(ox, oy, oz, ix, iy, iz, roughness)
        for c in range(f.size):
            f[c] = base[i, c] * single + groove_albedo(base[i, c], mean) * multiple
    else:
        for c in range(f.size):
            f[c] = base[i, c]
    return ix, iy, iz, iz * _OVER_PI, 1.0


@device
def _draw_cosine(u, v):
    """A direction drawn by the cosine."""
    radius = math.sqrt(u)
    c, s = turn(v)
    return radius * c, radius * s, math.sqrt(max(0.0, 1.0 - u))


@device
def _draw_reflected(ox, oy, oz, alpha, u, v):
    """The direction reflected by a facet that is seen, the cosine at the facet, and the density of the direction."""
    hx, hy, hz = visible_normal(ox, oy, oz, alpha, u, v)
    cosine = min(max(ox * hx + oy * hy + oz * hz, 0.0), 1.0)
    density = distribution(hx, hy, hz, alpha) / (4.0 * oz * (1.0 + hidden(ox, oy, oz, alpha)))
    return 2.0 * cosine * hx - ox, 2.0 * cosine * hy - oy, 2.0 * cosine * hz - oz, cosine, density


@device
def _draw_glass(f, base, i, alpha, eta, ox, oy, oz, u, v, w):
    """Reflect or refract at the surface, or at a facet of it that is seen."""
    for c in range(f.size):
        f[c] = base[i, c]
    rough = alpha >= SMOOTH
    hx, hy, hz = 0.0, 0.0, 1.0
    lot = u
    if rough:
        hx, hy, hz = visible_normal(ox, oy, oz, alpha, u, v)
        lot = w
    cosine = min(max(ox * hx + oy * hy + oz * hz, 0.0), 1.0)
    share, behind = dielectric(cosine, eta)
    if lot < share:
        ix, iy, iz = 2.0 * cosine * hx - ox, 2.0 * cosine * hy - oy, 2.0 * cosine * hz - oz
        if not rough:
            return ix, iy, iz, EXACT, 1.0
        if not iz > 0.0:
            return 0.0, 0.0, 1.0, 0.0, 1.0
        hidden_o, hidden_i = hidden(ox, oy, oz, alpha), hidden(ix, iy, iz, alpha)
        for c in range(f.size):
            f[c] *= (1.0 + hidden_o) / (1.0 + hidden_o + hidden_i)
        return ix, iy, iz, share * distribution(hx, hy, hz, alpha) / (4.0 * oz * (1.0 + hidden_o)), 1.0
    along = cosine / eta - behind
    ix, iy, iz = along * hx - ox / eta, along * hy - oy / eta, along * hz - oz / eta
    if not rough:
        return ix, iy, iz, EXACT, 1.0 / (eta * eta)
    if not iz < 0.0:
        return 0.0, 0.0, 1.0, 0.0, 1.0
    hidden_o, hidden_i = hidden(ox, oy, oz, alpha), hidden(ix, iy, iz, alpha)
    spread = -behind + cosine / eta
    density = (1.0 - share) * distribution(hx, hy, hz, alpha) * cosine / (oz * (1.0 + hidden_o)) * behind
    for c in range(f.size):
        f[c] /= 1.0 + hidden_i
    return ix, iy, iz, density / (spread * spread), 1.0 / (eta * eta)
