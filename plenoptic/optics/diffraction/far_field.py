"""Far-field diffraction patterns of openings, as tables from which deflections of rays are sampled.

The pattern of a uniformly and incoherently lit opening A is |F(nu)|^2 / area, F its Fourier transform, over spatial
frequencies nu in cycles/mm: a ray of wavelength lambda is deflected by lambda nu in direction cosines (J. W. Goodman,
Introduction to Fourier Optics, section 4.4). Within `_INNER` periods of the opening's bounding box the pattern is
tabulated. Beyond, where edges diffract independently, it is sampled in closed form, to infinity: an edge of length l
with the normal n sends light along n, with the density l / (4 pi^2 a^2) at the distance a, and a profile sinc^2(l b)
across.
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
"""Radius of the tabulated disc, in periods of the bounding box of the opening, and cells of the table for each period.
The cells lower the contrast by less than 0.1 % at half the cut-off frequency."""
_SUBSAMPLES = 2
"""Samples along a side of a cell, for the mean over it."""
_WIDE, _STEPS = 64.0, 4096
"""Half width of the table of sinc^2, and its steps."""


class FarField(NamedTuple):
    """Far-field pattern for sampling. Frequencies are in periods of the bounding box of the opening."""

    rows: Floats
    """(n + 1,) cumulative probabilities of the rows of cells, up to that of the disc."""
    columns: Floats
    """(n, n + 1) cumulative probabilities of the cells of each row, up to 1."""
    step: float
    """Side of a cell."""
    edges: Floats
    """(k, 6): cumulative probabilities of the edges beyond the disc, their normals (x, y), lengths, and the weights of
    paths through the opening and through the gap around it. A circle is one edge of length 0."""
    sinc2_quantiles: Floats
    """(s,) quantiles of sinc^2 at probabilities i / (s - 1), from -_WIDE to _WIDE."""
    radius: float
    """Radius of the disc."""
    scale: Floats
    """(2, 2) transform from periods to cycles/mm along x and y."""
    opening: Floats | None
    """(n, n) fraction of the light of each cell that passed the opening, over the opening's fraction of the area; None
    if gaps are opaque."""
    opening_fraction: float
    """Area of the opening over that of opening and gap."""


def far_field(opening: Opening, cell: Floats | None, turn: Floats) -> FarField:
    """Pattern of an opening and, if gaps are clear, of the gap between it and the polygon `cell`.

    `turn` (2, 2) is the rotation from the axes of the opening to those of the deflections.
    """
    sides = np.abs(opening.corners if cell is None else cell).max(axis=0) * 2.0
    if math.isfinite(opening.radius) and cell is None:
        sides = np.full(2, 2.0 * opening.radius)
    n = int(2 * _INNER * _CELLS)
    step = 1.0 / _CELLS
    axis = (np.arange(n * _SUBSAMPLES) + 0.5) * (step / _SUBSAMPLES) - _INNER
    u, v = np.meshgrid(axis, axis)
    parts = [_transform(opening, sides, u, v)]
    areas = [_area(opening) / float(sides.prod())]
    if cell is not None:
        whole = Opening(cell)
        parts.append(_transform(whole, sides, u, v) - parts[0])
        areas.append(_area(whole) / float(sides.prod()) - areas[0])
    light = [_cells(np.abs(part) ** 2, n) * step**2 / sum(areas) for part in parts]
    middle = (np.arange(n) + 0.5) * step - _INNER
    inside = np.hypot(*np.meshgrid(middle, middle)) < _INNER
    total, opening_fraction = np.where(inside, sum(light), 0.0), areas[0] / sum(areas)
    rows = total.sum(axis=1)
    columns = np.cumsum(total, axis=1) / np.where(rows > 0, rows, 1.0)[:, None]
    edges = _edges(opening, cell, sides)
    if cell is not None:
        # Light through the opening and light through the gap add up to their fractions of the area.
        weights = np.diff(edges[:, 0], prepend=0.0)
        for column, fraction, lit in ((4, opening_fraction, light[0]), (5, 1.0 - opening_fraction, light[1])):
            beyond = max(fraction - float(lit[inside].sum()), 0.0) / (1.0 - rows.sum())
            edges[:, column] *= beyond / fraction / (weights @ edges[:, column])
    return FarField(
        rows=np.append(0.0, np.cumsum(rows)),
        columns=np.column_stack([np.zeros(n), columns]),
        step=step,
        edges=edges,
        sinc2_quantiles=_sinc2_quantiles(),
        radius=_INNER,
        scale=np.ascontiguousarray(turn @ np.diag(1.0 / sides)),
        opening=None if cell is None else light[0] / sum(light) / opening_fraction,
        opening_fraction=opening_fraction,
    )


def remove_cells(field: FarField, cells: NDArray[np.bool_]) -> tuple[FarField, float]:
    """The pattern without some cells (n, n) of its table, and the fraction of the light that remains."""
    light = np.diff(field.columns, axis=1) * np.diff(field.rows)[:, None]
    remaining = np.where(cells, 0.0, light)
    fraction = 1.0 - float(light[cells].sum())
    rows = remaining.sum(axis=1)
    columns = np.cumsum(remaining, axis=1) / np.where(rows > 0, rows, 1.0)[:, None]
    return (
        field._replace(
            rows=np.append(0.0, np.cumsum(rows)) / fraction, columns=np.column_stack([np.zeros(len(rows)), columns])
        ),
        fraction,
    )


def _area(opening: Opening) -> float:
    return math.pi * opening.radius**2 if math.isfinite(opening.radius) else polygon_area(opening.corners)


def _cells(fine: Floats, n: int) -> Floats:
    return np.asarray(fine.reshape(n, _SUBSAMPLES, n, _SUBSAMPLES).mean(axis=(1, 3)))


def _transform(opening: Opening, sides: Floats, u: Floats, v: Floats) -> Floats:
    """Fourier transform of an opening in units of a box's sides at frequencies u, v; real for round openings."""
    if math.isfinite(opening.radius):
        a, b = opening.radius / sides
        return np.asarray(a * b * _jinc(np.hypot(a * u, b * v)))
    transform = np.zeros(u.shape, dtype=np.complex128)
    corners = opening.corners / sides
    following = np.roll(corners, -1, axis=0)
    for start, end in zip(corners, following, strict=True):
        (mx, my), (ex, ey) = 0.5 * (start + end), end - start
        # The outward normal times the length is (ey, -ex).
        transform += (u * ey - v * ex) * np.sinc(u * ex + v * ey) * np.exp(-2j * np.pi * (u * mx + v * my))
    return np.asarray(transform / (-2j * np.pi * (u * u + v * v)))


def _jinc(r: Floats) -> Floats:
    """J1(2 pi r) / r, from Bessel's integral at many points with linear interpolation."""
    points = np.linspace(0.0, max(float(r.max()), 1.0), 1 << 14)
    nodes = max(32, int(2.0 * np.pi * points[-1]) + 32)
    angle = (np.arange(nodes) + 0.5) * (np.pi / nodes)
    bessel = np.zeros(len(points))
    for a in angle:
        bessel += np.cos(a - 2.0 * np.pi * points * math.sin(a)) / nodes
    values = np.divide(bessel, points, out=np.full(len(points), np.pi), where=points > 0)
    return np.asarray(np.interp(r, points, values))


def _edges(opening: Opening, cell: Floats | None, sides: Floats) -> Floats:
    """Rows of the edges for light beyond the disc; see `FarField`. The gap diffracts at the opening's edges, too."""
    if math.isfinite(opening.radius):
        # An ellipse in units of the box: one isotropic edge, as long as its circumference.
        a, b = opening.radius / sides
        entries = [(math.pi * math.sqrt(2.0 * (a * a + b * b)), 0.0, 0.0, 0.0, 1.0, 0.0)]
    else:
        entries = [(length, *normal, length, 1.0, 0.0) for length, normal in _sides(opening.corners / sides)]
    rows = np.array(entries)
    if cell is not None:
        rows[:, 0] *= 2.0
        rows[:, 5] = 0.5
        rows = np.concatenate([rows, [(l, *normal, l, 0.0, 1.0) for l, normal in _sides(cell / sides)]])
    rows[:, 0] = np.cumsum(rows[:, 0]) / rows[:, 0].sum()
    return rows


def _sides(corners: Floats) -> list[tuple[float, tuple[float, float]]]:
    """Length and outward normal of each side of a polygon."""
    lengths = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    return [(float(l), (float(x), float(y))) for l, (x, y, _) in zip(lengths, polygon_edges(corners), strict=True)]


def _sinc2_quantiles() -> Floats:
    """Quantiles of sinc^2 at equal steps of probability."""
    x = np.linspace(-_WIDE, _WIDE, int(_WIDE) * 128 + 1)
    density = np.sinc(x) ** 2
    cumulative = np.append(0.0, np.cumsum(0.5 * (density[1:] + density[:-1])))
    return np.asarray(np.interp(np.arange(_STEPS + 1) / _STEPS, cumulative / cumulative[-1], x))
