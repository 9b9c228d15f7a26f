"""Aperture regions: the part of the microlens plane that illuminates each pixel.

The steps are functions of this module: *groups* of pixels; *candidates*, the microlenses that may illuminate a group,
by bounds on the pupil; *linear ray transfers* from a group through a candidate to the elements of the lens; and the
*pieces* of each pixel's region, polygons and the planes that clip them, from transfers and the openings of elements.
Where bounds on the pupil suffice, each pixel is a group, and its candidates are the pieces.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.camera_record import CameraRecord
from plenoptic.camera.diffraction import DeflectionRecord
from plenoptic.camera.sampling.sampling_records import (
    CANDIDATE,
    FAR,
    GROUP_SIDE,
    MAX_NEAR,
    NEAR,
    PIECE,
    PLANE,
    RAY_TRANSFER,
    Candidates,
    IlluminatedPixels,
    KernelTable,
    Regions,
    SourcePixels,
)
from plenoptic.core.kernels.ray_blocks import BLOCK, OUTSIDE_MICROLENS, RAY, STATUS
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.lens_record import MOVED
from plenoptic.optics.microlens.microlens_record import MICROLENS, WellsRecord

_TOGETHER = 512
"""Candidates whose rays are traced together."""
_BORDER = MAX_NEAR // GROUP_SIDE + 1
"""Groups on each side of the sensor."""
_PASSES = 4
"""Most fits of a candidate's ray transfers."""


def pixel_centres(camera: CameraRecord, rows: tuple[int, int], columns: tuple[int, int]) -> Floats:
    """Centres (n, 2) of the pixels of a rectangle (first and end row and column), row by row: local x and y in mm."""
    row, column = np.meshgrid(np.arange(*rows) + 0.5, np.arange(*columns) + 0.5, indexing="ij")
    return _sensor_points(camera, row.ravel(), column.ravel())


def _sensor_points(camera: CameraRecord, row: Floats, column: Floats) -> Floats:
    """Local x and y (n, 2) in mm of sensor points, given in rows and columns from the sensor's corner."""
    sensor, placement = camera.sensor, camera.parts.sensor_to_local
    on_sensor = np.stack([-(column - sensor.columns / 2), row - sensor.rows / 2], axis=-1) * sensor.pitch
    return _rotate(on_sensor, placement.turn[:2, :2]) + placement.shift[:2]


def _rotate(points: Floats, matrix: Floats) -> Floats:
    """Multiply points (n, 2) by a matrix. Matrix products would round differently for one point than for many."""
    return np.stack([points[:, 0] * row[0] + points[:, 1] * row[1] for row in matrix], axis=-1)


MAX_CELLS = 100_000
"""Most microlenses that may illuminate one pixel; with more, a render would not end."""


def cells_per_pixel(camera: CameraRecord) -> float:
    """Approximate upper bound on the number of microlenses tested for each pixel, at least 1.

    Raises an InvalidValueError above `MAX_CELLS`.
    """
    array, pupil = camera.array, camera.pupil
    if array is None:
        return 1.0
    distance = camera.parts.z_plane - pupil.z
    ratio = distance / camera.sensor.plane.distance
    height_factor = 0.0 if pupil.pinhole else float(np.abs(1.0 + ratio - distance * array.lattice.powers).max())
    reach = float(pupil.reach.max()) + pupil.margin + height_factor * array.opening.radius
    search = (reach + ratio * camera.sensor.pitch) / (1.0 + ratio) + array.opening.radius
    area, listed = abs(float(np.linalg.det(array.lattice.basis))), array.lens_table
    if listed is not None:
        area = float(listed.bins.width**2 * (len(listed.bins.first) - 1) / max(len(listed.lenses), 1))
    count = 1.0 + float(np.pi * search**2 / area)
    if count > MAX_CELLS:
        raise InvalidValueError(
            f"each pixel sees about {count:.3g} microlenses, and the limit is {MAX_CELLS}; their pitch is too small, "
            "or their images overlap too much: check the units, close the stop or reduce microlenses_to_sensor"
        )
    return count


class _GroupHalf(NamedTuple):
    """Half sides of a group in local x and y in mm, and rays per candidate."""

    x: float
    y: float
    rays: int


def _group_points(camera: CameraRecord, points: Floats) -> tuple[Floats, NDArray[np.int64]]:
    """Centres (g, 2) of the groups of pixels that contain sensor points (n, 2), and the group of each point (n,)."""
    sensor, placement = camera.sensor, camera.parts.sensor_to_local
    back = np.asarray(np.linalg.inv(placement.turn[:2, :2]), dtype=np.float64)
    on_sensor = _rotate(points - placement.shift[:2], back) / sensor.pitch
    column = np.floor((sensor.columns / 2 - on_sensor[:, 0]) / GROUP_SIDE).astype(np.int64)
    row = np.floor((on_sensor[:, 1] + sensor.rows / 2) / GROUP_SIDE).astype(np.int64)
    across = sensor.columns // GROUP_SIDE + 2 * _BORDER
    number, group = np.unique((row + _BORDER) * across + column + _BORDER, return_inverse=True)
    row, column = (part - _BORDER + 0.5 for part in np.divmod(number, across))
    return _sensor_points(camera, row * GROUP_SIDE, column * GROUP_SIDE), np.ascontiguousarray(group.ravel())


def _candidates(camera: CameraRecord, centres: Floats, margin: float) -> tuple[Candidates, Floats]:
    """Candidates of groups, by the bounds on the pupil, and the corners of their polygons."""
    from plenoptic.camera.sampling.kernels import candidates as kernels

    array, plane, counts = camera.array, camera.sensor.plane, np.zeros(2, dtype=np.int64)
    first, response, wells = np.zeros(len(centres) + 1, dtype=np.int64), camera.sensor.response, None
    if isinstance(response, WellsRecord) and response.table is None and response.frame is None and plane.tilt is None:
        wells = response, plane.distance, margin
    capacity, max_corners = 4 * len(centres) + 4, 64 * len(centres) + 64
    while True:
        details = np.empty(capacity, MICROLENS) if array is not None and array.differs else None
        rows, corners = np.empty(capacity, CANDIDATE), np.empty((2, max_corners))
        candidates = Candidates(first, rows, details)
        if array is None:
            kernels.fill_pupil(candidates, corners, counts, centres, camera.pupil, wells)
        else:
            kernels.fill_cells(candidates, corners, counts, centres, margin, plane, array, camera.pupil)
        if counts[0] <= capacity and counts[1] <= max_corners:
            return candidates._replace(rows=rows[: counts[0]]), corners
        capacity, max_corners = max(capacity, counts[0]), max(max_corners, counts[1])


def _element_intersections(camera: CameraRecord, blocks: Floats, waves: NDArray[np.int64] | None) -> Floats:
    """Intersections (elements, 3, rays) of rays behind the array with the elements of the lens: x, y, status.

    x and y are in the axes of each element.
    """
    from plenoptic.optics.lens.kernels.trace import fill_through_lens

    fields = blocks.reshape(-1, 8, BLOCK)
    intersections = np.empty((len(camera.openings.elements), 3, len(fields), BLOCK))
    for hit, element in zip(intersections, camera.openings.elements, strict=True):
        fill_through_lens(blocks, element, waves)
        hit[0], hit[1], hit[2] = fields[:, 0], fields[:, 1], fields[:, STATUS // BLOCK]
        if element.frames is not None and element.frames[0, MOVED] != 0:
            frame = element.frames[0]
            x, y, z = hit[0] - frame[9], hit[1] - frame[10], fields[:, 2] - element.rows[0]["z"] - frame[11]
            hit[0] = frame[0] * x + frame[3] * y + frame[6] * z
            hit[1] = frame[1] * x + frame[4] * y + frame[7] * z
    return intersections.reshape(len(intersections), 3, -1)


def _ray_transfers(
    camera: CameraRecord, candidates: Candidates, corners: Floats, centres: Floats, half: _GroupHalf
) -> NDArray[np.void]:
    """Linear ray transfers of candidates to the elements of the lens; candidates get their first one and number."""
    from plenoptic.camera.camera_rays import fill_through_array  # samples regions itself
    from plenoptic.camera.sampling.kernels import ray_transfer as kernels
    from plenoptic.camera.sampling.kernels.region_polygons import MAX_PIECES, fill_boxes

    group, openings = np.repeat(np.arange(len(centres)), np.diff(candidates.first)), camera.openings
    pending = np.flatnonzero((np.diff(candidates.first)[group] <= MAX_PIECES) & (candidates.rows["disconnected"] == 0))
    transfers, used = np.empty(4 * len(centres) + 64, RAY_TRANSFER), 0
    for _ in range(_PASSES):
        coarse = [pending[:0]]
        for start in range(0, max(len(pending), 1), _TOGETHER):
            chosen = pending[start : start + _TOGETHER].copy()
            n_rays = half.rays * len(chosen)
            blocks = np.empty(-(-n_rays // BLOCK) * RAY)
            lenslets, waves = camera.lenslet_parameters(blocks.size // 8), None
            if camera.dispersed is not None and camera.dispersed.index_ratios is not None:
                last = camera.dispersed.index_ratios.shape[1] - 1
                waves = np.zeros(blocks.size // 8, dtype=np.int64)
                waves[:n_rays].reshape(-1, half.rays)[:] = np.repeat([last // 2, 0, last], half.rays // 3)
            kernels.fill_transfer_rays(blocks, lenslets, candidates, chosen, centres[group[chosen]], half)
            fill_through_array(blocks, lenslets, camera, waves)
            # The rim of a microlens does not clip rays of the design, which may pass beside it.
            status = blocks.reshape(-1, RAY // BLOCK, BLOCK)[:, STATUS // BLOCK]
            status[status == OUTSIDE_MICROLENS] = 0.0
            points = _element_intersections(camera, blocks, waves)
            arguments = candidates, chosen, points, openings, half
            while (end := kernels.fill_ray_transfers(transfers, used, *arguments)) > len(transfers):
                transfers = np.concatenate([transfers, np.empty(end, RAY_TRANSFER)])
            used = end
            coarse.append(chosen[: fill_boxes(candidates, chosen, corners, transfers, openings.edges, half)])
        pending = np.concatenate(coarse)
        if not pending.size:
            break
    return transfers


def aperture_regions(
    camera: CameraRecord, points: Floats, half: tuple[float, float] = (0.0, 0.0), *, with_core: bool = False
) -> Regions:
    """Aperture regions of sensor points (n, 2), each for all points up to `half` mm from it in x and y.

    The points lie in pixels, including their insensitive area. `with_core`: keep planes for the unvignetted core.
    Raises the error of `cells_per_pixel`.
    """
    from plenoptic.camera.sampling.kernels import region_polygons as kernels
    from plenoptic.camera.sampling.kernels.ray_transfer import RAYS

    cells_per_pixel(camera)
    if with_core or camera.exact:
        centres, group = _group_points(camera, points)
        turn = camera.parts.sensor_to_local.turn
        sides = 0.5 * GROUP_SIDE * camera.sensor.pitch * np.abs(turn[:2, :2]).sum(axis=1)
        colours = 1 if camera.dispersed is None else 3
        size = _GroupHalf(float(sides[0]), float(sides[1]), RAYS * colours)
        candidates, corners = _candidates(camera, centres, float(np.hypot(*sides)))
        transfers = _ray_transfers(camera, candidates, corners, centres, size)
    else:
        centres, group, transfers = points, np.arange(len(points)), np.empty(1, RAY_TRANSFER)
        candidates, corners = _candidates(camera, centres, float(np.hypot(*half)))
    geometry = transfers, camera.openings.edges, centres, with_core
    first, counts = np.zeros(len(points) + 1, dtype=np.int64), np.zeros(3, dtype=np.int64)
    n_pieces, n_corners, n_planes = (k * len(points) + 64 for k in (2, 16, 4))
    while True:
        details = None if candidates.details is None else np.empty(n_pieces, MICROLENS)
        pieces, planes = np.empty(n_pieces, PIECE), np.empty(n_planes, PLANE)
        regions = Regions(pieces, first, np.empty((2, n_corners)), planes, details)
        kernels.fill_regions(regions, counts, points, group, candidates, corners, geometry, half)
        if counts[0] <= n_pieces and counts[1] <= n_corners and counts[2] <= n_planes:
            return regions
        n_pieces, n_corners, n_planes = max(n_pieces, counts[0]), max(n_corners, counts[1]), max(n_planes, counts[2])


def illuminated_pixels(
    camera: CameraRecord, pixels: Floats, number: NDArray[np.int64], *, with_core: bool = False
) -> IlluminatedPixels:
    """Pixels that light can reach, with their aperture regions (see `aperture_regions`).

    `pixels` (n, 2) are the centres and `number` (n,) the numbers on the sensor of the pixels to test.
    """
    if camera.deflection is not None:
        return _pixels_with_sources(camera, camera.deflection, pixels, number, with_core=with_core)
    regions = aperture_regions(camera, pixels, camera.sensor.pixel.half, with_core=with_core)
    lit = np.flatnonzero(np.diff(regions.first))
    regions = regions._replace(first=np.append(regions.first[lit], regions.first[-1]))
    return IlluminatedPixels(
        lit, number[lit], np.ascontiguousarray(pixels[lit]), regions, camera.sensor.pixel, with_core
    )


def _pixels_with_sources(
    camera: CameraRecord, deflection: DeflectionRecord, pixels: Floats, number: NDArray[np.int64], *, with_core: bool
) -> IlluminatedPixels:
    """All pixels, with the regions of the pixels from which diffraction can carry light into them."""
    sensor, kernel = camera.sensor, camera.diffraction_kernel
    reach = 0 if kernel is None else kernel.table.reach
    right, down = (deflection.back @ (pixels - deflection.shift).T)[:2]
    on_sensor = np.floor(np.column_stack([sensor.rows / 2 + down, sensor.columns / 2 - right])).astype(np.int64)
    near = deflection.near
    low = on_sensor.min(axis=0, initial=sensor.rows + sensor.columns) - near
    high = on_sensor.max(axis=0, initial=0) + near + 1
    grid = np.full(np.maximum(high - low, 0), -1, dtype=np.int32)
    in_grid = tuple((on_sensor - low).T)
    row, column = in_grid
    grid[in_grid] = np.arange(len(pixels))
    for steps in (reach, near):
        new = np.nonzero(_dilate(grid >= 0, steps) & (grid < 0))
        grid[new] = len(row) + np.arange(len(new[0]))
        if steps == reach:
            n_kernel = len(row) + len(new[0])
        row, column = np.append(row, new[0]), np.append(column, new[1])
    centres = _sensor_points(camera, low[0] + row + 0.5, low[1] + column + 0.5)
    regions = aperture_regions(camera, centres, sensor.pixel_cell.half, with_core=with_core)
    first_group, lit_groups = _lit_groups(camera, low + near - FAR, high - near + FAR)
    offsets = np.arange(-reach, reach + 1)
    down, across = (part.ravel() for part in np.meshgrid(offsets, offsets, indexing="ij"))
    border = _pixel_numbers(camera, low[0] + row[len(pixels) : n_kernel], low[1] + column[len(pixels) : n_kernel])
    sources = SourcePixels(
        pixels=on_sensor,
        corner=(int(low[0]), int(low[1])),
        grid=grid,
        numbers=np.append(number, border),
        kernel_sources=grid[in_grid[0][:, None] - down, in_grid[1][:, None] + across].astype(np.int64),
        centres=centres,
        lit_groups=lit_groups,
        first_group=(int(first_group[0]), int(first_group[1])),
        shape=(sensor.rows, sensor.columns),
        plane=sensor.plane,
        deflection=deflection,
    )
    place, centres = np.arange(len(pixels)), np.ascontiguousarray(pixels)
    return IlluminatedPixels(place, number, centres, regions, sensor.pixel, with_core, sources)


def _lit_groups(
    camera: CameraRecord, low: NDArray[np.int64], high: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """First group (row, column) and mask of the groups between two pixels that light may be aimed at, by bounds."""
    first, end = low // GROUP_SIDE, np.maximum(-(-high // GROUP_SIDE), low // GROUP_SIDE)
    row, column = np.meshgrid(*(np.arange(*ends) + 0.5 for ends in zip(first, end, strict=True)), indexing="ij")
    centres = _sensor_points(camera, GROUP_SIDE * row.ravel(), GROUP_SIDE * column.ravel())
    candidates = _candidates(camera, centres, GROUP_SIDE * float(np.hypot(*camera.sensor.pixel_cell.half)))[0]
    return first, (np.diff(candidates.first) > 0).reshape(row.shape)


def _pixel_numbers(camera: CameraRecord, row: NDArray[np.int64], column: NDArray[np.int64]) -> NDArray[np.int64]:
    """Numbers of pixels up to `NEAR` rows and columns outside the sensor; there they follow those of the sensor."""
    rows, columns = camera.sensor.rows, camera.sensor.columns
    on_sensor = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    outside = rows * columns + (row + NEAR) * (columns + 2 * NEAR) + column + NEAR
    return np.where(on_sensor, row * columns + column, outside)


def kernel_source_pixels(
    camera: CameraRecord, pixels: IlluminatedPixels, table: KernelTable
) -> tuple[IlluminatedPixels, IlluminatedPixels]:
    """Pixels whose light the diffraction kernel shares: those of the tile, and those around it.

    Their places are those of `SourcePixels.kernel_sources`.
    """
    assert pixels.sources is not None
    first, sources = pixels.regions.first, pixels.sources
    n_own, n_all = len(pixels.place), len(sources.numbers)
    parts = []
    for low, high in ((0, n_own), (n_own, n_all)):
        lit = low + np.flatnonzero(np.diff(first[low : high + 1]))
        regions = pixels.regions._replace(first=np.append(first[lit], first[high]))
        centres, numbers = sources.centres[lit], sources.numbers[lit]
        area = camera.sensor.pixel_cell
        parts.append(IlluminatedPixels(lit, numbers, centres, regions, area, pixels.has_core, kernel=table))
    return parts[0], parts[1]


def _dilate(image: NDArray[Any], steps: int) -> NDArray[Any]:
    """Largest value of an image within some rows and columns of each element (morphological dilation)."""
    for axis in range(2):
        original, image = image, image.copy()
        for step in range(1, steps + 1):
            near, far = (slice(None),) * axis + (slice(step, None),), (slice(None),) * axis + (slice(None, -step),)
            image[near] = np.maximum(image[near], original[far])
            image[far] = np.maximum(image[far], original[near])
    return image
