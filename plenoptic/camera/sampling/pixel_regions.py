"""Aperture regions: the part of the microlens plane that illuminates each pixel."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.diffraction import BendRecord
from plenoptic.camera.record import CameraRecord
from plenoptic.camera.sampling.record import (
    CANDIDATE,
    NEAR,
    PIECE,
    PLANE,
    SIDE,
    VIEW,
    Around,
    Candidates,
    FedPixels,
    Regions,
    SpreadTable,
)
from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, STATUS
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.record import MOVED
from plenoptic.optics.microlens.microlens_record import MICROLENS

_TOGETHER = 512
"""Candidates whose rays are traced together."""
_BESIDE = NEAR // SIDE + 1
"""Groups on each side of the sensor."""
_PASSES, _SLACK = 4, 2e-3
"""Times that a candidate is looked at, and how large margins may be, in parts of what they bound."""


def pixel_centres(camera: CameraRecord, rows: tuple[int, int], columns: tuple[int, int]) -> Floats:
    """(n, 2): centres of the pixels of a rectangle (first and end row and column), row by row: local x and y in mm."""
    row, column = np.meshgrid(np.arange(*rows) + 0.5, np.arange(*columns) + 0.5, indexing="ij")
    return _on_sensor(camera, row.ravel(), column.ravel())


def _on_sensor(camera: CameraRecord, row: Floats, column: Floats) -> Floats:
    """(n, 2): points of the sensor, given in rows and columns from its corner: local x and y in mm."""
    sensor, placed = camera.sensor, camera.parts.sensor_to_local
    on_sensor = np.stack([-(column - sensor.columns / 2), row - sensor.rows / 2], axis=-1) * sensor.pitch
    return _rotate(on_sensor, placed.turn[:2, :2]) + placed.shift[:2]


def _rotate(points: Floats, matrix: Floats) -> Floats:
    """Points (n, 2) under a matrix. Products of matrices would round otherwise for one point than for many."""
    return np.stack([points[:, 0] * row[0] + points[:, 1] * row[1] for row in matrix], axis=-1)


MOST_CELLS = 100_000
"""Microlenses that may feed one pixel; beyond it, a render would not end."""


def cells_per_pixel(camera: CameraRecord) -> float:
    """About how many microlenses are looked at for each pixel, at least 1; an InvalidValueError for far too many."""
    count = _cells(camera)
    if count > MOST_CELLS:
        raise InvalidValueError(
            f"each pixel sees about {count:.3g} microlenses, and the limit is {MOST_CELLS}; their pitch is too small, "
            "or their images overlap too much: check the units, close the stop or reduce microlenses_to_sensor"
        )
    return count


def _cells(camera: CameraRecord) -> float:
    """About how many microlenses see a pixel, at most."""
    array, pupil = camera.array, camera.pupil
    if array is None:
        return 1.0
    distance = camera.z_plane - pupil.z
    ratio = distance / camera.sensor.plane.distance
    bend = 0.0 if pupil.pinhole else float(np.abs(1.0 + ratio - distance * array.lattice.powers).max())
    reach = float(pupil.reach.max()) + pupil.margin + bend * array.opening.radius
    search = (reach + ratio * camera.sensor.pitch) / (1.0 + ratio) + array.opening.radius
    area, listed = abs(float(np.linalg.det(array.lattice.basis))), array.lens_table
    if listed is not None:
        area = float(listed.bins.width**2 * (len(listed.bins.first) - 1) / max(len(listed.lenses), 1))
    return 1.0 + float(np.pi * search**2 / area)


class _Half(NamedTuple):
    """Half sides of a group of pixels in local x and y, and its view."""

    x: float
    y: float
    rays: int
    slack: float


def _group(camera: CameraRecord, starts: Floats) -> tuple[Floats, NDArray[np.int64]]:
    """Centres (g, 2) of the groups of pixels in which points of the sensor (n, 2) lie, and which is whose (n,)."""
    sensor, placed = camera.sensor, camera.parts.sensor_to_local
    back = np.asarray(np.linalg.inv(placed.turn[:2, :2]), dtype=np.float64)
    on_sensor = _rotate(starts - placed.shift[:2], back) / sensor.pitch
    column = np.floor((sensor.columns / 2 - on_sensor[:, 0]) / SIDE).astype(np.int64)
    row = np.floor((on_sensor[:, 1] + sensor.rows / 2) / SIDE).astype(np.int64)
    across = sensor.columns // SIDE + 2 * _BESIDE
    number, group = np.unique((row + _BESIDE) * across + column + _BESIDE, return_inverse=True)
    row, column = (part - _BESIDE + 0.5 for part in np.divmod(number, across))
    return _on_sensor(camera, row * SIDE, column * SIDE), np.ascontiguousarray(group.ravel())


def _candidates(camera: CameraRecord, centres: Floats, margin: float) -> tuple[Candidates, Floats]:
    """Candidates for the microlenses of groups, by the bounds on the pupil, and the corners of their polygons."""
    from plenoptic.camera.sampling.kernels import candidates

    array, plane, used = camera.array, camera.sensor.plane, np.zeros(2, dtype=np.int64)
    first, room, ends = np.zeros(len(centres) + 1, dtype=np.int64), 4 * len(centres) + 4, 64 * len(centres) + 64
    while True:
        details = np.empty(room, MICROLENS) if array is not None and array.differs else None
        candidates_of_groups, corners = Candidates(first, np.empty(room, CANDIDATE), details), np.empty((2, ends))
        if array is None:
            candidates.fill_pupil(candidates_of_groups, corners, used, centres, camera.pupil)
        else:
            candidates.fill_cells(candidates_of_groups, corners, used, centres, margin, plane, array, camera.pupil)
        if used[0] <= room and used[1] <= ends:
            return candidates_of_groups._replace(rows=candidates_of_groups.rows[: used[0]]), corners
        room, ends = max(room, used[0]), max(ends, used[1])


def _met(camera: CameraRecord, blocks: Floats, waves: NDArray[np.int64] | None) -> Floats:
    """(elements, 3, rays): where rays between array and lens meet its elements, in their axes, and if not, why."""
    from plenoptic.optics.lens.kernels.trace import fill_traced

    fields = blocks.reshape(-1, 8, BLOCK)
    hits = np.empty((len(camera.openings.elements), 3, len(fields), BLOCK))
    for at, element in zip(hits, camera.openings.elements, strict=True):
        fill_traced(blocks, element, waves)
        at[0], at[1], at[2] = fields[:, 0], fields[:, 1], fields[:, STATUS // BLOCK]
        if element.frames is not None and element.frames[0, MOVED] != 0:
            frame = element.frames[0]
            x, y, z = at[0] - frame[9], at[1] - frame[10], fields[:, 2] - element.rows[0]["z"] - frame[11]
            at[0] = frame[0] * x + frame[3] * y + frame[6] * z
            at[1] = frame[1] * x + frame[4] * y + frame[7] * z
    return hits.reshape(len(hits), 3, -1)


def _views(camera: CameraRecord, found: Candidates, corners: Floats, centres: Floats, half: _Half) -> NDArray[np.void]:
    """Linear views of the openings of the lens by candidates; each candidate keeps the index of its views."""
    from plenoptic.camera.sampling.kernels import views as kernels
    from plenoptic.camera.sampling.kernels.pixel_regions import MOST_PIECES, fill_boxes
    from plenoptic.camera.sampling.through_array import fill_through_array

    group, openings = np.repeat(np.arange(len(centres)), np.diff(found.first)), camera.openings
    left = np.flatnonzero((np.diff(found.first)[group] <= MOST_PIECES) & (found.rows["parted"] == 0))
    views, used = np.empty(4 * len(centres) + 64, VIEW), 0
    for _ in range(_PASSES):
        again = [left[:0]]
        for start in range(0, max(len(left), 1), _TOGETHER):
            chosen = left[start : start + _TOGETHER].copy()
            rays = half.rays * len(chosen)
            blocks = np.empty(-(-rays // BLOCK) * RAY)
            lenslets, waves = camera.own(blocks.size // 8), None
            if camera.dispersed is not None and camera.dispersed.index_ratios is not None:
                last = camera.dispersed.index_ratios.shape[1] - 1
                waves = np.zeros(blocks.size // 8, dtype=np.int64)
                waves[:rays].reshape(-1, half.rays)[:] = np.repeat([last // 2, 0, last], half.rays // 3)
            kernels.fill_view_rays(blocks, lenslets, found, chosen, centres[group[chosen]], half)
            fill_through_array(blocks, lenslets, camera, waves)
            kernels.fill_reopened(blocks)
            points = _met(camera, blocks, waves)
            while (end := kernels.fill_views(views, used, found, chosen, points, openings, half)) > len(views):
                views = np.concatenate([views, np.empty(end, VIEW)])
            used = end
            again.append(chosen[: fill_boxes(found, chosen, corners, views, openings.edges, half)])
        left = np.concatenate(again)
        if not left.size:
            break
    return views


def feeding_regions(
    camera: CameraRecord, starts: Floats, half: tuple[float, float] = (0.0, 0.0), *, certain: bool = False
) -> Regions:
    """Aperture regions of points of the sensor (n, 2) and of their surroundings of `half` mm in x and y; see
    `cells_per_pixel`.

    The points lie in pixels, with their surroundings. `certain`: whether unvignetted cores are sought.
    """
    from plenoptic.camera.sampling.kernels import pixel_regions
    from plenoptic.camera.sampling.kernels.views import RAYS

    cells_per_pixel(camera)
    if certain or camera.exact:
        centres, group = _group(camera, starts)
        turn = camera.parts.sensor_to_local.turn
        sides = 0.5 * SIDE * camera.sensor.pitch * np.abs(turn[:2, :2]).sum(axis=1)
        colours = 1 if camera.dispersed is None else 3
        size = _Half(float(sides[0]), float(sides[1]), RAYS * colours, _SLACK)
        chosen, corners = _candidates(camera, centres, float(np.hypot(*sides)))
        views = _views(camera, chosen, corners, centres, size)
    else:
        centres, group, views = starts, np.arange(len(starts)), np.empty(1, VIEW)
        chosen, corners = _candidates(camera, centres, float(np.hypot(*half)))
    view = views, camera.openings.edges, centres, certain
    first, used = np.zeros(len(starts) + 1, dtype=np.int64), np.zeros(3, dtype=np.int64)
    room, ends, planes = (k * len(starts) + 64 for k in (2, 16, 4))
    while True:
        details = None if chosen.details is None else np.empty(room, MICROLENS)
        regions = Regions(np.empty(room, PIECE), first, np.empty((2, ends)), np.empty(planes, PLANE), details)
        pixel_regions.fill_regions(regions, used, starts, group, chosen, corners, view, half)
        if used[0] <= room and used[1] <= ends and used[2] <= planes:
            return regions
        room, ends, planes = max(room, used[0]), max(ends, used[1]), max(planes, used[2])


def fed_pixels(camera: CameraRecord, pixels: Floats, number: NDArray[np.int64], *, certain: bool = False) -> FedPixels:
    """Aperture regions of pixels with given centres (n, 2) and numbers (n,) on the sensor; see `feeding_regions`."""
    if camera.bend is not None:
        return _bent_pixels(camera, camera.bend, pixels, number, certain=certain)
    regions = feeding_regions(camera, pixels, camera.sensor.pixel.half, certain=certain)
    fed = np.flatnonzero(np.diff(regions.first))
    first = np.append(regions.first[fed], regions.first[-1])
    regions, open_part = regions._replace(first=first), camera.sensor.pixel
    return FedPixels(fed, number[fed], np.ascontiguousarray(pixels[fed]), regions, open_part, certain)


def _bent_pixels(
    camera: CameraRecord, bend: BendRecord, pixels: Floats, number: NDArray[np.int64], *, certain: bool
) -> FedPixels:
    """Illuminated pixels with diffraction: all pixels, and the aperture regions of those around them."""
    sensor, reach = camera.sensor, 0 if camera.spread is None else camera.spread.table.reach
    right, down = (bend.back @ (pixels - bend.shift).T)[:2]
    rows_columns = np.floor(np.column_stack([sensor.rows / 2 + down, sensor.columns / 2 - right])).astype(np.int64)
    low = rows_columns.min(axis=0, initial=sensor.rows + sensor.columns) - NEAR
    high = rows_columns.max(axis=0, initial=0) + NEAR + 1
    grid = np.full(np.maximum(high - low, 0), -1, dtype=np.int32)
    at = tuple((rows_columns - low).T)
    row, column = at
    grid[at] = np.arange(len(pixels))
    for steps in (reach, NEAR):
        new = np.nonzero(_widen(grid >= 0, steps) & (grid < 0))
        grid[new] = len(row) + np.arange(len(new[0]))
        if steps == reach:
            sharing = len(row) + len(new[0])
        row, column = np.append(row, new[0]), np.append(column, new[1])
    centres = _on_sensor(camera, low[0] + row + 0.5, low[1] + column + 0.5)
    regions = feeding_regions(camera, centres, sensor.whole.half, certain=certain)
    areas, last = np.zeros(grid.shape), regions.first[1:] - 1
    lit = np.diff(regions.first) > 0
    areas[row[lit], column[lit]] = regions.pieces["area"][last[lit]]
    along = np.arange(-reach, reach + 1)
    down, across = (part.ravel() for part in np.meshgrid(along, along, indexing="ij"))
    ring = _numbers(camera, low[0] + row[len(pixels) : sharing], low[1] + column[len(pixels) : sharing])
    neighbours = Around(
        own=rows_columns,
        corner=(int(low[0]), int(low[1])),
        grid=grid,
        numbers=np.append(number, ring),
        givers=grid[at[0][:, None] - down, at[1][:, None] + across].astype(np.int64),
        centres=centres,
        areas=_widen(areas, NEAR)[at],
        shape=(sensor.rows, sensor.columns),
        plane=sensor.plane,
        bend=bend,
    )
    place, centres = np.arange(len(pixels)), np.ascontiguousarray(pixels)
    return FedPixels(place, number, centres, regions, sensor.pixel, certain, neighbours)


def _numbers(camera: CameraRecord, row: NDArray[np.int64], column: NDArray[np.int64]) -> NDArray[np.int64]:
    """Numbers of pixels on the sensor; beyond the last of these, of those up to `NEAR` rows and columns outside it."""
    rows, columns = camera.sensor.rows, camera.sensor.columns
    on = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    outside = rows * columns + (row + NEAR) * (columns + 2 * NEAR) + column + NEAR
    return np.where(on, row * columns + column, outside)


def sharing_pixels(camera: CameraRecord, fed: FedPixels, spread: SpreadTable) -> tuple[FedPixels, FedPixels]:
    """Pixels from which diffraction can carry light into those of a tile: the tile's own, and those around it.

    Places are those of `Around.givers`.
    """
    assert fed.around is not None
    first, inner, end = fed.regions.first, len(fed.place), len(fed.around.numbers)
    parts = []
    for low, high in ((0, inner), (inner, end)):
        lit = low + np.flatnonzero(np.diff(first[low : high + 1]))
        regions = fed.regions._replace(first=np.append(first[lit], first[high]))
        centres, numbers = fed.around.centres[lit], fed.around.numbers[lit]
        parts.append(FedPixels(lit, numbers, centres, regions, camera.sensor.whole, fed.certain, spread=spread))
    return parts[0], parts[1]


def _widen(image: NDArray[Any], steps: int) -> NDArray[Any]:
    """The largest value of an image among those up to some rows and columns away."""
    for axis in range(2):
        before, image = image, image.copy()
        for step in range(1, steps + 1):
            near, far = (slice(None),) * axis + (slice(step, None),), (slice(None),) * axis + (slice(None, -step),)
            image[near] = np.maximum(image[near], before[far])
            image[far] = np.maximum(image[far], before[near])
    return image
