"""Registry of stops, thin opaque screens with a hole.

Each has a `semi_diameter`, the radius of the circle about the axis that contains the hole. This circle replaces the
stop in paraxial data and in pupil bounds.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

from plenoptic.optics.microlens.lattice import polygon_area
from plenoptic.optics.stops.circle import CircularStop
from plenoptic.optics.stops.mask import MaskStop
from plenoptic.optics.stops.polygon import PolygonStop
from plenoptic.optics.stops.ring import RingStop
from plenoptic.optics.stops.star import StarStop

_ROUNDING = 1e-9

Stop: TypeAlias = CircularStop | PolygonStop | StarStop | MaskStop | RingStop
"""Any stop."""


class StopKind(NamedTuple):
    """A class of stops, with the properties of its holes that others ask for: no other file tells classes apart."""

    stop: type[Stop]
    is_convex: bool
    """False if the hole is not; blades that are curved inwards are told by `is_convex`."""
    has_round_edge: bool
    """True if the outer edge is the circle around the hole."""
    fills_outline: bool
    """True if all light within `outline` passes: diffraction knows its far field, and rays along y sample it."""


STOPS: dict[str, StopKind] = {
    "circle": StopKind(CircularStop, is_convex=True, has_round_edge=True, fills_outline=True),
    "polygon": StopKind(PolygonStop, is_convex=True, has_round_edge=False, fills_outline=True),
    "star": StopKind(StarStop, is_convex=False, has_round_edge=False, fills_outline=True),
    "mask": StopKind(MaskStop, is_convex=False, has_round_edge=False, fills_outline=False),
    "ring": StopKind(RingStop, is_convex=False, has_round_edge=True, fills_outline=False),
}
"""Stops by their names in files."""


def circle_around(stop: Stop) -> CircularStop:
    """Circle about its axis that holds the hole of a stop, at the same position."""
    if is_circle(stop):
        return stop  # type: ignore[return-value]
    return CircularStop(stop.semi_diameter, stop.thickness, placement=stop.placement)


def is_circle(stop: Stop) -> bool:
    """True if the hole is the circle around it."""
    kind = stop_kind(stop)
    return kind.is_convex and kind.has_round_edge


def is_convex(stop: Stop) -> bool:
    """True if the hole is convex: it has at least the area of the polygon of its corners."""
    return stop_kind(stop).is_convex and polygon_area(stop.outline(3)) <= (1 + _ROUNDING) * stop.area


def stop_kind(stop: Stop) -> StopKind:
    """Kind of a stop."""
    return next(kind for kind in STOPS.values() if kind.stop is type(stop))
