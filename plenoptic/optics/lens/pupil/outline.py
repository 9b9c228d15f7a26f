"""Convex outline of the pupil seen from one point, from grids of traced rays.

The point lies in object space or in image space. The pupil may have several parts. A thin part lies between
neighbouring rays that are lost by different causes, such as the stop and total reflection; these gaps are searched.
"""

from __future__ import annotations

import itertools
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats
from plenoptic.optics.element_record import CIRCLE
from plenoptic.optics.lens.lens_record import LensRecord

SIDES = 16
"""Sides of an outline; around a circle a 16-gon is 1.3 % larger than the circle."""

_HALVINGS = 8
"""Points of the search between two neighbours of a grid: it finds parts wider than a 250th of the step."""
_LINES = 4
"""Line interval of that search while no light has been found: every fourth line of the grid."""
_TIP = 2.0
"""Grid steps by which the pointed end of a part may lie outside its points on the grid."""
_HOLES = 0.02
"""Fraction of dark points between lit points, relative to the lit ones, above which the pupil has several parts."""


def normals_of(sides: int) -> Floats:
    """Unit vectors (sides, 2) in evenly spaced directions, +x first: outward normals of a polygon."""
    angle = 2 * math.pi * np.arange(sides) / sides
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def polygon_around(support: Floats) -> Floats:
    """Corners (..., n, 2) of polygons whose sides have the normals `normals_of(n)` and distances (..., n) from 0."""
    normals = normals_of(support.shape[-1])
    # A corner is the intersection of a side with the next one.
    after, next_support = np.roll(normals, -1, axis=0), np.roll(support, -1, axis=-1)
    turn = normals[:, 0] * after[:, 1] - normals[:, 1] * after[:, 0]
    x = (support * after[:, 1] - next_support * normals[:, 1]) / turn
    y = (next_support * normals[:, 0] - support * after[:, 0]) / turn
    return np.stack([x, y], axis=-1)


class Fates(NamedTuple):
    """Fates of rays; arrays of any shape."""

    code: Floats
    """Status codes, 0 for transmitted rays; see `ray_blocks`."""
    x: Floats
    y: Floats
    """Points at which stops clip rays, from the centre of the stop, in units of its semi-diameter; 0 for all other
    rays."""

    def of(self, chosen: Any) -> Fates:
        """Fates of the rays `chosen` by an index or a mask."""
        return Fates(self.code[chosen], self.x[chosen], self.y[chosen])

    def apart(self, others: Fates) -> NDArray[np.bool_]:
        """True if light may pass between two lost rays: they have different causes of loss, or lie on two sides of a
        stop.
        """
        x, y, dx, dy = self.x, self.y, others.x - self.x, others.y - self.y
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            # Smallest distance from the centre to the straight line between both points.
            parameter = np.clip(-(x * dx + y * dy) / (dx * dx + dy * dy), 0.0, 1.0)
            across = (x != 0.0) & ((x + parameter * dx) ** 2 + (y + parameter * dy) ** 2 < 1.0)
        lost = (self.code != 0) & (others.code != 0)
        return np.asarray(lost & ((self.code != others.code) | across))


def up_to_stops(lens: LensRecord) -> tuple[LensRecord, ...]:
    """Split a lens with round stops into parts, each except the last one ending at a stop."""
    ends = np.flatnonzero(lens.rows["kind"] == CIRCLE) + 1
    ends = np.unique([0, *ends, len(lens.rows)]).tolist()
    return tuple(lens.part(first, end) for first, end in itertools.pairwise(ends))


class PupilRays(NamedTuple):
    """Rays through one point, parametrised by their points on a plane."""

    lens: tuple[LensRecord, ...]
    """See `up_to_stops`."""
    origin: Floats
    """Point (3,) in mm."""
    z: float
    """z in mm of the parametrisation plane."""
    lit: Floats = np.empty((0, 2))
    """(k, 2) points on the plane with known transmitted rays."""

    def fates(self, points: Floats) -> Fates:
        """Fates of the rays through points (n, 2)."""
        from plenoptic.core.kernels.ray_blocks import BLOCK, CAUSES, CLIPPED
        from plenoptic.optics.lens.kernels.trace import fill_through_lens

        n = len(points)
        count = -(-n // BLOCK)
        x, y = np.zeros((2, count * BLOCK))
        x[:n], y[:n] = points[:, 0] - self.origin[0], points[:, 1] - self.origin[1]
        dz = float(self.z - self.origin[2])
        per_length = 1.0 / np.sqrt(x * x + y * y + dz * dz)
        blocks, places = np.empty((count, 8, BLOCK)), np.zeros((2, n))
        blocks[:, :3] = self.origin[:, None]
        blocks[:, 3] = (x * per_length).reshape(count, BLOCK)
        blocks[:, 4] = (y * per_length).reshape(count, BLOCK)
        blocks[:, 5] = (dz * per_length).reshape(count, BLOCK)
        blocks[:, 6:] = 0.0
        for part in self.lens:
            fill_through_lens(blocks.reshape(-1), part, None)
            last, centre = part.rows[-1], (0.0, 0.0) if part.frames is None else part.frames[-1, 9:11]
            if last["kind"] == CIRCLE:
                code = CAUSES * (last["surface_index"] + 1.0) + CLIPPED
                stopped = blocks[:, 7].reshape(-1)[:n] == code
                for k in range(2):
                    point = (blocks[:, k].reshape(-1)[:n] - centre[k]) / math.sqrt(last["semi_diameter2"])
                    places[k] = np.where(stopped, point, places[k])
        return Fates(blocks[:, 7].reshape(-1)[:n], *places)


class Guess(NamedTuple):
    """Search region for transmitted rays: a box, and the number of rays along a side of its grid."""

    low: Floats
    high: Floats
    rays: int


class Outline(NamedTuple):
    """Convex polygon around all points of transmitted rays."""

    support: Floats
    """(SIDES,) distances of its sides from 0; -inf if dark."""
    parted: bool
    """True if the pupil has several parts."""


DARK = Outline(np.full(SIDES, -np.inf), False)


class _GridLight(NamedTuple):
    """Transmitted rays of a search grid."""

    points: Floats
    """(m, 2): ends of the lit rows of the grid."""
    between: Floats
    """(k, 2): lit points between the rays of the grid, and `PupilRays.lit`."""
    mesh: float
    """Diagonal of a cell of the grid in mm."""
    thin: bool
    """True if light passes between lost neighbours."""
    parted: bool
    """True if the pupil has several parts."""

    @property
    def all(self) -> Floats:
        return np.concatenate([self.points, self.between])


def light_outline(rays: PupilRays, guesses: list[Guess], rim: Guess, fine: int) -> Outline:
    """Outline of the transmitted light, widened by a step of a grid of `fine` x `fine` rays over it.

    The guesses are searched in order; once light is found, only those with their centre outside of it. They find small
    parts between the rays of a grid over the whole `rim`. A guess with light only between its rays is used last, since
    a smaller grid may find more.
    """
    outline, late = DARK, []
    for guess in guesses:
        if np.all(normals_of(SIDES) @ (0.5 * (guess.low + guess.high)) <= outline.support):
            continue
        lit = _trace_growing_grid(rays, guess, rim)
        if len(lit.points):
            outline = _extend(outline, rays, lit, fine)
        elif lit.thin:
            late.append(lit)
    for lit in late:
        outline = _extend(outline, rays, lit, fine)
    return outline


def _extend(outline: Outline, rays: PupilRays, lit: _GridLight, fine: int) -> Outline:
    """Extend an outline to the transmitted rays of a grid."""
    normals = normals_of(SIDES)
    if not (lit.all @ normals.T > outline.support).any():
        return outline
    # Ends of a thin part may lie between the lines with a close search.
    lines, margin = (1, _LINES * lit.mesh) if lit.thin or lit.parted else (None, lit.mesh)
    low, high = lit.all.min(axis=0) - margin, lit.all.max(axis=0) + margin
    inside = _trace_grid(rays, Guess(low, high, fine), lines)
    points, mesh = inside.all, inside.mesh
    if not len(points):
        points, mesh = np.array([low, [low[0], high[1]], high, [high[0], low[1]]]), 0.0
    support = np.maximum(outline.support, (points @ normals.T).max(axis=0) + mesh)
    return Outline(support, lit.parted or inside.parted or outline is not DARK)


def _trace_growing_grid(rays: PupilRays, guess: Guess, rim: Guess) -> _GridLight:
    """Transmitted rays of a grid that grows where light reaches its border, at most up to the box `rim`."""
    low, high = guess.low, guess.high
    while True:
        lit = _trace_grid(rays, Guess(low, high, guess.rays), _LINES)
        if not len(lit.all):
            return lit
        left, right = lit.all.min(axis=0) - lit.mesh, lit.all.max(axis=0) + lit.mesh
        grow_low, grow_high = (left < low) & (low > rim.low), (right > high) & (high < rim.high)
        if not (grow_low.any() or grow_high.any()):
            return lit
        width = high - low
        low = np.where(grow_low, np.maximum(low - width, rim.low), low)
        high = np.where(grow_high, np.minimum(high + width, rim.high), high)


def _trace_grid(rays: PupilRays, box: Guess, lines: int | None) -> _GridLight:
    """Transmitted rays of a grid over a box, and between neighbours on every `lines`-th line; None: on no line."""
    n = box.rays
    x, y = (np.linspace(box.low[k], box.high[k], n) for k in range(2))
    points = np.stack(np.meshgrid(x, y), axis=-1)
    columns = rays.fates(points.reshape(-1, 2))
    fates = Fates(*(column.reshape(n, n) for column in columns))
    passes = fates.code == 0
    mesh = float(np.hypot(*((box.high - box.low) / (n - 1))))
    ends = passes.copy()
    ends[:, 1:-1] &= ~(passes[:, :-2] & passes[:, 2:])
    lit, between = points[ends], np.empty((0, 2)) if lines is None else _search_between(rays, points, fates, lines)
    between = between[_is_outside(between, lit, mesh)]
    thin = len(between) > 0
    if thin or len(lit):
        between = np.concatenate([between, rays.lit])
    parted = max(_span(passes), _span(passes.T)) > (1.0 + _HOLES) * np.count_nonzero(passes)
    return _GridLight(lit, between, mesh, thin, bool(parted or _is_outside(between, lit, _TIP * mesh).any()))


def _is_outside(points: Floats, lit: Floats, by: float) -> NDArray[np.bool_]:
    """True for points (n, 2) at more than a distance outside the bounding polygon of others (m, 2)."""
    if not len(points) or not len(lit):
        return np.ones(len(points), dtype=np.bool_)
    normals = normals_of(SIDES)
    return np.asarray((points @ normals.T > (lit @ normals.T).max(axis=0) + by).any(axis=1))


def _span(passes: NDArray[np.bool_]) -> int:
    """Number of points of a grid from the first to the last transmitted one of each row, both included."""
    lit = passes[passes.any(axis=1)]
    return int((lit.shape[1] - lit.argmax(axis=1) - lit[:, ::-1].argmax(axis=1)).sum())


def _search_between(rays: PupilRays, points: Floats, fates: Fates, lines: int) -> Floats:
    """Transmitted points (m, 2) between neighbours on every `lines`-th line of a grid of points (n, n, 2)."""
    pairs = []
    for before, after in ((np.s_[:-1, ::lines], np.s_[1:, ::lines]), (np.s_[::lines, :-1], np.s_[::lines, 1:])):
        separate = fates.of(before).apart(fates.of(after))
        pairs.append((points[before][separate], points[after][separate], *(part[before][separate] for part in fates)))
    first, last, *begin = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    fates = Fates(*begin)
    lit = [np.empty((0, 2))]
    for _ in range(_HALVINGS if len(first) else 0):
        middle = 0.5 * (first + last)
        halfway = rays.fates(middle)
        lit.append(middle[halfway.code == 0])
        nearer = (halfway.code == 0) | fates.apart(halfway)
        first, last = np.where(nearer[:, None], first, middle), np.where(nearer[:, None], middle, last)
        fates = Fates(*(np.where(nearer, before, new) for before, new in zip(fates, halfway, strict=True)))
    return np.concatenate(lit)
