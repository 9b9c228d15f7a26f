"""Diffraction kernel: weights by which neighbouring pixels share light deflected at the openings of microlenses.

A path to a place on the sensor represents light aimed there. Diffraction distributes it over the pixels around with
known weights. For near deflections these weights are applied to each path, so that pixels use the paths of their
neighbours and no near deflection is left to chance. The remainder, light deflected farther, is weak: its deflection is
drawn for one path in `DEFLECTION_INTERVAL`; see `diffraction`.
"""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import Assembly, sensor_corners
from plenoptic.camera.sampling.sampling_records import Batch, KernelTable, batch_record
from plenoptic.core.color.spectra import ColourTables
from plenoptic.core.values import Floats
from plenoptic.optics.diffraction.far_field import remove_cells

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.camera.camera_record import SensorRecord
    from plenoptic.camera.diffraction import DeflectionRecord

DEFLECTION_INTERVAL = 4
"""Paths for each drawn deflection."""
_SUM_SIZE = 64
"""Samples that are summed before the kernel is applied: more take less time, and make longer batches."""
PILOT_SAMPLES = 2
"""Paths of a pixel that estimate its level in a white image, the mean of the control variate."""
NUMBER_OFFSET = 1 << 48
"""Offset of pixel numbers that gives drawn deflections independent random numbers."""
_SUBDIVISIONS, _GRID_POINTS = 32, 2
"""Places along a side of a pixel for which weights are averages, and points of a grid in each for averaging."""
_SCALE_STEP = 0.02
"""Step of the pattern's size on the sensor, relative to the smallest."""
_MAX_REACH, _MAX_REMAINDER = 3, 0.06
"""Most pixels on each side of a kernel, and the largest remainder for which a smaller kernel is used."""
_MAX_REMAINDER_WITH_KERNEL, _MIN_FILL_FACTOR = 0.4, 0.5
"""With a larger remainder, or a smaller fill factor of pixels, a kernel adds noise: all deflections are drawn."""


class DiffractionKernel(NamedTuple):
    """Weights of near deflections, and the remainder, which is drawn."""

    table: KernelTable
    remainder: DeflectionRecord
    """Deflections beyond the kernel."""
    remainder_share: float
    """Their share of the light."""


def diffraction_kernel(
    camera: PlenopticCamera,
    sensor: SensorRecord,
    parts: Assembly,
    deflection: DeflectionRecord,
    colour: ColourTables | None,
) -> DiffractionKernel | None:
    """Split deflections into a kernel and a remainder.

    The kernel holds the deflections that end within a few pixels at every wavelength and distance from the array. None
    if drawing all deflections gives less noise.
    """
    plane, drawn_wavelengths = sensor.plane, deflection.wavelengths[min(1, len(deflection.wavelengths) - 1) :]
    extra_distance = np.zeros(1) if parts.tilt is None else sensor_corners(camera, parts)[:, :2] @ parts.tilt
    smallest = float(drawn_wavelengths.min() * (plane.distance + extra_distance.min()))
    largest = float(drawn_wavelengths.max() * (plane.distance + extra_distance.max()))
    scales = math.ceil(math.log(largest / smallest) / _SCALE_STEP) or 1
    step = (largest - smallest) / scales or largest
    is_near, reach = _near_cells(deflection, largest)
    remainder, remainder_share = remove_cells(deflection.field, is_near)
    if remainder_share > _MAX_REMAINDER_WITH_KERNEL or sensor.fill_factor < _MIN_FILL_FACTOR:
        return None
    light = [(np.diff(deflection.field.columns, axis=1) * np.diff(deflection.field.rows)[:, None])[is_near]]
    if deflection.field.opening is not None:
        through, share = deflection.field.opening[is_near], deflection.field.opening_fraction
        light = [light[0] * through, light[0] * (1.0 - share * through) / (1.0 - share)]
    cells, overlaps = np.stack(np.nonzero(is_near)[::-1]), _overlaps(np.asarray(camera.sensor.pixel_aperture), reach)
    sizes = smallest + step * (np.arange(scales) + 0.5) if largest > smallest else np.array([largest])
    rows = [
        _kernel_weights(deflection, size, cells, part, overlaps) / sensor.fill_factor
        for size in sizes
        for part in light
    ]
    means = None
    if parts.tilt is None and len(light) == 1:
        spectral_weights = np.ones((1, 1)) if colour is None else np.diff(colour.cdf, prepend=0.0) * colour.weights.T
        scale = (drawn_wavelengths * plane.distance - smallest) * (1.0 / step)
        scale = np.clip(scale, 0, scales - 1).astype(np.int64)
        means = spectral_weights @ np.stack([part.mean(axis=0) for part in rows])[scale]
    table = KernelTable(
        weights=np.concatenate(rows),
        means=means,
        reach=reach,
        subdivisions=_SUBDIVISIONS,
        patterns=len(light),
        plane=plane,
        wavelengths=deflection.wavelengths,
        scales=scales,
        lowest_scale=smallest,
        scales_per_area=1.0 / step,
    )
    return DiffractionKernel(table, deflection._replace(field=remainder), remainder_share)


def _displacements(deflection: DeflectionRecord, scale: float, cells: Floats) -> Floats:
    """Displacement (2, ...) in pixels for points (2, ...) of the far-field table, in cells along x and y.

    `scale` is the wavelength times the distance from the array, in mm^2.
    """
    periods = cells * deflection.field.step - deflection.field.radius
    return np.asarray(np.tensordot(scale * (deflection.back @ deflection.field.scale), periods, axes=1))


def _near_cells(deflection: DeflectionRecord, scale: float) -> tuple[NDArray[np.bool_], int]:
    """Cells (n, n) of the far-field table that end within the kernel's reach at a scale, and that reach in pixels."""
    corners = np.arange(len(deflection.field.columns) + 1.0)
    ends = np.abs(_displacements(deflection, scale, np.stack(np.meshgrid(corners, corners)))).max(axis=0)
    ends = np.maximum(np.maximum(ends[1:, 1:], ends[:-1, :-1]), np.maximum(ends[1:, :-1], ends[:-1, 1:]))
    for reach in range(1, _MAX_REACH):
        if remove_cells(deflection.field, ends <= reach)[1] <= _MAX_REMAINDER:
            return ends <= reach, reach
    return ends <= _MAX_REACH, _MAX_REACH


def _overlaps(aperture: Floats, reach: int) -> list[Floats]:
    """Overlap along x and y of the central pixel's places, displaced by each step of a grid, with sensitive areas.

    (pixels, places, steps) for each axis.
    """
    n_grid = _SUBDIVISIONS * _GRID_POINTS
    edges = np.arange((2 * reach + 1) * n_grid + 1) / n_grid - reach - 0.5
    pixel = np.arange(-reach, reach + 1)[:, None]
    displaced = np.arange(n_grid)[:, None] + np.arange(2 * reach * n_grid + 1)
    overlaps = []
    for width in aperture:
        inside = np.diff(np.clip(edges, pixel - 0.5 * width, pixel + 0.5 * width), axis=1) * n_grid
        overlaps.append(inside[:, displaced].reshape(len(pixel), _SUBDIVISIONS, _GRID_POINTS, -1).mean(axis=2))
    return overlaps


def _kernel_weights(
    deflection: DeflectionRecord, scale: float, cells: NDArray[np.int64], light: Floats, overlaps: list[Floats]
) -> Floats:
    """Kernel weights (_SUBDIVISIONS^2, pixels) of light aimed at each place of the central pixel.

    The light is deflected by cells (2, k) of the far-field table.
    """
    reach, n_grid, n = len(overlaps[0]) // 2, _SUBDIVISIONS * _GRID_POINTS, overlaps[0].shape[2]
    grid = np.zeros(n * n)
    # Points of a cell, nearer to one another than those of the grid, to which their light is divided.
    cell_size = float(
        np.abs(_displacements(deflection, scale, np.eye(2)) - _displacements(deflection, scale, np.zeros((2, 2)))).max()
    )
    points = math.ceil(cell_size * n_grid)
    fractions = (np.arange(points) + 0.5) / points
    light = np.tile(light, points)
    for fraction in fractions:
        inside = np.stack(np.broadcast_arrays(cells[0] + fractions[:, None], cells[1] + fraction)).reshape(2, -1)
        position = np.clip((_displacements(deflection, scale, inside) + reach) * n_grid, 0.0, n - 1 - 1e-9)
        corner = position.astype(np.int64)
        part = position - corner
        for right, down in itertools.product((0, 1), (0, 1)):
            weight = np.abs(1 - right - part[0]) * np.abs(1 - down - part[1])
            grid += np.bincount((corner[1] + down) * n + corner[0] + right, weight * light, minlength=n * n)
    by_x, by_y = overlaps
    weights = np.einsum("dim,mn,ajn->ijda", by_y, grid.reshape(n, n) / points**2, by_x, optimize=True)
    return np.ascontiguousarray(weights.reshape(_SUBDIVISIONS * _SUBDIVISIONS, -1))


def batch_step(replicates: int) -> int:
    """Multiple of samples at which a batch may end without changing any bit: sums begin anew there."""
    step = DEFLECTION_INTERVAL * replicates
    return max(_SUM_SIZE // step, 1) * step


def remainder_batch(batch: Batch) -> Batch:
    """Batch of the drawn deflections that belong to a batch of samples.

    The first one represents the first `DEFLECTION_INTERVAL` samples of a replicate, and so on, however samples are
    divided into batches.
    """
    first, size = batch.first_index // DEFLECTION_INTERVAL, batch.samples // batch.streams
    short, long = (-(-(batch.first_index + n) // DEFLECTION_INTERVAL) - first for n in (size, size + 1))
    samples = batch.streams * short + batch.samples % batch.streams * (long - short)
    return batch_record(batch.seed, 0, samples, batch.streams, batch.first_stream, first)


def pilot_numbers(number: NDArray[np.int64]) -> NDArray[np.int64]:
    """Pixel numbers for the random numbers of pilot paths."""
    return number + 2 * NUMBER_OFFSET


def remainder_numbers(number: NDArray[np.int64]) -> NDArray[np.int64]:
    """Pixel numbers for the random numbers of drawn deflections."""
    return number + NUMBER_OFFSET
