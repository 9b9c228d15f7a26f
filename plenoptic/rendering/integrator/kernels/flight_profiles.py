"""Distances along the flights of rays in media, drawn by the lights: device functions.

C. Kulla and M. Fajardo, Importance sampling techniques for path tracing in participating media, EGSR 2012,
doi 10.1111/j.1467-8659.2012.03148.x.

A profile of light along a ray is its shape, the probability with which it draws the distance (otherwise the extinction
does), its centre and width in mm, and its cumulative values at the beginning and the end of the lit part of the ray.
"""

from __future__ import annotations

import math

from plenoptic.core.kernels.arctan import arctan2
from plenoptic.core.kernels.sincos import turn
from plenoptic.core.kernels.vectors import dot, scale, sub
from plenoptic.core.numba.jit import device

NO_SHAPE, EQUIANGULAR, GAUSSIAN = range(3)
"""Shapes: that of lights from infinity; uniform in the angle at a point of the light, `width` away from the ray; that
of a light sheet with the 1 / e^2 half width `width`."""

_LARGEST_PROBABILITY = 0.5
_ROOT_2 = math.sqrt(2.0)
_LEAST_SLOPE, _LEAST_PART = 1e-9, 2e-6
"""Least cosine between a ray and the normal of a sheet for a profile, and twice the least part of it on the ray."""
_LARGEST_ERF = 1.0 - 2.0**-50


@device
def no_profile():
    """The profile of lights from infinity: they light all of the ray alike."""
    return NO_SHAPE, 0.0, 0.0, 1.0, 0.0, 1.0


@device
def point_profile(to_light, direction, extent, begin, end):
    """The profile of a point of a light of an extent in mm, seen from the start of a ray.

    On a ray that is nearer than twice the extent, the light of all points is not that of this one: no profile.
    """
    centre = dot(to_light, direction)
    off = sub(to_light, scale(direction, centre))
    width2, least2 = dot(off, off), 4.0 * extent * extent
    if not width2 > least2:
        return no_profile()
    width, probability = math.sqrt(width2), _LARGEST_PROBABILITY * (1.0 - least2 / width2)
    last = 0.5 * math.pi if end == math.inf else arctan2(end - centre, width)
    return EQUIANGULAR, probability, centre, width, arctan2(begin - centre, width), last


@device
def sample_profile(profile, u):
    """Distance in mm from the ray's start, by a random number."""
    shape, _, centre, width, first, last = profile
    if shape == GAUSSIAN:
        return centre + width / _ROOT_2 * _inverse_erf(first + u * (last - first))
    c, s = turn(0.5 + (first + u * (last - first)) / (2.0 * math.pi))
    return centre + width * s / c


@device
def profile_density(profile, distance):
    """Density in 1/mm with which a distance is drawn."""
    shape, _, centre, width, first, last = profile
    off = distance - centre
    if shape == NO_SHAPE or not last > first:
        return 0.0
    if shape == GAUSSIAN:
        return 2.0 * _ROOT_2 / math.sqrt(math.pi) / (width * (last - first)) * math.exp(-2.0 * (off / width) ** 2)
    return width / ((last - first) * (width * width + off * off))


@device
def _inverse_erf(y):
    """Inverse error function: S. Winitzki's approximation to 2e-3, and two of Halley's steps."""
    y = min(max(y, -_LARGEST_ERF), _LARGEST_ERF)
    logarithm = math.log1p(-y * y)
    half = 2.0 / (math.pi * 0.147) + 0.5 * logarithm
    x = math.copysign(math.sqrt(max(math.sqrt(half * half - logarithm / 0.147) - half, 0.0)), y)
    for _ in range(2):
        step = 0.5 * math.sqrt(math.pi) * (math.erf(x) - y) * math.exp(x * x)
        x -= step / (1.0 + x * step)
    return x


@device
def lit_by_spot(spot, to_light, direction, reach):
    """Distances from the ray's start between which a spot lights it; twice 0 if it lights no part.

    The cone's points w from its tip, w . axis = |w| cosine, by a quadratic equation. Cones of a right angle and more
    have no such interval: all of the ray may be lit.
    """
    if not spot.cos_outer > 0.0:
        return 0.0, reach
    axis, c2 = (spot.axis_x, spot.axis_y, spot.axis_z), spot.cos_outer * spot.cos_outer
    along, off = dot(direction, axis), -dot(to_light, axis)
    a = along * along - c2
    b = along * off + c2 * dot(direction, to_light)
    root2 = b * b - a * (off * off - c2 * dot(to_light, to_light))
    if a == 0.0:
        return 0.0, reach
    middle, half = -b / a, math.sqrt(max(root2, 0.0)) / abs(a)
    begin, end = middle - half, middle + half
    if a > 0.0:
        # The ray stays in the cone, or comes out of it.
        begin, end = (end, reach) if along > 0.0 else (0.0, begin)
    elif not root2 > 0.0 or not off + middle * along > 0.0:
        return 0.0, 0.0
    return max(begin, 0.0), min(end, reach)


@device
def lit_by_sheet(sheet, to_waist, direction, reach):
    """Distances from the ray's start between which it lies behind the start of a sheet; twice 0 if no part does."""
    along = (sheet.along_x, sheet.along_y, sheet.along_z)
    slope, distance = dot(direction, along), sheet.start + dot(to_waist, along)
    if slope > 0.0:
        return max(distance / slope, 0.0), reach
    if slope < 0.0:
        return 0.0, min(distance / slope, reach)
    return 0.0, reach if distance <= 0.0 else 0.0


@device
def sheet_profile(sheet, to_waist, direction, extinction, begin, end):
    """The profile of a light sheet: a Gaussian with the width of the sheet where the ray crosses its middle plane.

    The extinction in 1/mm, and the divergence along oblique rays, change the light over the profile: the more they do,
    the fewer distances it draws. Divergent ones are widened, so that they hold the longer tail.
    """
    along, across = (sheet.along_x, sheet.along_y, sheet.along_z), (sheet.across_x, sheet.across_y, sheet.across_z)
    slope, drift = dot(direction, across), dot(direction, along)
    if not abs(slope) > _LEAST_SLOPE:
        return no_profile()
    centre = dot(to_waist, across) / slope
    s = centre * drift - dot(to_waist, along)
    half_width = math.hypot(sheet.waist, s * sheet.tangent)
    width = half_width / abs(slope)
    change = 0.5 * (math.hypot(sheet.waist, (abs(s) + abs(drift) * width) * sheet.tangent) / half_width - 1.0)
    width *= 1.0 + 4.0 * change
    first, last = math.erf(_ROOT_2 * (begin - centre) / width), math.erf(_ROOT_2 * (end - centre) / width)
    if not last - first > _LEAST_PART:
        return no_profile()
    variation = 2.0 * extinction * min(width, end - begin)
    # Light beyond the Gaussian is rare and missing in most renders: less than the error of the light within.
    return GAUSSIAN, 1.0 / (1.0 + variation**4 + (6.0 * change) ** 4), centre, width, first, last
