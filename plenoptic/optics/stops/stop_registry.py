"""Registry of stops, thin opaque screens with a hole.

Each has a `semi_diameter`, the radius of the circle about the axis that contains the hole. This circle replaces the
stop in paraxial data and in pupil bounds.
"""

from __future__ import annotations

from typing import TypeAlias

from plenoptic.optics.stops.circle import CircularStop
from plenoptic.optics.stops.mask import MaskStop
from plenoptic.optics.stops.polygon import PolygonStop
from plenoptic.optics.stops.ring import RingStop
from plenoptic.optics.stops.star import StarStop

Stop: TypeAlias = CircularStop | PolygonStop | StarStop | MaskStop | RingStop
"""Any stop."""

STOPS: dict[str, type[Stop]] = {
    "circle": CircularStop,
    "polygon": PolygonStop,
    "star": StarStop,
    "mask": MaskStop,
    "ring": RingStop,
}
"""Stops by their names in files."""


def circle_around(stop: Stop) -> CircularStop:
    """Circle about its axis that holds the hole of a stop, at the same position."""
    if isinstance(stop, CircularStop):
        return stop
    return CircularStop(stop.semi_diameter, stop.thickness, placement=stop.placement)


def is_convex(stop: Stop) -> bool:
    """True if the hole is convex: never for rings, not always for stars and masks."""
    return isinstance(stop, CircularStop | PolygonStop)
