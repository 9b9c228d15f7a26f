"""The rays of one point that pass a lens: a convex outline around them, found by tracing grids of rays.

Whoever asks where light passes, before the lens or behind it, asks here. Light may pass in several parts. One that is
thinner than the grid is wide lies between neighbours that are lost in different ways, such as at the stop and by total
reflection: there it is looked for.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats
from plenoptic.optics.lens.record import LensRecord

SIDES = 16
"""Sides of an outline: a circle's circumscribed 16-gon is 1.3 % larger than the circle."""

_HALVINGS = 10
"""Between neighbours on a grid parts are found that are wider than a thousandth of its step."""
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


class Sight(NamedTuple):
    """Rays of one point."""

    lens: LensRecord
    origin: Floats
    """(3,) in mm."""
    z: float
    """The plane on which they are told apart by their points, in mm."""
    known: Floats = np.empty((0, 2))
    """(k, 2) points through which light is known to pass."""

    def fates(self, points: Floats) -> Floats:
        """What becomes of the rays through points (n, 2): 0 for those that pass, see `ray_blocks`."""
        from plenoptic.core.kernels.ray_blocks import BLOCK
        from plenoptic.optics.lens.kernels.trace import fill_traced

        n = len(points)
        count = -(-n // BLOCK)
        x, y = np.zeros((2, count * BLOCK))
        x[:n], y[:n] = points[:, 0] - self.origin[0], points[:, 1] - self.origin[1]
        dz = float(self.z - self.origin[2])
        per_length = 1.0 / np.sqrt(x * x + y * y + dz * dz)
        blocks = np.empty((count, 8, BLOCK))
        blocks[:, :3] = self.origin[:, None]
        blocks[:, 3] = (x * per_length).reshape(count, BLOCK)
        blocks[:, 4] = (y * per_length).reshape(count, BLOCK)
        blocks[:, 5] = (dz * per_length).reshape(count, BLOCK)
        blocks[:, 6:] = 0.0
        fill_traced(blocks.reshape(-1), self.lens, None)
        return np.asarray(blocks[:, 7].reshape(-1)[:n])


class Guess(NamedTuple):
    """Where light may pass: a box, and rays along a side of the grid that looks for it there."""

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
    """What of a grid passes."""

    points: Floats
    """(m, 2): the ends of its rows, and what lies between neighbours."""
    mesh: float
    """The diagonal of a mesh of the grid."""
    thin: bool
    """Whether light passes between neighbours on the grid that are lost."""
    parted: bool
    """Whether light passes in several parts."""


def outlined(sight: Sight, guesses: list[Guess], rim: Guess, fine: int) -> Outline:
    """The outline of what passes, wider by a step of a grid of `fine` x `fine` rays over the light.

    The guesses are looked at one after the other, and after the first light only those whose middle is outside of it:
    a small part may lie between the rays of a grid over the whole `rim`.
    """
    found, normals = DARK, normals_of(SIDES)
    for guess in guesses:
        if np.all(normals @ (0.5 * (guess.low + guess.high)) <= found.support):
            continue
        lit = _grown(sight, guess, rim)
        if not (len(lit.points) and (lit.points @ normals.T > found.support).any()):
            continue
        # Ends of a thin part may lie between the lines that were looked at closely.
        lines, beside = (1, _LINES * lit.mesh) if lit.thin or lit.parted else (_LINES, lit.mesh)
        low, high = lit.points.min(axis=0) - beside, lit.points.max(axis=0) + beside
        inside = _lit(sight, Guess(low, high, fine), lines)
        points, mesh = inside.points, inside.mesh
        if not len(points):
            points, mesh = np.array([low, [low[0], high[1]], high, [high[0], low[1]]]), 0.0
        support = np.maximum(found.support, (points @ normals.T).max(axis=0) + mesh)
        found = Outline(support, lit.parted or inside.parted or found is not DARK)
    return found


def _grown(sight: Sight, guess: Guess, rim: Guess) -> _Lit:
    """What passes of a grid that grows where light reaches its border, at most up to the box `rim`."""
    low, high = guess.low, guess.high
    while True:
        lit = _lit(sight, Guess(low, high, guess.rays), _LINES)
        if not len(lit.points):
            return lit
        left, right = lit.points.min(axis=0) - lit.mesh, lit.points.max(axis=0) + lit.mesh
        grow_low, grow_high = (left < low) & (low > rim.low), (right > high) & (high < rim.high)
        if not (grow_low.any() or grow_high.any()):
            return lit
        width = high - low
        low = np.where(grow_low, np.maximum(low - width, rim.low), low)
        high = np.where(grow_high, np.minimum(high + width, rim.high), high)


def _lit(sight: Sight, box: Guess, lines: int) -> _Lit:
    """What passes of a grid over a box, and between its neighbours on every so many lines."""
    n = box.rays
    x, y = (np.linspace(box.low[k], box.high[k], n) for k in range(2))
    points = np.stack(np.meshgrid(x, y), axis=-1)
    fates = sight.fates(points.reshape(-1, 2)).reshape(n, n)
    passes = fates == 0
    pairs = []
    for axis in range(2):
        place, line = np.swapaxes(points, 0, axis)[:, ::lines], np.swapaxes(fates, 0, axis)[:, ::lines]
        apart = (line[1:] != line[:-1]) & (line[1:] != 0) & (line[:-1] != 0)
        pairs.append((place[:-1][apart], place[1:][apart], line[:-1][apart]))
    beside = _between(sight, *(np.concatenate(parts) for parts in zip(*pairs, strict=True)))
    thin = len(beside) > 0
    if thin or passes.any():
        beside = np.concatenate([beside, sight.known])
    mesh = float(np.hypot(*((box.high - box.low) / (n - 1))))
    ends = passes.copy()
    ends[:, 1:-1] &= ~(passes[:, :-2] & passes[:, 2:])
    count = np.count_nonzero(passes)
    parted = max(_spanned(passes), _spanned(passes.T)) > (1.0 + _HOLES) * count
    return _Lit(np.concatenate([points[ends], beside]), mesh, thin, parted or _is_apart(beside, points[ends], mesh))


def _is_apart(points: Floats, lit: Floats, mesh: float) -> bool:
    """Whether points (n, 2) are more than the pointed ends of what a grid has found, (m, 2)."""
    if not len(points) or not len(lit):
        return len(points) > 0
    normals = normals_of(SIDES)
    return bool((points @ normals.T > (lit @ normals.T).max(axis=0) + _TIP * mesh).any())


def _spanned(passes: NDArray[np.bool_]) -> int:
    """How many points of a grid lie between the first and the last of their row that passes, these included."""
    lit = passes[passes.any(axis=1)]
    return int((lit.shape[1] - lit.argmax(axis=1) - lit[:, ::-1].argmax(axis=1)).sum())


def _between(sight: Sight, first: Floats, last: Floats, fate: Floats) -> Floats:
    """Points (m, 2) that pass between pairs of points (n, 2), of which the first ones have the fates (n,)."""
    lit = [np.empty((0, 2))]
    for _ in range(_HALVINGS if len(first) else 0):
        middle = 0.5 * (first + last)
        met = sight.fates(middle)
        lit.append(middle[met == 0])
        alike = (met == fate)[:, None]
        first, last = np.where(alike, middle, first), np.where(alike, last, middle)
    return np.concatenate(lit)
