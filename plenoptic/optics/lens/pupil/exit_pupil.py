"""From where on a plane behind the lens light can come: bounds on the exit pupil, found by tracing.

For points at a distance rho from the axis, rays are traced in reverse through a grid of points on the
plane of the lens's last vertex, and the convex outline of those that reach the scene is kept (after
E. Hanika et al. and pbrt's RealisticCamera, Pharr, Jakob, Humphreys, 3rd ed., section 6.4.5, with polygons of
16 sides in place of boxes). The outline is widened by one step of the grid, so it is conservative: it
decides where samples are drawn, never how they are weighed.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats, read_only
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.record import FRAME, MOVED, LensRecord, lens_record
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.record import CIRCLE, FREEFORM
from plenoptic.optics.surfaces.surface import Surface

SIDES = 16
"""Sides of an outline: a circle's circumscribed 16-gon is 1.3 % larger than the circle."""

_WHOLE, _COARSE, _FINE = 128, 64, 128
_RADII = 25
_MOST_RADII = 225
_BISECTIONS = 12
_LARGEST_FRACTION = 10.0

Guess: TypeAlias = tuple[float, float, float]
"""Where light may pass the plane of the outlines: x, y and half the width of a square."""


def _rings() -> Floats:
    """Points (n, 2) near the rim of the unit disc, denser outwards: grazing light passes in crescents."""
    radius = 1.0 - np.geomspace(1e-3, 0.6, 32)
    angle = 2 * math.pi * (np.arange(160) + 0.5) / 160
    return np.stack([np.outer(radius, np.cos(angle)), np.outer(radius, np.sin(angle))], axis=-1).reshape(-1, 2)


_GRAZING = _rings()
_AZIMUTHS = 16


class PupilBounds(NamedTuple):
    """Outlines for cells whose centres lie at distances [i step, (i + 1) step] from the axis.

    An outline is a polygon on the plane of the last vertex, in axes turned so that the cell's centre
    lies on +x. It holds all rays that pass the lens from any point of the cell.
    """

    normals: Floats
    """(SIDES, 2) outward normals."""
    support: Floats
    """(n, SIDES) distances of the sides from the axis in mm; -inf where no light passes."""
    corners: Floats
    """(n, SIDES, 2) corners in mm, counter-clockwise."""
    reach: Floats
    """(n,) largest distance of an outline from the axis in mm."""
    step: float
    """Width of an interval in mm."""
    z: float
    """Plane of the outlines in the lens frame in mm."""


def normals_of(sides: int) -> Floats:
    """Unit vectors (sides, 2) in evenly spaced directions, +x first: outward normals of a polygon."""
    angle = 2 * math.pi * np.arange(sides) / sides
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def polygon_around(support: Floats) -> Floats:
    """Corners (n, 2) of a polygon whose sides have the normals `normals_of(n)` and these distances (n,) from 0."""
    normals, turn = normals_of(len(support)), 2 * math.pi / len(support)
    # A corner is where a side meets the next one, turned by `turn`: along the side from its foot.
    after, along = np.roll(support, -1), np.stack([-normals[:, 1], normals[:, 0]], axis=1)
    foot = support[:, None] * normals
    return np.asarray(foot + ((after - support * math.cos(turn)) / math.sin(turn))[:, None] * along)


def unvignetted(lens: LensRecord, origin: Floats, points: Floats, z: float) -> NDArray[np.bool_]:
    """Which of the rays from `origin` (3,) through `points` (n, 2) of the plane z leave the lens."""
    from plenoptic.core.kernels.ray_blocks import BLOCK
    from plenoptic.optics.lens.kernels.trace import fill_traced

    n = len(points)
    count = -(-n // BLOCK)
    x, y = np.zeros((2, count * BLOCK))
    x[:n], y[:n] = points[:, 0] - origin[0], points[:, 1] - origin[1]
    dz = float(z - origin[2])
    per_length = 1.0 / np.sqrt(x * x + y * y + dz * dz)
    blocks = np.empty((count, 8, BLOCK))
    blocks[:, :3] = origin[:, None]
    blocks[:, 3] = (x * per_length).reshape(count, BLOCK)
    blocks[:, 4] = (y * per_length).reshape(count, BLOCK)
    blocks[:, 5] = (dz * per_length).reshape(count, BLOCK)
    blocks[:, 6:] = 0.0
    fill_traced(blocks.reshape(-1), lens, None)
    return np.asarray(blocks[:, 7].reshape(-1)[:n] == 0)


def grid(low: Floats, high: Floats, n: int) -> tuple[Floats, float]:
    """Points of an n x n grid over a box and the diagonal of its mesh."""
    x, y = (np.linspace(low[k], high[k], n) for k in range(2))
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return points, float(np.hypot(*((high - low) / (n - 1))))


def lit_box(
    passing: Callable[[Floats], Floats], low: Floats, high: Floats, n: int, rim: tuple[Floats, Floats]
) -> tuple[Floats, Floats] | None:
    """A box around those of an n x n grid's points that `passing` keeps, wider by one step of the grid; None if dark.

    Where light reaches the border of the grid, from `low` to `high`, that grows, at most up to the box `rim`.
    """
    while True:
        points, mesh = grid(low, high, n)
        lit = passing(points)
        if not len(lit):
            return None
        found_low, found_high = lit.min(axis=0) - mesh, lit.max(axis=0) + mesh
        grow_low, grow_high = (found_low < low) & (low > rim[0]), (found_high > high) & (high < rim[1])
        if not (grow_low.any() or grow_high.any()):
            return found_low, found_high
        width = high - low
        low = np.where(grow_low, np.maximum(low - width, rim[0]), low)
        high = np.where(grow_high, np.minimum(high + width, rim[1]), high)


def _outline(lens: LensRecord, origin: Floats, z: float, guesses: list[Guess], rim: float) -> Floats:
    """Support distances of the passing points as seen from one origin, (SIDES,): -inf where all guesses are dark."""

    def passing(points: Floats) -> Floats:
        return points[unvignetted(lens, origin, points, z)]

    def passing_with_grazing(points: Floats) -> Floats:
        lit = passing(points)
        return np.concatenate([lit, grazing]) if len(lit) else lit

    grazing, corner = passing(rim * _GRAZING), np.full(2, rim)
    for x, y, half_width in guesses:
        low, high = np.array([x - half_width, y - half_width]), np.array([x + half_width, y + half_width])
        n = _WHOLE if half_width >= rim else _COARSE
        box = lit_box(passing_with_grazing, low, high, n, (-corner, corner))
        if box is not None:
            points, mesh = grid(*box, _FINE)
            lit = np.concatenate([passing(points), grazing])
            if not len(lit):
                lit, mesh = np.array(box), 0.0
            return np.asarray((lit @ normals_of(SIDES).T).max(axis=0) + mesh)
    return np.full(SIDES, -np.inf)


def outline_corners(support: Floats) -> Floats:
    """Corners (n, SIDES, 2) of polygons given by (n, SIDES) support distances: neighbouring sides intersected."""
    normals = normals_of(SIDES)
    after = np.roll(normals, -1, axis=0)
    turn = normals[:, 0] * after[:, 1] - normals[:, 1] * after[:, 0]
    next_support = np.roll(support, -1, axis=-1)
    x = (support * after[:, 1] - next_support * normals[:, 1]) / turn
    y = (next_support * normals[:, 0] - support * after[:, 0]) / turn
    return np.stack([x, y], axis=-1)


def pupil_bounds(
    lens: LensStack, *, z_plane: float, largest_radius: float, cell_radius: float, wavelength: float
) -> PupilBounds:
    """Outlines of the exit pupil for cells of a plane behind the lens; remembered for the cameras used last.

    The cells lie on the plane `z_plane` of the lens frame, up to `largest_radius` from the axis; `cell_radius` is the
    largest distance of a cell's points from its centre. In mm, the wavelength in nm.
    """
    record = lens_record(lens, wavelength, reverse=True, round_stops=True)
    points = cardinal_points(lens, wavelength)
    # Where the iris is, its image is: shifted with it, magnified.
    shift, placed = np.zeros(2), lens.stop.placement
    if placed is not None:
        shift = points.pupil_magnification * np.asarray(placed.shift)[:2]
    pupil = (points.exit_pupil, points.exit_pupil_semi_diameter, *shift.tolist())
    rear, z = rear_reach(lens, z_plane, wavelength), float(lens.vertices[-1])
    return _traced_bounds(_ByContent(record), pupil, rear, z, z_plane, largest_radius, cell_radius)


def rear_reach(lens: LensStack, z_plane: float, wavelength: float) -> tuple[float, float]:
    """How far from the axis light can cross the plane of the last vertex: (a, b) in a + b rho, in mm.

    rho is the distance from the axis of the point of the plane z_plane to which the light goes. It must cross the
    last surface inside its semi-diameter, at the rim by the sag in front of the vertex's plane or behind it; seen
    from rho, the rim is projected onto that plane.
    """
    last, z_last = lens.elements[-1], float(lens.vertices[-1])
    gap = z_plane - z_last
    if lens.model is not LensModel.EXACT:
        rows = lens_record(lens, wavelength, reverse=True, round_stops=True).rows
        stop = rows[rows["kind"] == CIRCLE][0]
        return _projected(gap, float(stop["z"]) - z_last, math.sqrt(stop["semi_diameter2"]))
    depth, reach, tilted = 0.0, last.semi_diameter, 0.0
    if isinstance(last, Surface):
        depth = float(last.sag(reach)) if last.depth is None else math.copysign(last.depth, last.radius)
        tilted += 0.0 if last.departure is None else 2.0 * last.departure.bounds(reach).height
    if last.placement is not None:
        shift, turn = np.asarray(last.placement.shift), np.asarray(last.placement.rotation)
        tilted += reach * float(np.hypot(turn[2, 0], turn[2, 1]))
        depth, reach = depth + float(shift[2]), reach + float(np.hypot(shift[0], shift[1]))
    near, far = (_projected(gap, depth + side, reach) for side in (tilted, -tilted))
    return max(near[0], far[0]), max(near[1], far[1])


def _projected(gap: float, ahead: float, reach: float) -> tuple[float, float]:
    """A disc of radius `reach`, `ahead` of the plane of outlines, as (a, b) of `rear_reach`."""
    fraction = min(gap / max(gap - ahead, 1e-3 * gap), _LARGEST_FRACTION)
    return max(fraction, 1.0) * reach, abs(1.0 - fraction)


_REMEMBERED = 64
"""Bounds of some kilobytes each; a camera in colour with tilted plates of glass needs 12."""


class _ByContent:
    """A record as a key: equal to others of the same numbers."""

    def __init__(self, lens: LensRecord) -> None:
        self.lens = lens
        self._key = tuple(None if column is None else (column.shape, column.tobytes()) for column in lens[:-1])

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _ByContent) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)


@functools.lru_cache(maxsize=_REMEMBERED)
def _traced_bounds(
    content: _ByContent,
    pupil: tuple[float, ...],
    rear: tuple[float, float],
    z: float,
    z_plane: float,
    largest_radius: float,
    cell_radius: float,
) -> PupilBounds:
    """The bounds as a function of numbers alone: those of the lenses used last are remembered.

    A pupil that moves by more than its size from one radius to the next would get outlines much too large; then
    there are more radii.
    """
    radii = _RADII
    while True:
        rho = np.linspace(0.0, largest_radius + cell_radius, radii)
        support = _all_round(content.lens, rho, pupil, z, z_plane, rear)
        if radii >= _MOST_RADII or _largest_step(support) < 0.5:
            return _widened(rho, support, cell_radius, largest_radius, z)
        radii *= 3


def _largest_step(support: Floats) -> float:
    """How far an outline's middle moves from one radius to the next, over its half width."""
    middle = np.array([_middle(row) for row in support[np.isfinite(support[:, 0])]])
    if len(middle) < 2:
        return 0.0
    # Where vignetting ends the field, outlines shrink to nothing: that is no reason for more radii.
    half_width = np.maximum(middle[1:, 2], 0.3 * middle[:, 2].max())
    return float((np.abs(np.diff(middle[:, 0])) / half_width).max())


def _all_round(
    lens: LensRecord, rho: Floats, pupil: tuple[float, ...], z: float, z_plane: float, rear: tuple[float, float]
) -> Floats:
    """Support distances as seen from all points at the distances rho, in axes turned with them.

    A centred lens looks the same from everywhere on a circle. Of a lens with elements out of place, the union of
    outlines from several azimuths is taken, and widened by what may lie between them.
    """
    if lens.frames is None and lens.departure is None:
        return _followed_outlines(lens, rho, pupil, z, z_plane, rear)
    angles = 2 * math.pi * np.arange(_AZIMUTHS) / _AZIMUTHS
    outlines = [_followed_outlines(_turned(lens, a), rho, _turned_pupil(pupil, a), z, z_plane, rear) for a in angles]
    found = np.array(outlines)
    largest = found.max(axis=0)
    smallest = np.where(np.isfinite(found), found, np.inf).min(axis=0)
    # A change like cos(azimuth) reaches at most (1 - cos(pi / n)) of its amplitude beyond the samples.
    spread = np.where(np.isfinite(largest), largest - smallest, 0.0)
    return np.asarray(largest + (1.0 - math.cos(math.pi / _AZIMUTHS)) * spread)


def _turned(lens: LensRecord, angle: float) -> LensRecord:
    """The lens turned about the axis by -angle, which is the same as looking at it from the azimuth `angle`."""
    cos, sin = math.cos(angle), math.sin(angle)
    turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    frames = np.zeros((len(lens.rows), FRAME)) if lens.frames is None else lens.frames.copy()
    for frame, row in zip(frames, lens.rows, strict=True):
        if row["kind"] == FREEFORM and not frame[MOVED]:
            frame[:9], frame[MOVED] = np.eye(3).ravel(), 1.0
        frame[:9] = (turn @ frame[:9].reshape(3, 3)).ravel()
        frame[9:12] = turn @ frame[9:12]
    return lens._replace(frames=frames)


def _turned_pupil(pupil: tuple[float, ...], angle: float) -> tuple[float, ...]:
    z, size, x, y = pupil
    cos, sin = math.cos(angle), math.sin(angle)
    return z, size, cos * x + sin * y, cos * y - sin * x


def _followed_outlines(
    lens: LensRecord, rho: Floats, pupil: tuple[float, ...], z: float, z_plane: float, rear: tuple[float, float]
) -> Floats:
    """Support distances (n, SIDES) as seen from points at the distances rho from the axis; -inf where it is dark.

    A small pupil that a grid over the whole rim would miss is looked for where the paraxial pupil lies and where it
    was heading. Beside a dark point, the outline from the end of the light is taken instead of none.
    """
    exit_pupil, semi_diameter, *across = pupil

    def outline(radius: float, heading: Guess | None) -> Floats:
        rim = 1.02 * (rear[0] + rear[1] * radius)
        guesses = [(0.0, 0.0, rim)]
        if math.isfinite(exit_pupil) and exit_pupil < z_plane:
            # The paraxial pupil as seen from the cell, on the plane of the last vertex.
            fraction = (z_plane - z) / (z_plane - exit_pupil)
            x, y = (fraction * shift for shift in across)
            guesses.append((radius * (1 - fraction) + x, y, 1.5 * fraction * semi_diameter))
        if heading is not None:
            guesses.append(heading)
        return _outline(lens, np.array([radius, 0.0, z_plane]), z, guesses, rim)

    support = np.empty((len(rho), SIDES))
    centre, heading = None, None
    for i, radius in enumerate(rho):
        support[i] = outline(radius, heading)
        if np.isfinite(support[i, 0]):
            x, y, half_width = _middle(support[i])
            step = 0.0 if centre is None else x - centre
            centre, heading = x, (x + step, y, 3 * half_width + abs(step))
        elif centre is not None:
            lit, dark = rho[i - 1], radius
            support[i] = support[i - 1]
            for _ in range(_BISECTIONS):
                between = 0.5 * (lit + dark)
                x, y, half_width = _middle(support[i])
                found = outline(between, (x, y, 4 * half_width))
                if np.isfinite(found[0]):
                    lit, support[i] = between, found
                else:
                    dark = between
            centre, heading = None, None
    return support


def _middle(support: Floats) -> Guess:
    """Middle and half width of an outline."""
    left, right, up, down = -support[SIDES // 2], support[0], support[SIDES // 4], -support[3 * SIDES // 4]
    return 0.5 * float(left + right), 0.5 * float(up + down), 0.5 * float(max(right - left, up - down))


def _widened(rho: Floats, support: Floats, cell_radius: float, largest_radius: float, z: float) -> PupilBounds:
    """Union of the outlines of all points of a cell, for intervals of the distance of its centre."""
    normals = normals_of(SIDES)
    bins, spacing = len(rho) - 1, rho[1] - rho[0]
    step = largest_radius / bins if largest_radius > 0 else 1.0
    lit = np.isfinite(support[:, 0])
    corners = outline_corners(np.where(lit[:, None], support, 0.0))
    wide = np.full((bins, SIDES), -np.inf)
    for b in range(bins):
        low, high = b * step - cell_radius, (b + 1) * step + cell_radius
        near = lit & (rho >= low - spacing) & (rho <= high + spacing)
        if not near.any():
            continue
        turn = math.pi if b * step <= cell_radius else math.asin(cell_radius / (b * step))
        for angle in np.linspace(-turn, turn, 16 if turn > 0.3 else 3):
            rotation = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
            reached = corners[near].reshape(-1, 2) @ rotation.T @ normals.T
            wide[b] = np.maximum(wide[b], reached.max(axis=0))
    outline = outline_corners(np.where(np.isfinite(wide), wide, 0.0))
    reach = np.where(np.isfinite(wide[:, 0]), np.linalg.norm(outline, axis=-1).max(axis=-1), 0.0)
    return PupilBounds(read_only(normals), read_only(wide), read_only(outline), read_only(reach), step, z)
