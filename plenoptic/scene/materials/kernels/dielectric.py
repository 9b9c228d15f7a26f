"""Bodies of glass, polished and rough, and panes without thickness: device functions. See `bsdf` for directions and f.

`eta` is the index behind the surface over that on the viewer's side.
"""

from __future__ import annotations

import math

from plenoptic.core.kernels.vectors import add, dot, scale
from plenoptic.core.numba.jit import device
from plenoptic.scene.lights.light_records import DELTA
from plenoptic.scene.materials.kernels.fresnel import dielectric
from plenoptic.scene.materials.kernels.microfacets import distribution, nothing, reflect, smith_lambda, visible_normal
from plenoptic.scene.materials.material_records import INSIDE, OUTSIDE, SMOOTH


@device
def relative_index(glass_index, material, front):
    """Index behind the surface over that on the viewer's side; 0 for a surface that is not that of a body."""
    inside, outside = glass_index[material, INSIDE], glass_index[material, OUTSIDE]
    if not inside > 0.0:
        return 0.0
    return inside / outside if front else outside / inside


@device
def eval_dielectric(f, alpha, eta, o, i):
    """See `bsdf.evaluate`: the change of radiance between media is left to the caller."""
    if alpha < SMOOTH or i[2] == 0.0:
        return nothing(f)
    reflected = i[2] > 0.0
    h = add(o, scale(i, 1.0 if reflected else eta))
    length = math.sqrt(dot(h, h))
    if not length > 0.0:
        return nothing(f)
    if h[2] < 0.0:
        length = -length
    h = (h[0] / length, h[1] / length, h[2] / length)
    at_o, at_i = dot(o, h), dot(i, h)
    # Facets seen from behind do not count.
    if not h[2] > 0.0 or at_o <= 0.0 or at_i * i[2] <= 0.0:
        return nothing(f)
    fraction, _ = dielectric(min(at_o, 1.0), eta)
    d = distribution(h, alpha)
    hidden_o, hidden_i = smith_lambda(o, alpha), smith_lambda(i, alpha)
    if reflected:
        pdf = fraction * d / (4.0 * o[2] * (1.0 + hidden_o))
        value = fraction * d / (4.0 * o[2] * (1.0 + hidden_o + hidden_i))
    else:
        spread = at_i + at_o / eta
        jacobian = abs(at_i) / (spread * spread)
        pdf = (1.0 - fraction) * d * at_o / (o[2] * (1.0 + hidden_o)) * jacobian
        value = pdf / (1.0 + hidden_i)
    for c in range(f.size):
        f[c] *= value
    return pdf


@device
def sample_dielectric(f, alpha, eta, o, u):
    """See `bsdf.sample`: reflect or refract at the surface, or at a facet of it that is seen."""
    rough = alpha >= SMOOTH
    x, y, z = 0.0, 0.0, 1.0
    lot = u[0]
    if rough:
        x, y, z = visible_normal(o, alpha, u[0], u[1])
        lot = u[2]
    h = (x, y, z)
    cosine = min(max(dot(o, h), 0.0), 1.0)
    fraction, behind = dielectric(cosine, eta)
    if lot < fraction:
        i = reflect(o, h, cosine)
        if not rough:
            return i, DELTA, 1.0
        if not i[2] > 0.0:
            return (0.0, 0.0, 1.0), 0.0, 1.0
        hidden_o, hidden_i = smith_lambda(o, alpha), smith_lambda(i, alpha)
        for c in range(f.size):
            f[c] *= (1.0 + hidden_o) / (1.0 + hidden_o + hidden_i)
        return i, fraction * distribution(h, alpha) / (4.0 * o[2] * (1.0 + hidden_o)), 1.0
    along = cosine / eta - behind
    i = (along * h[0] - o[0] / eta, along * h[1] - o[1] / eta, along * h[2] - o[2] / eta)
    if not rough:
        return i, DELTA, 1.0 / (eta * eta)
    if not i[2] < 0.0:
        return (0.0, 0.0, 1.0), 0.0, 1.0
    hidden_o, hidden_i = smith_lambda(o, alpha), smith_lambda(i, alpha)
    spread = -behind + cosine / eta
    pdf = (1.0 - fraction) * distribution(h, alpha) * cosine / (o[2] * (1.0 + hidden_o)) * behind
    for c in range(f.size):
        f[c] /= 1.0 + hidden_i
    return i, pdf / (spread * spread), 1.0 / (eta * eta)


@device
def sample_thin_dielectric(f, index, o, u):
    """See `bsdf.sample`: with all reflections inside, a pane reflects 2 R / (1 + R)."""
    once, _ = dielectric(min(o[2], 1.0), index)
    if u < 2.0 * once / (1.0 + once):
        for c in range(f.size):
            f[c] = 1.0
        return (-o[0], -o[1], o[2]), DELTA, 1.0
    return (-o[0], -o[1], -o[2]), DELTA, 1.0
