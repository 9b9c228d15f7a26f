"""Checks of a lens by real rays: vignetting of the axial beam, and elements that amplify errors."""

import dataclasses
import math
from collections.abc import Collection, Iterator

import numpy as np

from plenoptic.core.rays import RayBundle, RayStatus
from plenoptic.core.values import Floats
from plenoptic.optics.lens.analysis.conditioning import blocks_of, probe_rays, sizes
from plenoptic.optics.lens.checks.finding import Finding, FindingKind
from plenoptic.optics.lens.elements import with_round_stops
from plenoptic.optics.lens.files.infer_stop import basis_rays
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points
from plenoptic.optics.lens.lens_record import lens_record
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.placement import to_lens_axes
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.lens.trace import trace_part
from plenoptic.optics.surfaces.surface import Surface

_FILLED = 0.95
_RAYS = 513
_BEYOND = 1.5
"""Largest height of traced rays over the paraxial semi-diameter of the beam: aberrations may move the edge of the iris
outwards."""
_WIDEST = 88.0
"""Largest angle against the axis, degrees, of rays through the centre of the iris."""
_WIDEST_OUTSIDE = 60.0
"""Largest angle against the axis, degrees, if the iris lies outside the lens: no rim limits the rays on that side."""
_WIDEST_FREE = 45.0
"""Largest angle against the axis, degrees, for `condition_findings`: larger ones are hardly used by the lens."""
_LOST_IN_THE_LENS = (RayStatus.TOTAL_REFLECTION, RayStatus.MISSED)

# Of 23 lenses of W. J. Smith, Modern Lens Design, and the bundled ones, the largest numbers are 3.4, 4.2 and 27.
_GRAZING = 10.0
_NEAR_CRITICAL = 10.0
_CANCELLED = 1e4

_GRAZING_SENTENCE = (
    "transmitted rays have angles of incidence up to {degrees:.4g} degrees at element {at}, which magnifies their "
    "errors there {number:.3g} times (1 / cos i); the limit is {limit:g}: reduce its semi-diameter "
    "or check the radii"
)
_NEAR_CRITICAL_SENTENCE = (
    "transmitted rays are close to total reflection at surface {at}, which magnifies errors of their direction "
    "{number:.3g} times (n cos i / (n' cos i')); the limit is {limit:g}: reduce its semi-diameter "
    "or check the radii"
)
_CANCELLED_SENTENCE = (
    "the lengths that enter intersections with element {at} are {number:.3g} times its size of {size:.3g} mm, so "
    "{digits:.2g} of 15.7 decimal digits are lost; the limit is 4: reduce the gaps next to it, or check "
    "the units"
)


def ray_findings(lens: LensStack, wavelength: float) -> Iterator[Finding]:
    """Findings from rays in the plane x = 0: an axial beam, and chief rays to both sides.

    The beam comes from infinity, or from the front focus of a lens of positive focal length whose rear focus does not
    lie behind it. Masks are replaced by the circles around them.
    """
    exact = _exact_without_masks(lens)
    rays, origin = _axial_beam(exact, wavelength)
    if rays is not None:
        whole = exact.trace(rays)
        if (whole.status == RayStatus.OK).any():
            yield from _axial_findings(exact, rays, whole, origin)
        elif not len(_passing_rays(exact, np.radians(np.linspace(-_WIDEST, _WIDEST, _RAYS)), 15, wavelength)):
            message = (
                "none of the traced rays passes the lens, from all over the iris and in all directions of the plane "
                "x = 0; check decentres, tilts and semi-diameters"
            )
            yield Finding(FindingKind.NO_LIGHT, (), message)
    yield from _chief_findings(exact, wavelength)


def _passing_rays(lens: LensStack, angle: Floats, heights: int, wavelength: float) -> RayBundle:
    """Transmitted rays of fans through `heights` points of the iris, starting at the first element."""
    places = np.linspace(-0.98, 0.98, heights) * lens.stop.filled_radius
    fans = [_fan(lens, angle, wavelength, reverse=True, height=float(height)) for height in places]
    origin, direction = (np.concatenate([getattr(fan, name) for fan in fans]) for name in ("origin", "direction"))
    ahead = trace_part(lens, RayBundle(origin, direction, wavelength), 0, lens.iris_index, reverse=True)
    ahead = ahead.selected(ahead.status == RayStatus.OK)
    reversed_rays = RayBundle(ahead.origin, -ahead.direction, wavelength)
    return reversed_rays.selected(lens.trace(reversed_rays).status == RayStatus.OK)


def _axial_beam(lens: LensStack, wavelength: float) -> tuple[RayBundle | None, str]:
    """Rays on one side of the axis, from the axis outwards, and the name of their origin."""
    points, z = cardinal_points(lens, wavelength), lens.vertices
    heights, _ = basis_rays(lens.elements, front_medium=lens.front_medium, wavelength=wavelength)
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
    if from_focus:  # the focus may lie behind the first vertex, for instance in a cover glass
        direction = (at_first - focus) * math.copysign(1.0, distance)
    beam = RayBundle(at_first, direction, wavelength)
    return beam, "from the front focus" if from_focus else "from infinity"


def _exact_without_masks(lens: LensStack) -> LensStack:
    """The lens with its masks and rings replaced by the circles around them."""
    exact = lens if lens.model is LensModel.EXACT else lens.with_model(LensModel.EXACT)
    elements = with_round_stops(exact.elements)
    return exact if elements == list(exact.elements) else dataclasses.replace(exact, elements=elements)


def _axial_findings(lens: LensStack, rays: RayBundle, whole: RayBundle, origin: str) -> Iterator[Finding]:
    """Findings of the axial beam: from the axis outwards, the first lost ray must be lost at the iris."""
    lost = np.flatnonzero(whole.status != RayStatus.OK)
    passing = int(lost[0]) - 1 if len(lost) else -1
    if passing < 0 or whole.lost_at[passing + 1] == lens.iris_index:
        return
    at_iris = trace_part(lens, rays, 0, lens.iris_index, clipping=False)
    filled = float(np.hypot(at_iris.origin[passing, 0], at_iris.origin[passing, 1])) / lens.stop.filled_radius
    at, status = int(whole.lost_at[passing + 1]), RayStatus(int(whole.status[passing + 1]))
    if status in _LOST_IN_THE_LENS:
        fate = "are totally reflected at" if status is RayStatus.TOTAL_REFLECTION else "miss"
        message = (
            f"rays of the beam {origin} on the axis {fate} surface {at} once they fill {100 * filled:.0f} % of "
            f"the iris's semi-diameter, {lens.stop.filled_radius:.4g} mm; reduce the iris, or check the radii"
        )
        yield Finding(FindingKind.TOTAL_REFLECTION, (at,), message)
    elif filled < _FILLED:
        element = lens.elements[at]
        message = (
            f"the beam {origin} on the axis is limited by element {at}, semi-diameter {element.semi_diameter:.4g} mm, "
            f"and fills {100 * filled:.0f} % of the iris's semi-diameter, {lens.stop.filled_radius:.4g} mm; reduce the "
            f"iris or widen element {at}"
        )
        yield Finding(FindingKind.IRIS_NOT_FILLED, tuple(sorted((at, lens.iris_index))), message)


def _chief_findings(lens: LensStack, wavelength: float) -> Iterator[Finding]:
    """Findings of chief rays: with increasing angle, the first lost ray must be clipped by a rim."""
    angle = np.radians(np.linspace(0.0, _WIDEST_OUTSIDE if _iris_is_outside(lens) else _WIDEST, _RAYS))
    last = len(lens.elements) - 1
    behind = trace_part(lens, _fan(lens, angle, wavelength, reverse=False), lens.iris_index, last)
    before = trace_part(lens, _fan(lens, angle, wavelength, reverse=True), 0, lens.iris_index, reverse=True)
    lost = np.flatnonzero((before.status != RayStatus.OK) | (behind.status != RayStatus.OK))
    if not len(lost):
        return
    first = int(lost[0])
    for out in (before, behind):
        if out.status[first] == RayStatus.TOTAL_REFLECTION:
            at, limit = int(out.lost_at[first]), math.degrees(angle[first])
            message = (
                f"rays through the centre of the iris at more than {limit:.1f} degrees are totally reflected at "
                f"surface {at}, within its semi-diameter of {lens.elements[at].semi_diameter:.4g} mm; this limits "
                "the field: reduce the semi-diameter, or check the radii"
            )
            yield Finding(FindingKind.TOTAL_REFLECTION, (at,), message)


def _iris_is_outside(lens: LensStack) -> bool:
    in_front = [isinstance(element, Surface) for element in lens.elements[: lens.iris_index]]
    behind = [isinstance(element, Surface) for element in lens.elements[lens.iris_index :]]
    return not (any(in_front) and any(behind))


def _fan(lens: LensStack, angle: Floats, wavelength: float, *, reverse: bool, height: float = 0.0) -> RayBundle:
    """Rays through a point of the iris, at angles against the axis towards +y."""
    point = to_lens_axes(lens.stop.placement, np.array([0.0, height, 0.0]))
    side = -1.0 if reverse else 1.0
    direction = np.stack([np.zeros_like(angle), side * np.sin(angle), side * np.cos(angle)], axis=1)
    return RayBundle(np.tile(point, (len(angle), 1)), direction, wavelength)


def condition_findings(lens: LensStack, wavelength: float, *, leave_out: Collection[int] = ()) -> Iterator[Finding]:
    """Finding for each kind of condition number that is too large, at the element with the largest value.

    Condition numbers are those of transmitted rays, towards the sensor. In reverse, grazing incidence becomes emergence
    close to total reflection, and vice versa. `leave_out` are elements with a finding of total reflection.
    """
    exact = _exact_without_masks(lens)
    widest = math.radians(_WIDEST_FREE if _iris_is_outside(exact) else _WIDEST)
    rays = _passing_rays(exact, np.linspace(-widest, widest, 257), 9, wavelength)
    if not len(rays):
        return
    record = lens_record(lens, wavelength, reverse=False, first=0, last=len(lens.elements) - 1)
    records = probe_rays(record, blocks_of(rays), len(rays))
    considered = [i not in leave_out for i in range(len(lens.elements))]
    for kind, numbers, limit, sentence in (
        (FindingKind.GRAZING, records.incidence, _GRAZING, _GRAZING_SENTENCE),
        (FindingKind.NEAR_TOTAL_REFLECTION, records.refraction, _NEAR_CRITICAL, _NEAR_CRITICAL_SENTENCE),
        (FindingKind.CANCELLATION, records.cancellation, _CANCELLED, _CANCELLED_SENTENCE),
    ):
        largest = np.where(considered, np.nan_to_num(numbers, nan=0.0, posinf=math.inf).max(axis=1), 0.0)
        at, number = int(np.argmax(largest)), float(largest.max())
        if number > limit:
            degrees, digits = math.degrees(math.acos(1.0 / number)), math.log10(number)
            size = float(sizes(record)[at])
            message = sentence.format(at=at, number=number, limit=limit, degrees=degrees, digits=digits, size=size)
            yield Finding(kind, (at,), message)
