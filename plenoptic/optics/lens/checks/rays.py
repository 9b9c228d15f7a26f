"""Rays through a lens that show whether its rims let the light through that its iris would."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator

import numpy as np

from plenoptic.core.rays import RayBundle, RayStatus
from plenoptic.core.values import Floats
from plenoptic.optics.lens.checks.finding import Finding, FindingKind
from plenoptic.optics.lens.elements import Element
from plenoptic.optics.lens.files.infer_stop import basis_rays
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.lens.trace import traced_part
from plenoptic.optics.stops.circle import circle_around
from plenoptic.optics.surfaces.surface import Surface

_FILLED = 0.95
_RAYS = 513
_BEYOND = 1.5
"""How far beyond the paraxial edge of the beam rays are tried, for the iris may be overfilled by aberrations."""
_WIDEST = 88.0
"""Largest angle against the axis, degrees, of rays through the centre of the iris."""
_WIDEST_OUTSIDE = 60.0
"""The same where the iris stands outside the lens, so that no rim between it and the scene, or the sensor, sets a
limit."""
_WIDEST_FREE = 45.0
"""The same for `passing_rays`: what lies further out is hardly what the lens is for."""
_FANS, _FAN = 9, 257
"""Points of the iris, and rays through each of them, of `passing_rays`."""
_LOST_IN_THE_LENS = (RayStatus.TOTAL_REFLECTION, RayStatus.MISSED)


def ray_findings(lens: LensStack, wavelength: float) -> Iterator[Finding]:
    """What rays in the plane x = 0 show: a beam on the axis, and chief rays to both sides.

    The beam comes from infinity, or from the front focus of a lens of positive focal length whose rear focus does not
    lie behind it. Masks are taken as the circles around them.

    Examples
    --------
    >>> import plenoptic as pl
    >>> from plenoptic.optics.lens.checks.rays import ray_findings
    >>> list(ray_findings(pl.load_lens("telephoto-100mm-f2.8"), 587.6))
    []
    """
    exact = _without_masks(lens if lens.model is LensModel.EXACT else lens.with_model(LensModel.EXACT))
    rays, origin = _axial_beam(exact, wavelength)
    if rays is not None:
        whole = exact.trace(rays)
        if (whole.status == RayStatus.OK).any():
            yield from _axial_findings(exact, rays, whole, origin)
        elif not _some_ray_passes(exact, wavelength):
            yield Finding(
                FindingKind.NO_LIGHT,
                (),
                "no ray passes the lens of those tried, from all over the iris and in all directions of the plane "
                "x = 0; check decentres, tilts and semi-diameters",
            )
    yield from _chief_findings(exact, wavelength)


def passing_rays(lens: LensStack, wavelength: float) -> RayBundle:
    """Rays of the plane x = 0, from all over the iris and in all directions, that pass the lens.

    They start on the first element, on their way to the sensor; masks are taken as the circles around them.

    Examples
    --------
    >>> import plenoptic as pl
    >>> from plenoptic.optics.lens.checks.rays import passing_rays
    >>> lens = pl.load_lens("double-gauss-100mm-f2")
    >>> bool((lens.trace(passing_rays(lens, 587.6)).status == 0).all())
    True
    """
    exact = _without_masks(lens if lens.model is LensModel.EXACT else lens.with_model(LensModel.EXACT))
    widest = math.radians(_WIDEST_FREE if _iris_is_outside(exact) else _WIDEST)
    angle = np.linspace(-widest, widest, _FAN)
    heights = np.linspace(-0.98, 0.98, _FANS) * exact.stop.inner_radius
    fans = [_fan(exact, angle, wavelength, reverse=True, height=float(height)) for height in heights]
    rays = RayBundle(
        np.concatenate([fan.origin for fan in fans]), np.concatenate([fan.direction for fan in fans]), wavelength
    )
    ahead = traced_part(exact, rays, 0, exact.iris_index, reverse=True)
    ahead = ahead.selected(ahead.status == RayStatus.OK)
    there = RayBundle(ahead.origin, -ahead.direction, wavelength)
    return there.selected(exact.trace(there).status == RayStatus.OK)


def _axial_beam(lens: LensStack, wavelength: float) -> tuple[RayBundle | None, str]:
    """Rays on one side of the axis, from the axis outwards, and where they come from."""
    points, z = cardinal_points(lens, wavelength), lens.vertices
    heights, _ = basis_rays(lens.elements, ambient=lens.ambient, wavelength=wavelength)
    from_focus = points.bfl <= 0 < points.efl and points.front_focus != z[0]
    index = float(lens.indices(wavelength)[0])
    distance = float(z[0]) - points.front_focus
    start = np.array([1.0, index / distance]) if from_focus else np.array([1.0, 0.0])
    at_iris = abs(float(heights[lens.iris_index] @ start))
    widest = _BEYOND * lens.stop.semi_diameter / at_iris if at_iris else math.inf
    if not math.isfinite(widest):
        return None, ""
    y = np.linspace(0.0, widest, _RAYS)
    at_first = np.stack([np.zeros(_RAYS), y, np.full(_RAYS, z[0])], axis=1)
    focus = np.array([0.0, 0.0, points.front_focus])
    direction = np.tile([0.0, 0.0, 1.0], (_RAYS, 1))
    if from_focus:  # which may lie behind the first vertex: in a cover glass, for instance
        direction = (at_first - focus) * math.copysign(1.0, distance)
    beam = RayBundle(at_first, direction, wavelength)
    return beam, "from the front focus" if from_focus else "from infinity"


def _without_masks(lens: LensStack) -> LensStack:
    """The lens with circles around its masks: rays in one plane say little of the holes of a mask."""
    masks = [i for i, element in enumerate(lens.elements) if element.row().cells is not None]
    if not masks:
        return lens
    elements: list[Element] = list(lens.elements)
    for i in masks:
        elements[i] = circle_around(elements[i])
    return dataclasses.replace(lens, elements=elements)


def _axial_findings(lens: LensStack, rays: RayBundle, whole: RayBundle, origin: str) -> Iterator[Finding]:
    """From the axis outwards, the first ray that is lost should be lost at the iris."""
    lost = np.flatnonzero(whole.status != RayStatus.OK)
    passing = int(lost[0]) - 1 if len(lost) else -1
    if passing < 0 or whole.lost_at[passing + 1] == lens.iris_index:
        return
    at_iris = traced_part(lens, rays, 0, lens.iris_index, clipping=False)
    filled = float(np.hypot(at_iris.origin[passing, 0], at_iris.origin[passing, 1])) / lens.stop.inner_radius
    at, status = int(whole.lost_at[passing + 1]), RayStatus(int(whole.status[passing + 1]))
    if status in _LOST_IN_THE_LENS:
        how = "are totally reflected at" if status is RayStatus.TOTAL_REFLECTION else "miss"
        yield Finding(
            FindingKind.TOTAL_REFLECTION,
            (at,),
            f"rays of the beam {origin} on the axis {how} surface {at} once they fill {100 * filled:.0f} % of "
            f"the iris's semi-diameter, {lens.stop.inner_radius:.4g} mm; reduce the iris, or check the radii",
        )
    elif filled < _FILLED:
        element = lens.elements[at]
        yield Finding(
            FindingKind.IRIS_NOT_FILLED,
            tuple(sorted((at, lens.iris_index))),
            f"the beam {origin} on the axis is limited by element {at}, semi-diameter {element.semi_diameter:.4g} mm, "
            f"and fills {100 * filled:.0f} % of the iris's semi-diameter, {lens.stop.inner_radius:.4g} mm; reduce the "
            f"iris or widen element {at}",
        )


def _chief_findings(lens: LensStack, wavelength: float) -> Iterator[Finding]:
    """Rays through the centre of the iris, ever steeper, should end at a rim, in front of the iris or behind it."""
    angle = np.radians(np.linspace(0.0, _WIDEST_OUTSIDE if _iris_is_outside(lens) else _WIDEST, _RAYS))
    last = len(lens.elements) - 1
    behind = traced_part(lens, _fan(lens, angle, wavelength, reverse=False), lens.iris_index, last)
    before = traced_part(lens, _fan(lens, angle, wavelength, reverse=True), 0, lens.iris_index, reverse=True)
    lost = np.flatnonzero((before.status != RayStatus.OK) | (behind.status != RayStatus.OK))
    if not len(lost):
        return
    first = int(lost[0])
    for out in (before, behind):
        if out.status[first] == RayStatus.TOTAL_REFLECTION:
            at, limit = int(out.lost_at[first]), math.degrees(angle[first])
            yield Finding(
                FindingKind.TOTAL_REFLECTION,
                (at,),
                f"rays through the centre of the iris at more than {limit:.1f} degrees are totally reflected at "
                f"surface {at}, within its semi-diameter of {lens.elements[at].semi_diameter:.4g} mm; that limits "
                "the field: reduce the semi-diameter, or check the radii",
            )


def _iris_is_outside(lens: LensStack) -> bool:
    in_front = [isinstance(element, Surface) for element in lens.elements[: lens.iris_index]]
    behind = [isinstance(element, Surface) for element in lens.elements[lens.iris_index :]]
    return not (any(in_front) and any(behind))


def _fan(lens: LensStack, angle: Floats, wavelength: float, *, reverse: bool, height: float = 0.0) -> RayBundle:
    """Rays through a point of the iris, at angles from the axis towards +y."""
    placement = lens.stop.placement
    point = np.array([0.0, height, 0.0])
    if placement is not None:
        point = point @ np.asarray(placement.rotation).T + placement.shift
    side = -1.0 if reverse else 1.0
    direction = np.stack([np.zeros_like(angle), side * np.sin(angle), side * np.cos(angle)], axis=1)
    return RayBundle(np.tile(point, (len(angle), 1)), direction, wavelength)


def _some_ray_passes(lens: LensStack, wavelength: float) -> bool:
    angle = np.radians(np.linspace(-_WIDEST, _WIDEST, _RAYS))
    last = len(lens.elements) - 1
    for height in np.linspace(-0.98, 0.98, 15) * lens.stop.inner_radius:
        rays = _fan(lens, angle, wavelength, reverse=False, height=float(height))
        behind = traced_part(lens, rays, lens.iris_index, last)
        back = dataclasses.replace(rays, direction=-rays.direction)
        before = traced_part(lens, back, 0, lens.iris_index, reverse=True)
        if ((behind.status == RayStatus.OK) & (before.status == RayStatus.OK)).any():
            return True
    return False
