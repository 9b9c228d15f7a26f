"""Images of points: light summed over the pixels that it reaches, with standard errors."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.psf.psf_results import CameraSpread
from plenoptic.camera.psf.sensor_hits import ForwardRecord, Task, trace_task
from plenoptic.core.kernels.ray_blocks import CAUSES
from plenoptic.core.lost_rays import cause_and_element
from plenoptic.core.parallel import run_in_order
from plenoptic.core.values import Floats

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera


class SensorCrop(NamedTuple):
    """Rectangle of the sensor that rays reach, with the light in its pixels."""

    corner: NDArray[np.int64]
    """(2,): row and column of its first pixel."""
    sums: Floats
    moments: Floats
    """(3,): sums of the weight, and of weight times x and y."""
    counts: NDArray[np.int64]
    """Number of rays by status code; then beside the openings of pixels, beside the sensor, and landed."""


class Spot(NamedTuple):
    """Image of one point with its standard error, and the moments of its light."""

    crop: SensorCrop
    """Mean over the replicates."""
    error: Floats
    moments: Floats
    """(replicates, 3)."""


def _trace_crop(record: ForwardRecord, task: Task, seed: np.uint64) -> SensorCrop:
    """Trace one task and sum its light over pixels."""
    from plenoptic.camera.psf.kernels.source_rays import extent, fill_crop

    rays = trace_task(record, task, seed)
    counts = np.append(rays.counts, [rays.beside_opening, rays.beside_sensor, len(rays.rows)])
    corner, sums, moments = np.zeros(2, np.int64), np.zeros((0, 0)), np.zeros(3)
    if len(rays.rows):
        top, bottom, left, right = extent(rays.rows)
        corner, sums = np.array([top, left]), np.zeros((bottom + 1 - top, right + 1 - left))
        fill_crop(sums, moments, rays.rows, top, left)
    return SensorCrop(corner, sums, moments, counts)


def _sum_crops(crops: list[SensorCrop]) -> SensorCrop:
    """Sum of the crops of a replicate's chunks."""
    corner, shape = _bounding_rectangle(crops)
    sums = sum((_paste(crop.sums, crop.corner, corner, shape) for crop in crops), start=np.zeros(shape))
    moments, counts = sum((c.moments for c in crops), start=np.zeros(3)), np.sum([c.counts for c in crops], axis=0)
    return SensorCrop(corner, sums, moments, counts)


def _bounding_rectangle(crops: list[SensorCrop]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First pixel and shape, (2,) each, of the bounding rectangle of crops."""
    lit = [crop for crop in crops if crop.sums.size]
    if not lit:
        return np.zeros(2, np.int64), np.zeros(2, np.int64)
    first = np.min([crop.corner for crop in lit], axis=0)
    return first, np.max([crop.corner + crop.sums.shape for crop in lit], axis=0) - first


def _paste(
    pixels: Floats, first_pixel: NDArray[np.int64], corner: NDArray[np.int64], shape: NDArray[np.int64]
) -> Floats:
    """Paste pixels, the first at `first_pixel` on the sensor, into an array whose first pixel is `corner`."""
    pasted = np.zeros(shape)
    # An empty crop has no position.
    if pixels.size:
        (top, left), (rows, columns) = first_pixel - corner, pixels.shape
        pasted[top : top + rows, left : left + columns] = pixels
    return pasted


def _to_spot(crops: list[SensorCrop], rays_per_replicate: int) -> Spot:
    """Mean and standard error over replicates of `rays_per_replicate` rays."""
    corner, shape = _bounding_rectangle(crops)
    mean, squares = np.zeros(shape), np.zeros(shape)
    for k, crop in enumerate(crops, start=1):
        image = _paste(crop.sums / rays_per_replicate, crop.corner, corner, shape)
        step = image - mean
        mean += step / k
        squares += step * (image - mean)
    moments = np.array([crop.moments / rays_per_replicate for crop in crops])
    counts = np.sum([crop.counts for crop in crops], axis=0)
    error = np.sqrt(squares / (max(len(crops) - 1, 1) * len(crops)))
    return Spot(SensorCrop(corner, mean, moments.mean(axis=0), counts), error, moments)


def trace_spots(
    record: ForwardRecord, tasks: list[Task], rays_per_replicate: int, seed: np.uint64, threads: int
) -> Iterator[tuple[int, Spot]]:
    """Trace tasks; yield index and spot of each visible point."""

    def trace_one(task: Task) -> tuple[Task, SensorCrop]:
        return task, _trace_crop(record, task, seed)

    results = run_in_order(trace_one, tasks, threads=threads)
    for number, point_results in groupby(results, key=lambda pair: pair[0].number):
        replicates = groupby(point_results, key=lambda pair: pair[0].replicate)
        yield (
            number,
            _to_spot([_sum_crops([crop for _, crop in chunks]) for _, chunks in replicates], rays_per_replicate),
        )


def to_camera_spread(
    camera: PlenopticCamera, points: Floats, spots: dict[int, Spot], replicates: int, rays_per_replicate: int
) -> CameraSpread:
    """Combine the spots of several points into arrays of one shape."""
    n = len(points)
    shape = np.max([(1, 1), *(spot.crop.sums.shape for spot in spots.values())], axis=0)
    last = np.array(camera.sensor.shape) - shape
    image, error = np.zeros((2, n, *shape))
    corner = np.tile(last // 2, (n, 1))
    moments = np.zeros((n, replicates, 3))
    counts = np.zeros((n, CAUSES * (len(camera.lens.elements) + 1) + 3), dtype=np.int64)
    for number, spot in spots.items():
        counts[number], moments[number] = spot.crop.counts, spot.moments
        if spot.crop.sums.size:
            corner[number] = np.minimum(spot.crop.corner, last)
        for images, crop_image in ((image, spot.crop.sums), (error, spot.error)):
            images[number] = _paste(crop_image, spot.crop.corner, corner[number], shape)
    area = camera.sensor.pixel_pitch**2
    centroid, centroid_error = centroids(moments)
    fates, fractions = _fates(counts, replicates * rays_per_replicate)
    has_error = replicates >= 2
    return CameraSpread(
        image=image / area,
        standard_error=error / area if has_error else None,
        corner=corner,
        points=points,
        light=moments[:, :, 0].mean(axis=1),
        light_error=moments[:, :, 0].std(axis=1, ddof=1) / np.sqrt(replicates) if has_error else None,
        centroid=centroid,
        centroid_error=centroid_error if has_error else None,
        fates=fates,
        fractions=fractions,
        sensor=camera.sensor,
        rays=replicates * rays_per_replicate,
    )


def centroids(moments: Floats) -> tuple[Floats, Floats]:
    """Centroids (n, 2) from moments (n, replicates, 3), and their standard errors by the jackknife over replicates."""
    total, count = moments.sum(axis=1), moments.shape[1]
    with np.errstate(invalid="ignore", divide="ignore"):
        leave_one_out = total[:, None] - moments
        partial_centroids = leave_one_out[..., 1:] / leave_one_out[..., :1]
        return total[:, 1:] / total[:, :1], np.sqrt((count - 1) * partial_centroids.var(axis=1))


def _fates(counts: NDArray[np.int64], rays: int) -> tuple[tuple[tuple[str, int | None], ...], Floats]:
    """Fates of rays, name and lens element, and the fraction of rays with each."""
    beside_opening, beside_sensor, landed = (counts.shape[1] - k for k in (3, 2, 1))
    fates: dict[int, tuple[str, int | None]] = {landed: ("landed", None), beside_sensor: ("beside_sensor", None)}
    if counts[:, beside_opening].any():
        fates[beside_opening] = "beside_opening", None
    for code in (np.flatnonzero(counts[:, 1:beside_opening].any(axis=0)) + 1).tolist():
        fates[code] = cause_and_element(code)
    return tuple(fates.values()), counts[:, list(fates)] / rays
