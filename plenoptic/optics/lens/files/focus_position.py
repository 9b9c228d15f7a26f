"""Position of the lenses at a focus distance, between two columns of a descriptive table."""

from __future__ import annotations

import math
from collections.abc import Sequence

from plenoptic.errors import InvalidValueError
from plenoptic.optics.glass.media import D_LINE
from plenoptic.optics.lens.files.zemax_stack import Row

_BISECTIONS = 60
"""Halvings of the way between two columns: to rounding errors."""


def columns_next_to(distances: Sequence[float], chosen: int, focus: float, where: str) -> tuple[int, int]:
    """Columns of a zoom position whose distances of the object (mm) enclose the focus distance, the nearer first.

    With several columns at infinity, the positions of a zoom, those of near objects follow in the same order.
    """
    n_zoom = max(1, sum(map(math.isinf, distances)))
    if len(distances) % n_zoom or (n_zoom > 1 and not all(map(math.isinf, distances[:n_zoom]))):
        raise InvalidValueError(
            f"{where} does not state the same focus distances (d0) for each of {n_zoom} zoom positions, those of "
            "infinity first; choose a column by configuration="
        )
    positions = range((chosen - 1) % n_zoom, len(distances), n_zoom)
    nearer = [i for i in positions if distances[i] <= focus]
    farther = [i for i in positions if distances[i] >= focus]
    if not nearer or not farther:
        stated = [distances[i] for i in positions]
        raise InvalidValueError(f"focus is {focus:g} mm; {where} states {min(stated):g} to {max(stated):g} mm (d0)")
    return max(nearer, key=distances.__getitem__), min(farther, key=distances.__getitem__)


def at_focus(near: list[Row], far: list[Row], focus: float, where: str) -> list[Row]:
    """Rows of the position at which an object at the focus distance has its paraxial image where the columns have it.

    All gaps and the stop's diameter change linearly from column to column, and so does the distance of the image from
    the image surface.
    """
    if far[0].gap == focus:
        return far
    defocus_near, defocus_far = _defocus(near), _defocus(far)

    def rows_at(part: float) -> list[Row]:
        moved = [
            a._replace(gap=a.gap + part * (b.gap - a.gap), diameter=a.diameter + part * (b.diameter - a.diameter))
            for a, b in zip(near[1:], far[1:], strict=True)
        ]
        return [near[0]._replace(gap=focus), *moved]

    def excess(part: float) -> float:
        return _defocus(rows_at(part)) - (defocus_near + part * (defocus_far - defocus_near))

    low, high, sign = 0.0, 1.0, math.copysign(1.0, excess(1.0))
    if not excess(0.0) * sign <= 0:
        raise InvalidValueError(
            f"focus is {focus:g} mm, and no position between the columns of {where} for {near[0].gap:g} and "
            f"{far[0].gap:g} mm (d0) has its image there; choose one of them by configuration="
        )
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if excess(middle) * sign > 0 else (middle, high)
    return rows_at(0.5 * (low + high))


def _defocus(rows: list[Row]) -> float:
    """Distance in mm from the image surface to the paraxial image at the d line."""
    distance = rows[0].gap
    y, angle, n = (1.0, 0.0, 1.0) if math.isinf(distance) else (distance, 1.0, 1.0)  # the angle times the index
    for row in rows[1:-1]:
        behind = float(row.medium.index(D_LINE))
        curvature = row.curvature + (2.0 * row.aspheric[0] if row.aspheric else 0.0)
        angle -= (behind - n) * curvature * y
        y, n = y + row.gap * angle / behind, behind
    return -n * y / angle if angle else math.inf
