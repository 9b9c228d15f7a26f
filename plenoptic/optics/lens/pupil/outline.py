"""The rays of one point that pass a lens: a convex outline around them, found by tracing grids of rays.

Whoever asks where light passes, before the lens or behind it, asks here. Light may pass in several parts. One that is
thinner than the grid is wide lies between neighbours that are lost in different ways, such as at the stop and by total
reflection: there it is looked for.
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
"""Sides of an outline: a circle's circumscribed 16-gon is 1.3 % larger than the circle."""

_HALVINGS = 8
"""Between neighbours on a grid parts are found that are wider than a 250th of its step."""
_LINES = 4
"""Of a grid that looks for light at all, every fourth line is looked at so closely."""
_TIP = 2.0
"""Steps of a grid by which the pointed end of a part may lie outside of what the grid finds of it."""
_HOLES = 0.02
"""Dark points between lit ones, in parts of the lit ones, from which on light passes in several parts."""


def normals_of(sides: int) -> Floats:
    """Unit vectors (sides, 2) in evenly spaced directions, +x first: outward normals of a polygon."""
    angle = 2 * math.pi * np.arange(sides) / sides
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def polygon_around(support: Floats) -> Floats:
    """Corners (..., n, 2) of polygons whose sides have the normals `normals_of(n)` and distances (..., n) from 0."""
    normals = normals_of(support.shape[-1])
    # A corner is where a side meets the next one.
    after, next_support = np.roll(normals, -1, axis=0), np.roll(support, -1, axis=-1)
    turn = normals[:, 0] * after[:, 1] - normals[:, 1] * after[:, 0]
    x = (support * after[:, 1] - next_support * normals[:, 1]) / turn
    y = (next_support * normals[:, 0] - support * after[:, 0]) / turn
    return np.stack([x, y], axis=-1)


class Fates(NamedTuple):
    """Fates of rays; arrays of any shape."""

    code: Floats
    """0 for those that pass, see `ray_blocks`."""
    x: Floats
    y: Floats
    """Where a stop ends others, from its centre, in its semi-diameter; 0 for all else."""

    def of(self, chosen: Any) -> Fates:
        """Some of them."""
        return Fates(self.code[chosen], self.x[chosen], self.y[chosen])

    def apart(self, others: Fates) -> NDArray[np.bool_]:
        """True where light may pass between lost rays: lost by different causes, or on two sides of a stop."""
        x, y, dx, dy = self.x, self.y, others.x - self.x, others.y - self.y
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            # The nearest that the straight line between both comes to the centre.
            parameter = np.clip(-(x * dx + y * dy) / (dx * dx + dy * dy), 0.0, 1.0)
            across = (x != 0.0) & ((x + parameter * dx) ** 2 + (y + parameter * dy) ** 2 < 1.0)
        lost = (self.code != 0) & (others.code != 0)
        return np.asarray(lost & ((self.code != others.code) | across))


def up_to_stops(lens: LensRecord) -> tuple[LensRecord, ...]:
    """A lens with round stops in parts, each but the last one up to a stop."""
    ends = np.flatnonzero(lens.rows["kind"] == CIRCLE) + 1
    ends = np.unique([0, *ends, len(lens.rows)]).tolist()
    return tuple(lens.part(first, end) for first, end in itertools.pairwise(ends))


class PupilRays(NamedTuple):
    """Rays of one point."""

    lens: tuple[LensRecord, ...]
    """See `up_to_stops`."""
    origin: Floats
    """(3,) in mm."""
    z: float
    """The plane on which they are told apart by their points, in mm."""
    lit: Floats = np.empty((0, 2))
    """(k, 2) points through which light passes."""

    def fates(self, points: Floats) -> Fates:
        """Fates of the rays through points (n, 2)."""
        from plenoptic.core.kernels.ray_blocks import BLOCK, CAUSES, CLIPPED
        from plenoptic.optics.lens.kernels.trace import fill_traced

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
            fill_traced(blocks.reshape(-1), part, None)
            last, centre = part.rows[-1], (0.0, 0.0) if part.frames is None else part.frames[-1, 9:11]
            if last["kind"] == CIRCLE:
                code = CAUSES * (last["surface_index"] + 1.0) + CLIPPED
                stopped = blocks[:, 7].reshape(-1)[:n] == code
                for k in range(2):
                    place = (blocks[:, k].reshape(-1)[:n] - centre[k]) / math.sqrt(last["semi_diameter2"])
                    places[k] = np.where(stopped, place, places[k])
        return Fates(blocks[:, 7].reshape(-1)[:n], *places)


class Guess(NamedTuple):
    """Search region of the light: a box, and the number of rays along a side of its grid."""

    low: Floats
    high: Floats
    rays: int


class Outline(NamedTuple):
    """A convex polygon that holds all points through which light passes."""

    support: Floats
    """(SIDES,) distances of its sides from 0; -inf in the dark."""
    parted: bool
    """Whether light passes in several parts."""


DARK = Outline(np.full(SIDES, -np.inf), False)


class _Lit(NamedTuple):
    """Passing part of a grid."""

    points: Floats
    """(m, 2): the ends of its rows."""
    between: Floats
    """(k, 2): points between its rays, and those given."""
    mesh: float
    """The diagonal of a mesh of the grid."""
    thin: bool
    """Whether light passes between neighbours that are lost."""
    parted: bool
    """Whether light passes in several parts."""

    @property
    def all(self) -> Floats:
        return np.concatenate([self.points, self.between])


def light_outline(rays: PupilRays, guesses: list[Guess], rim: Guess, fine: int) -> Outline:
    """Outline of the passing light, wider by a step of a grid of `fine` x `fine` rays over the light.

    The guesses are looked at one after the other, and after the first light only those whose middle is outside of it: a
    small part may lie between the rays of a grid over the whole `rim`. Light between the rays of a grid alone comes
    last, since a smaller grid may have more of it.
    """
    outline, late = DARK, []
    for guess in guesses:
        if np.all(normals_of(SIDES) @ (0.5 * (guess.low + guess.high)) <= outline.support):
            continue
        lit = _grown(rays, guess, rim)
        if len(lit.points):
            outline = _with(outline, rays, lit, fine)
        elif lit.thin:
            late.append(lit)
    for lit in late:
        outline = _with(outline, rays, lit, fine)
    return outline


def _with(found: Outline, rays: PupilRays, lit: _Lit, fine: int) -> Outline:
    """Outline that also holds the points found by a grid."""
    normals = normals_of(SIDES)
    if not (lit.all @ normals.T > found.support).any():
        return found
    # Ends of a thin part may lie between the lines that were looked at closely.
    lines, margin = (1, _LINES * lit.mesh) if lit.thin or lit.parted else (None, lit.mesh)
    low, high = lit.all.min(axis=0) - margin, lit.all.max(axis=0) + margin
    inside = _lit(rays, Guess(low, high, fine), lines)
    points, mesh = inside.all, inside.mesh
    if not len(points):
        points, mesh = np.array([low, [low[0], high[1]], high, [high[0], low[1]]]), 0.0
    support = np.maximum(found.support, (points @ normals.T).max(axis=0) + mesh)
    return Outline(support, lit.parted or inside.parted or found is not DARK)


def _grown(rays: PupilRays, guess: Guess, rim: Guess) -> _Lit:
    """Passing part of a grid that grows where light reaches its border, at most up to the box `rim`."""
    low, high = guess.low, guess.high
    while True:
        lit = _lit(rays, Guess(low, high, guess.rays), _LINES)
        if not len(lit.all):
            return lit
        left, right = lit.all.min(axis=0) - lit.mesh, lit.all.max(axis=0) + lit.mesh
        grow_low, grow_high = (left < low) & (low > rim.low), (right > high) & (high < rim.high)
        if not (grow_low.any() or grow_high.any()):
            return lit
        width = high - low
        low = np.where(grow_low, np.maximum(low - width, rim.low), low)
        high = np.where(grow_high, np.minimum(high + width, rim.high), high)


def _lit(rays: PupilRays, box: Guess, lines: int | None) -> _Lit:
    """Passing part of a grid over a box, and between its neighbours on every `lines`-th line; None: on no line."""
    n = box.rays
    x, y = (np.linspace(box.low[k], box.high[k], n) for k in range(2))
    points = np.stack(np.meshgrid(x, y), axis=-1)
    columns = rays.fates(points.reshape(-1, 2))
    fates = Fates(*(column.reshape(n, n) for column in columns))
    passes = fates.code == 0
    mesh = float(np.hypot(*((box.high - box.low) / (n - 1))))
    ends = passes.copy()
    ends[:, 1:-1] &= ~(passes[:, :-2] & passes[:, 2:])
    lit, between = points[ends], np.empty((0, 2)) if lines is None else _between(rays, points, fates, lines)
    between = between[_beyond(between, lit, mesh)]
    thin = len(between) > 0
    if thin or len(lit):
        between = np.concatenate([between, rays.lit])
    parted = max(_span(passes), _span(passes.T)) > (1.0 + _HOLES) * np.count_nonzero(passes)
    return _Lit(lit, between, mesh, thin, bool(parted or _beyond(between, lit, _TIP * mesh).any()))


def _beyond(points: Floats, lit: Floats, by: float) -> NDArray[np.bool_]:
    """True for points (n, 2) outside of others (m, 2) by more than a distance."""
    if not len(points) or not len(lit):
        return np.ones(len(points), dtype=np.bool_)
    normals = normals_of(SIDES)
    return np.asarray((points @ normals.T > (lit @ normals.T).max(axis=0) + by).any(axis=1))


def _span(passes: NDArray[np.bool_]) -> int:
    """Number of points of a grid between the first and the last passing one of their row, these included."""
    lit = passes[passes.any(axis=1)]
    return int((lit.shape[1] - lit.argmax(axis=1) - lit[:, ::-1].argmax(axis=1)).sum())


def _between(rays: PupilRays, points: Floats, fates: Fates, lines: int) -> Floats:
    """Points (m, 2) that pass between neighbours on every so many lines of a grid of points (n, n, 2)."""
    pairs = []
    for before, after in ((np.s_[:-1, ::lines], np.s_[1:, ::lines]), (np.s_[::lines, :-1], np.s_[::lines, 1:])):
        differ = fates.of(before).apart(fates.of(after))
        pairs.append((points[before][differ], points[after][differ], *(part[before][differ] for part in fates)))
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
