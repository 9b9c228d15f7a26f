"""Quadrature over the light in the iris, for integrals over wavefronts such as the Strehl ratio."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats
from plenoptic.optics.lens.pupil.beam import ImagedPoint
from plenoptic.optics.lens.pupil.iris_points import INSIDE
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.lens.waves.sphere_rays import SphereRays, rays_to_sphere

_RULES = (((192, 24), (128, 16)), ((768, 24), (384, 24)))
"""Angles and radii of the rule that integrates the Strehl ratio, and of the coarser one that estimates its error: the
second pair where the error of the first exceeds `_TOLERANCE`, for light with corners."""
_TOLERANCE = 5e-5
_LINE, _DIVISIONS, _SUBDIVISIONS = 65, 16, 5
"""Points along a radius of the iris, and parts and times into which the intervals at the ends of its light are divided.
"""


class PupilRule(NamedTuple):
    """Two quadrature rules for integrals over the light in the iris; see `Wavefront.rule`."""

    pupil: Floats
    """(k, 2)."""
    rays: SphereRays
    amplitude: Floats
    """(k, 2): amplitude in either rule, with a sum of 1."""


def pupil_rule(lens: LensStack, point: ImagedPoint, wavelength: float) -> PupilRule | None:
    """Rules over the light in the iris in polar coordinates; None if it has several parts on one radius."""
    rule = _rule(lens, point, wavelength, _RULES[0])
    if rule is None or np.ptp(strehl_ratios(rule.rays.opd, rule.amplitude)) <= _TOLERANCE:
        return rule
    return _rule(lens, point, wavelength, _RULES[1])


def _rule(
    lens: LensStack, point: ImagedPoint, wavelength: float, numbers: tuple[tuple[int, int], ...]
) -> PupilRule | None:
    parts = []
    for angles, radii in numbers:
        angle = 2.0 * math.pi * (np.arange(angles) + 0.5) / angles
        axes = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        ends = _lit_ends(lens, point, wavelength, axes)
        if ends is None:
            return None
        nodes, weights = (part[:, None] for part in np.polynomial.legendre.leggauss(radii))
        half = 0.5 * (ends[1] - ends[0])
        radius = ends[0] + half * (1.0 + nodes)
        parts.append(((radius[..., None] * axes).reshape(-1, 2), (weights * half * radius).ravel()))
    pupil, area = (np.concatenate(part) for part in zip(*parts, strict=True))
    rays = rays_to_sphere(lens, point, wavelength, pupil)
    lit = np.isfinite(rays.opd) & (area > 0)
    light = np.where(lit, np.sqrt(rays.light * rays.solid_angle) * area, 0.0)
    is_first = np.arange(len(pupil)) < len(parts[0][1])
    amplitude = np.column_stack([np.where(is_first, light, 0.0), np.where(is_first, 0.0, light)])
    rays = rays._replace(opd=np.where(lit, rays.opd, 0.0))
    return PupilRule(pupil, rays, amplitude / amplitude.sum(axis=0))


def _lit_ends(lens: LensStack, point: ImagedPoint, wavelength: float, axes: Floats) -> Floats | None:
    """Radii (2, n) between which light passes the iris along axes (n, 2); None if there are several such intervals."""

    def passes(radii: Floats) -> NDArray[np.bool_]:
        rays = point.rays(lens, (radii[..., None] * axes).reshape(-1, 2), wavelength)
        return np.asarray(lens.trace(rays).status == 0).reshape(radii.shape)

    radii = np.linspace(0.0, INSIDE, _LINE)[:, None] * np.ones(len(axes))
    lit = passes(radii)
    if ((lit[1:] & ~lit[:-1]).sum(axis=0) + lit[0] > 1).any():
        return None
    first, last, every = lit.argmax(axis=0), _LINE - 1 - lit[::-1].argmax(axis=0), np.arange(len(axes))
    inside = np.stack([radii[first, every], radii[last, every]])
    outside = np.stack([radii[np.maximum(first - 1, 0), every], radii[np.minimum(last + 1, _LINE - 1), every]])
    for _ in range(_SUBDIVISIONS if (inside != outside).any() else 0):
        steps = (outside - inside) * np.arange(1, _DIVISIONS)[:, None, None] / _DIVISIONS
        still = np.logical_and.accumulate(passes(inside + steps), axis=0).sum(axis=0)
        step = (outside - inside) / _DIVISIONS
        inside, outside = inside + still * step, inside + (still + 1) * step
    return np.where(lit.any(axis=0), inside, 0.0)


def strehl_ratios(opd: Floats, amplitude: Floats) -> Floats:
    """Strehl ratios (k,) of path differences (n,) in waves, with amplitudes (n, k) whose sums are 1."""
    return np.asarray(np.abs(np.exp(2j * math.pi * opd) @ amplitude) ** 2)
