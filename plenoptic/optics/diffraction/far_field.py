"""Far-field patterns of openings, as tables from which bends are drawn.

The pattern of an evenly and incoherently lit opening A is |F(nu)|^2 / area, F its Fourier transform, over spatial
frequencies nu in cycles/mm: a ray of wavelength lambda bends by lambda nu in direction cosines (J. W. Goodman,
Introduction to Fourier Optics, section 4.4). Within `_INNER` periods of the opening's box it is tabulated; beyond,
where its edges act each by itself, it is drawn in closed form, to infinity: an edge of length l with the normal n sends
light along n, with the density l / (4 pi^2 a^2) at the distance a, spread beside it as sinc^2(l b).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats
from plenoptic.optics.microlens.aperture import Opening
from plenoptic.optics.microlens.lattice import polygon_area, polygon_edges

_INNER, _CELLS = 8.0, 16
"""Radius of the tabulated disc, in periods of the box around the opening, and cells of the table for each period: they
blur less than 0.1 % of the contrast at half the cut-off away."""
_LOOKS = 2
"""Along a side of a cell, to average over it."""
_WIDE, _STEPS = 64.0, 4096
"""How far sinc^2 is tabulated, and its steps."""


class FarField(NamedTuple):
    """A pattern to draw from. Frequencies are in periods of the box around the opening."""

    rows: Floats
    """(n + 1,): cumulative shares of the rows of cells, up to that of the disc."""
    columns: Floats
    """(n, n + 1): in each row, those of its cells, up to 1."""
    step: float
    """Side of a cell."""
    edges: Floats
    """(k, 6): cumulative shares of the edges beyond the disc, their normals, lengths, and what paths through and beside
    openings count there. Edges of a circle are one of length 0."""
    spread: Floats
    """(s,): where sinc^2 has its share i / (s - 1), from -_WIDE to _WIDE."""
    inner: float
    """Radius of the disc."""
    scale: Floats
    """(2, 2): from periods to cycles/mm along x and y."""
    opening: Floats | None
    """(n, n): of the light at each cell, how much more passed the opening than its part of the area; None where nothing
    passes beside openings."""
    share: float
    """Of the area, the opening's."""


def far_field(opening: Opening, around: Floats | None, turn: Floats) -> FarField:
    """Far field of an opening and, where light passes outside it, of the area between it and the polygon `around`.

    `turn` (2, 2) leads from the axes of the opening to those in which bends are wanted.
    """
    sides = np.abs(opening.corners if around is None else around).max(axis=0) * 2.0
    if math.isfinite(opening.radius) and around is None:
        sides = np.full(2, 2.0 * opening.radius)
    n = int(2 * _INNER * _CELLS)
    step = 1.0 / _CELLS
    along = (np.arange(n * _LOOKS) + 0.5) * (step / _LOOKS) - _INNER
    u, v = np.meshgrid(along, along)
    parts = [_transform(opening, sides, u, v)]
    areas = [_area(opening) / float(sides.prod())]
    if around is not None:
        whole = Opening(around)
        parts.append(_transform(whole, sides, u, v) - parts[0])
        areas.append(_area(whole) / float(sides.prod()) - areas[0])
    light = [_cells(np.abs(part) ** 2, n) * step**2 / sum(areas) for part in parts]
    middle = (np.arange(n) + 0.5) * step - _INNER
    inside = np.hypot(*np.meshgrid(middle, middle)) < _INNER
    total, share = np.where(inside, sum(light), 0.0), areas[0] / sum(areas)
    rows = total.sum(axis=1)
    columns = np.cumsum(total, axis=1) / np.where(rows > 0, rows, 1.0)[:, None]
    edges = _edges(opening, around, sides)
    if around is not None:
        # What passes the opening, and what passes beside it, add up to their parts of the area.
        weights = np.diff(edges[:, 0], prepend=0.0)
        for column, part, lit in ((4, share, light[0]), (5, 1.0 - share, light[1])):
            beyond = max(part - float(lit[inside].sum()), 0.0) / (1.0 - rows.sum())
            edges[:, column] *= beyond / part / (weights @ edges[:, column])
    return FarField(
        rows=np.append(0.0, np.cumsum(rows)),
        columns=np.column_stack([np.zeros(n), columns]),
        step=step,
        edges=edges,
        spread=_spread(),
        inner=_INNER,
        scale=np.ascontiguousarray(turn @ np.diag(1.0 / sides)),
        opening=None if around is None else light[0] / sum(light) / share,
        share=share,
    )


def without(field: FarField, cells: NDArray[np.bool_]) -> tuple[FarField, float]:
    """The pattern without some cells (n, n) of its table, and which share of the light it has."""
    lit = np.diff(field.columns, axis=1) * np.diff(field.rows)[:, None]
    kept = np.where(cells, 0.0, lit)
    share = 1.0 - float(lit[cells].sum())
    rows = kept.sum(axis=1)
    columns = np.cumsum(kept, axis=1) / np.where(rows > 0, rows, 1.0)[:, None]
    return (
        field._replace(
            rows=np.append(0.0, np.cumsum(rows)) / share, columns=np.column_stack([np.zeros(len(rows)), columns])
        ),
        share,
    )


def _area(opening: Opening) -> float:
    return math.pi * opening.radius**2 if math.isfinite(opening.radius) else polygon_area(opening.corners)


def _cells(fine: Floats, n: int) -> Floats:
    return np.asarray(fine.reshape(n, _LOOKS, n, _LOOKS).mean(axis=(1, 3)))


def _transform(opening: Opening, sides: Floats, u: Floats, v: Floats) -> Floats:
    """Fourier transform of an opening in units of a box's sides, at frequencies u, v, real or complex."""
    if math.isfinite(opening.radius):
        a, b = opening.radius / sides
        return np.asarray(a * b * _jinc(np.hypot(a * u, b * v)))
    found = np.zeros(u.shape, dtype=np.complex128)
    corners = opening.corners / sides
    after = np.roll(corners, -1, axis=0)
    for here, there in zip(corners, after, strict=True):
        (mx, my), (ex, ey) = 0.5 * (here + there), there - here
        # The outward normal times the length is (ey, -ex).
        found += (u * ey - v * ex) * np.sinc(u * ex + v * ey) * np.exp(-2j * np.pi * (u * mx + v * my))
    return np.asarray(found / (-2j * np.pi * (u * u + v * v)))


def _jinc(r: Floats) -> Floats:
    """J1(2 pi r) / r, by Bessel's integral at many points and straight lines between them."""
    points = np.linspace(0.0, max(float(r.max()), 1.0), 1 << 14)
    nodes = max(32, int(2.0 * np.pi * points[-1]) + 32)
    angle = (np.arange(nodes) + 0.5) * (np.pi / nodes)
    bessel = np.zeros(len(points))
    for a in angle:
        bessel += np.cos(a - 2.0 * np.pi * points * math.sin(a)) / nodes
    values = np.divide(bessel, points, out=np.full(len(points), np.pi), where=points > 0)
    return np.asarray(np.interp(r, points, values))


def _edges(opening: Opening, around: Floats | None, sides: Floats) -> Floats:
    """The edges beyond the disc; see `FarField`. Light outside an opening is deflected at its edges as light inside."""
    if math.isfinite(opening.radius):
        # Of an ellipse, in units of the box: one edge, as long as its circumference, in all directions alike.
        a, b = opening.radius / sides
        found = [(math.pi * math.sqrt(2.0 * (a * a + b * b)), 0.0, 0.0, 0.0, 1.0, 0.0)]
    else:
        found = [(length, *normal, length, 1.0, 0.0) for length, normal in _sides(opening.corners / sides)]
    rows = np.array(found)
    if around is not None:
        rows[:, 0] *= 2.0
        rows[:, 5] = 0.5
        rows = np.concatenate([rows, [(l, *normal, l, 0.0, 1.0) for l, normal in _sides(around / sides)]])
    rows[:, 0] = np.cumsum(rows[:, 0]) / rows[:, 0].sum()
    return rows


def _sides(corners: Floats) -> list[tuple[float, tuple[float, float]]]:
    """Length and outward normal of each side of a polygon."""
    lengths = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    return [(float(l), (float(x), float(y))) for l, (x, y, _) in zip(lengths, polygon_edges(corners), strict=True)]


def _spread() -> Floats:
    """Places of equal shares under sinc^2."""
    x = np.linspace(-_WIDE, _WIDE, int(_WIDE) * 128 + 1)
    density = np.sinc(x) ** 2
    shares = np.append(0.0, np.cumsum(0.5 * (density[1:] + density[:-1])))
    return np.asarray(np.interp(np.arange(_STEPS + 1) / _STEPS, shares / shares[-1], x))
