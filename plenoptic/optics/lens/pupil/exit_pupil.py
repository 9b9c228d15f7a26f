"""Bounds of the exit pupil on the plane of the last vertex, by ray tracing.

For points at a distance rho from the axis, rays are traced in reverse through a grid of points on the plane of the last
vertex. The convex outline of those that reach the scene is stored (after E. Hanika et al. and pbrt's RealisticCamera,
Pharr, Jakob, Humphreys, 3rd ed., section 6.4.5, with polygons of 16 sides in place of boxes). The outline is widened by
one step of the grid, so it is conservative. It is a sampling region and does not affect the weights of samples.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats, read_only
from plenoptic.optics.element_record import CIRCLE, FREEFORM
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points
from plenoptic.optics.lens.lens_record import FRAME, MOVED, LensRecord, lens_record
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.pupil.outline import (
    DARK,
    SIDES,
    Guess,
    Outline,
    PupilRays,
    light_outline,
    normals_of,
    polygon_around,
    up_to_stops,
)
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.surfaces.surface import Surface

_WHOLE, _COARSE, _FINE = 128, 64, 128
_RADII = 25
_MOST_RADII = 225
_BISECTIONS = 12
_LARGEST_FRACTION = 10.0
_AZIMUTHS = 16


def _rings() -> Floats:
    """Points (n, 2) near the rim of the unit disc, denser outwards: grazing light passes in crescents."""
    radius = 1.0 - np.geomspace(1e-3, 0.6, 32)
    angle = 2 * math.pi * (np.arange(160) + 0.5) / 160
    return np.stack([np.outer(radius, np.cos(angle)), np.outer(radius, np.sin(angle))], axis=-1).reshape(-1, 2)


_GRAZING = _rings()

Place: TypeAlias = tuple[float, float, float]
"""Square on the plane of the outlines: x and y of its centre, and half its width, in mm."""


class PupilBounds(NamedTuple):
    """Outlines for cells whose centres lie at distances [i step, (i + 1) step] from the axis.

    An outline is a polygon on the plane of the last vertex, in axes turned so that the cell's centre
    lies on +x. It holds all rays that pass the lens from any point of the cell.
    """

    normals: Floats
    """(SIDES, 2) outward normals."""
    support: Floats
    """(n, SIDES) distances of the sides from the axis in mm; -inf if no light passes."""
    corners: Floats
    """(n, SIDES, 2) corners in mm, counter-clockwise."""
    reach: Floats
    """(n,) largest distance of an outline from the axis in mm."""
    parted: NDArray[np.bool_]
    """(n,) True if the pupil has several parts; the outline is their convex hull."""
    step: float
    """Width of an interval in mm."""
    z: float
    """z of the plane of the outlines in the lens frame in mm."""


def pupil_bounds(
    lens: LensStack, *, z_plane: float, largest_radius: float, cell_radius: float, wavelength: float
) -> PupilBounds:
    """Outlines of the exit pupil for cells of a plane behind the lens; the results of the latest calls are cached.

    The cells lie on the plane `z_plane` of the lens frame, up to `largest_radius` from the axis; `cell_radius` is the
    largest distance of a cell's points from its centre. Lengths are in mm, the wavelength in nm.
    """
    record = lens_record(lens, wavelength, reverse=True, round_stops=True)
    points = cardinal_points(lens, wavelength)
    # A shift of the iris shifts its image by the magnification.
    shift, placed = np.zeros(2), lens.stop.placement
    if placed is not None:
        shift = points.pupil_magnification * placed.shift[:2]
    pupil = (points.exit_pupil, points.exit_pupil_semi_diameter, *shift.tolist())
    rear, z = rear_reach(lens, z_plane, wavelength), float(lens.vertices[-1])
    return _traced_bounds(_ByContent(record), pupil, rear, z, z_plane, largest_radius, cell_radius)


def rear_reach(lens: LensStack, z_plane: float, wavelength: float) -> tuple[float, float]:
    """Bound a + b rho, in mm, of the height of rays on the plane of the last vertex: (a, b).

    rho is the distance from the axis of the ray's target point on the plane z_plane. The ray intersects the last
    surface inside its semi-diameter. The rim, displaced from the vertex plane by its sag, is projected from the target
    onto it.
    """
    last, z_last = lens.elements[-1], float(lens.vertices[-1])
    gap = z_plane - z_last
    if lens.model is not LensModel.EXACT:
        rows = lens_record(lens, wavelength, reverse=True, round_stops=True).rows
        stop = rows[rows["kind"] == CIRCLE][0]
        return _project(gap, float(stop["z"]) - z_last, math.sqrt(stop["semi_diameter2"]))
    depth, reach, tilted = 0.0, last.semi_diameter, 0.0
    if isinstance(last, Surface):
        last = last.from_behind
        depth = float(last.sag(reach)) if last.depth is None else math.copysign(last.depth, last.radius)
        tilted += 0.0 if last.freeform is None else 2.0 * last.freeform.bounds(reach).height
    if last.placement is not None:
        shift, turn = last.placement.shift, last.placement.rotation
        tilted += reach * float(np.hypot(turn[2, 0], turn[2, 1]))
        depth, reach = depth + float(shift[2]), reach + float(np.hypot(shift[0], shift[1]))
    near, far = (_project(gap, depth + side, reach) for side in (tilted, -tilted))
    return max(near[0], far[0]), max(near[1], far[1])


def _project(gap: float, ahead: float, reach: float) -> tuple[float, float]:
    """A disc of radius `reach`, `ahead` of the plane of outlines, as (a, b) of `rear_reach`."""
    fraction = min(gap / max(gap - ahead, 1e-3 * gap), _LARGEST_FRACTION)
    return max(fraction, 1.0) * reach, abs(1.0 - fraction)


_REMEMBERED = 64
"""Number of cached bounds, of some kilobytes each; a colour camera with tilted glass plates needs 12."""


class _ByContent:
    """Lens record as a cache key: equal to another one with the same arrays, its losses apart."""

    def __init__(self, lens: LensRecord) -> None:
        self.lens = lens
        self._key = tuple(None if column is None else (column.shape, column.tobytes()) for column in lens[:-2])

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
    """Bounds as a cached function of numbers.

    A pupil that moves by more than its size from one radius to the next would have outlines much too large; the number
    of radii is then increased.
    """
    radii = _RADII
    while True:
        rho = np.linspace(0.0, largest_radius + cell_radius, radii)
        support, parted = _all_round(content.lens, rho, pupil, z, z_plane, rear)
        if radii >= _MOST_RADII or _largest_step(support) < 0.5:
            return _widen(rho, support, parted, cell_radius, largest_radius, z)
        radii *= 3


def _largest_step(support: Floats) -> float:
    """Largest displacement of an outline's centre from one radius to the next, over its half width."""
    middle = np.array([_middle(row) for row in support[np.isfinite(support[:, 0])]])
    if len(middle) < 2:
        return 0.0
    # At the edge of the field, vignetting shrinks outlines to 0, which needs no further radii.
    half_width = np.maximum(middle[1:, 2], 0.3 * middle[:, 2].max())
    return float((np.abs(np.diff(middle[:, 0])) / half_width).max())


def _all_round(
    lens: LensRecord, rho: Floats, pupil: tuple[float, ...], z: float, z_plane: float, rear: tuple[float, float]
) -> tuple[Floats, NDArray[np.bool_]]:
    """Support distances for points at the distances rho, in axes rotated to them; True for outlines of several parts.

    A centred lens has one outline for all azimuths. For decentred or tilted elements, the result is the union of
    outlines at several azimuths, widened by a bound for those in between.
    """
    if lens.frames is None and lens.freeform is None:
        return _followed_outlines(lens, rho, pupil, z, z_plane, rear)
    angles = 2 * math.pi * np.arange(_AZIMUTHS) / _AZIMUTHS
    (exit_pupil, size, x, y), outlines = pupil, []
    for angle in angles:
        cos, sin = math.cos(angle), math.sin(angle)
        turned = (exit_pupil, size, cos * x + sin * y, cos * y - sin * x)
        outlines.append(_followed_outlines(_rotate(lens, angle), rho, turned, z, z_plane, rear))
    supports = np.array([support for support, _ in outlines])
    largest = supports.max(axis=0)
    smallest = np.where(np.isfinite(supports), supports, np.inf).min(axis=0)
    # A variation as cos(azimuth) exceeds the samples by at most (1 - cos(pi / n)) of its amplitude.
    spread = np.where(np.isfinite(largest), largest - smallest, 0.0)
    parted = np.any([parts for _, parts in outlines], axis=0)
    return np.asarray(largest + (1.0 - math.cos(math.pi / _AZIMUTHS)) * spread), parted


def _rotate(lens: LensRecord, angle: float) -> LensRecord:
    """Rotate a lens about the axis by -angle, which is equivalent to an observer at the azimuth `angle`."""
    cos, sin = math.cos(angle), math.sin(angle)
    turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    frames = np.zeros((len(lens.rows), FRAME)) if lens.frames is None else lens.frames.copy()
    for frame, row in zip(frames, lens.rows, strict=True):
        if row["kind"] == FREEFORM and not frame[MOVED]:
            frame[:9], frame[MOVED] = np.eye(3).ravel(), 1.0
        frame[:9] = (turn @ frame[:9].reshape(3, 3)).ravel()
        frame[9:12] = turn @ frame[9:12]
    return lens._replace(frames=frames)


def _followed_outlines(
    lens: LensRecord, rho: Floats, pupil: tuple[float, ...], z: float, z_plane: float, rear: tuple[float, float]
) -> tuple[Floats, NDArray[np.bool_]]:
    """Support distances (n, SIDES) for points at the distances rho from the axis; True for outlines of several parts.

    A grid over the whole rim may miss a small pupil. Further grids lie around the paraxial pupil, and around a position
    extrapolated from the last two radii. Next to a dark point, the outline at the edge of the field is used.
    """
    exit_pupil, semi_diameter, *across = pupil
    parts = up_to_stops(lens)

    def outline_at(radius: float, predicted: Place | None) -> Outline:
        reach = 1.02 * (rear[0] + rear[1] * radius)
        rays, grazing = PupilRays(parts, np.array([radius, 0.0, z_plane]), z), reach * _GRAZING
        rim = _square((0.0, 0.0, reach), _WHOLE)
        guesses = [rim]
        if math.isfinite(exit_pupil) and exit_pupil != z_plane:
            # The paraxial pupil projected from the cell onto the plane of the last vertex.
            fraction = (z_plane - z) / (z_plane - exit_pupil)
            x, y = (fraction * shift for shift in across)
            guesses.append(_square((radius * (1 - fraction) + x, y, 1.5 * abs(fraction) * semi_diameter), _COARSE))
        if predicted is not None:
            guesses.append(_square(predicted, _COARSE))
        return light_outline(rays._replace(lit=grazing[rays.fates(grazing).code == 0]), guesses, rim, _FINE)

    outlines: list[Outline] = []
    centre, predicted = None, None
    for i, radius in enumerate(rho):
        outline = outline_at(radius, predicted)
        if outline is not DARK:
            x, y, half_width = _middle(outline.support)
            step = 0.0 if centre is None else x - centre
            centre, predicted = x, (x + step, y, 3 * half_width + abs(step))
        elif centre is not None:
            outline, lit, dark = outlines[-1], rho[i - 1], radius
            for _ in range(_BISECTIONS):
                between = 0.5 * (lit + dark)
                x, y, half_width = _middle(outline.support)
                middle_outline = outline_at(between, (x, y, 4 * half_width))
                if middle_outline is DARK:
                    dark = between
                else:
                    lit, outline = between, middle_outline
            centre, predicted = None, None
        outlines.append(outline)
    return np.array([outline.support for outline in outlines]), np.array([outline.parted for outline in outlines])


def _square(place: Place, rays: int) -> Guess:
    x, y, half_width = place
    return Guess(np.array([x - half_width, y - half_width]), np.array([x + half_width, y + half_width]), rays)


def _middle(support: Floats) -> Place:
    """Centre and half width of an outline."""
    left, right, up, down = -support[SIDES // 2], support[0], support[SIDES // 4], -support[3 * SIDES // 4]
    return 0.5 * float(left + right), 0.5 * float(up + down), 0.5 * float(max(right - left, up - down))


def _widen(
    rho: Floats, support: Floats, parted: NDArray[np.bool_], cell_radius: float, largest_radius: float, z: float
) -> PupilBounds:
    """Union of the outlines of all points of a cell, for intervals of the distance of its centre from the axis."""
    normals = normals_of(SIDES)
    bins, spacing = len(rho) - 1, rho[1] - rho[0]
    step = largest_radius / bins if largest_radius > 0 else 1.0
    lit = np.isfinite(support[:, 0])
    corners = polygon_around(np.where(lit[:, None], support, 0.0))
    wide, several = np.full((bins, SIDES), -np.inf), np.zeros(bins, dtype=np.bool_)
    for b in range(bins):
        low, high = b * step - cell_radius, (b + 1) * step + cell_radius
        near = lit & (rho >= low - spacing) & (rho <= high + spacing)
        if not near.any():
            continue
        several[b] = parted[near].any()
        turn = math.pi if b * step <= cell_radius else math.asin(cell_radius / (b * step))
        for angle in np.linspace(-turn, turn, 16 if turn > 0.3 else 3):
            rotation = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
            reached = corners[near].reshape(-1, 2) @ rotation.T @ normals.T
            wide[b] = np.maximum(wide[b], reached.max(axis=0))
    outline = polygon_around(np.where(np.isfinite(wide), wide, 0.0))
    reach = np.where(np.isfinite(wide[:, 0]), np.linalg.norm(outline, axis=-1).max(axis=-1), 0.0)
    arrays = read_only(normals), read_only(wide), read_only(outline), read_only(reach), read_only(several)
    return PupilBounds(*arrays, step, z)
