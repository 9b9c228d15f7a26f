"""Light of points, counted on the pixels on which it lands."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.psf.sensor_hits import ForwardRecord, Task, landed
from plenoptic.camera.psf.spread import CameraSpread
from plenoptic.core.kernels.ray_blocks import CAUSES
from plenoptic.core.lost_rays import cause_and_element
from plenoptic.core.parallel import run_in_order
from plenoptic.core.values import Floats


class Crop(NamedTuple):
    """Part of the sensor that rays reach, with their light."""

    corner: NDArray[np.int64]
    """(2,): row and column of its first pixel."""
    sums: Floats
    moments: Floats
    """(3,) sums of the weight, and of weight times x and y."""
    counts: NDArray[np.int64]
    """Rays by status code, and at the end those beside the openings of pixels, beside the sensor, and landed."""


class Spot(NamedTuple):
    """Accumulated sums of one point's image."""

    crop: Crop
    """With the mean of the replicates as sums."""
    error: Floats
    moments: Floats
    """(replicates, 3)."""


def _count_hits(record: ForwardRecord, task: Task, seed: np.uint64) -> Crop:
    """Trace one task and count the rays that land on each pixel."""
    from plenoptic.camera.psf.kernels.source_rays import extent, fill_crop

    result = landed(record, task, seed)
    counts = np.append(result.counts, [result.shut, result.beside, len(result.rows)])
    corner, sums, moments = np.zeros(2, np.int64), np.zeros((0, 0)), np.zeros(3)
    if len(result.rows):
        top, bottom, left, right = extent(result.rows)
        corner, sums = np.array([top, left]), np.zeros((bottom + 1 - top, right + 1 - left))
        fill_crop(sums, moments, result.rows, top, left)
    return Crop(corner, sums, moments, counts)


def _add(crops: list[Crop]) -> Crop:
    """Crops of the chunks of a replicate as one."""
    corner, shape = _around(crops)
    sums = sum((_within(crop.sums, crop.corner, corner, shape) for crop in crops), start=np.zeros(shape))
    moments, counts = sum((c.moments for c in crops), start=np.zeros(3)), np.sum([c.counts for c in crops], axis=0)
    return Crop(corner, sums, moments, counts)


def _around(crops: list[Crop]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First pixel and shape, (2,) each, of the rectangle that holds crops."""
    lit = [crop for crop in crops if crop.sums.size]
    if not lit:
        return np.zeros(2, np.int64), np.zeros(2, np.int64)
    first = np.min([crop.corner for crop in lit], axis=0)
    return first, np.max([crop.corner + crop.sums.shape for crop in lit], axis=0) - first


def _within(pixels: Floats, at: NDArray[np.int64], corner: NDArray[np.int64], shape: NDArray[np.int64]) -> Floats:
    """Pixels of which the first is `at` on the sensor, in an array of which the first is `corner`."""
    image = np.zeros(shape)
    # What is empty lies nowhere.
    if pixels.size:
        (top, left), (rows, columns) = at - corner, pixels.shape
        image[top : top + rows, left : left + columns] = pixels
    return image


def _spot(crops: list[Crop], each: int) -> Spot:
    """Mean and standard error over replicates of `each` rays."""
    corner, shape = _around(crops)
    mean, squares = np.zeros(shape), np.zeros(shape)
    for k, crop in enumerate(crops, start=1):
        image = _within(crop.sums / each, crop.corner, corner, shape)
        step = image - mean
        mean += step / k
        squares += step * (image - mean)
    moments = np.array([crop.moments / each for crop in crops])
    counts = np.sum([crop.counts for crop in crops], axis=0)
    error = np.sqrt(squares / (max(len(crops) - 1, 1) * len(crops)))
    return Spot(Crop(corner, mean, moments.mean(axis=0), counts), error, moments)


def spots_of(
    record: ForwardRecord, tasks: list[Task], each: int, seed: np.uint64, threads: int
) -> Iterator[tuple[int, Spot]]:
    """Number and spot of each point that has tasks."""

    def work(task: Task) -> tuple[Task, Crop]:
        return task, _count_hits(record, task, seed)

    results = run_in_order(work, tasks, threads=threads)
    for number, of_point in groupby(results, key=lambda pair: pair[0].number):
        replicates = groupby(of_point, key=lambda pair: pair[0].replicate)
        yield number, _spot([_add([crop for _, crop in chunks]) for _, chunks in replicates], each)


def assembled(
    camera: PlenopticCamera, points: Floats, spots: dict[int, Spot], replicates: int, each: int
) -> CameraSpread:
    """Spots of several points as arrays of one shape."""
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
        for full, part in ((image, spot.crop.sums), (error, spot.error)):
            full[number] = _within(part, spot.crop.corner, corner[number], shape)
    area = camera.sensor.pixel_pitch**2
    centroid, centroid_error = centroids(moments)
    fates, fractions = _fates(counts, replicates * each)
    has_errors = replicates >= 2
    return CameraSpread(
        image=image / area,
        standard_error=error / area if has_errors else None,
        corner=corner,
        points=points,
        light=moments[:, :, 0].mean(axis=1),
        light_error=moments[:, :, 0].std(axis=1, ddof=1) / np.sqrt(replicates) if has_errors else None,
        centroid=centroid,
        centroid_error=centroid_error if has_errors else None,
        fates=fates,
        fractions=fractions,
        sensor=camera.sensor,
        rays=replicates * each,
    )


def centroids(moments: Floats) -> tuple[Floats, Floats]:
    """Centroids (n, 2) from moments (n, replicates, 3), and their errors, by leaving one replicate out at a time."""
    total, count = moments.sum(axis=1), moments.shape[1]
    with np.errstate(invalid="ignore", divide="ignore"):
        remaining = total[:, None] - moments
        without = remaining[..., 1:] / remaining[..., :1]
        return total[:, 1:] / total[:, :1], np.sqrt((count - 1) * without.var(axis=1))


def _fates(counts: NDArray[np.int64], rays: int) -> tuple[tuple[tuple[str, int | None], ...], Floats]:
    """Fates of rays, with names and elements, and the part of the rays."""
    shut, missed_sensor, arrived = (counts.shape[1] - k for k in (3, 2, 1))
    fates: dict[int, tuple[str, int | None]] = {arrived: ("landed", None), missed_sensor: ("beside_sensor", None)}
    if counts[:, shut].any():
        fates[shut] = "beside_opening", None
    for code in (np.flatnonzero(counts[:, 1:shut].any(axis=0)) + 1).tolist():
        fates[code] = cause_and_element(code)
    return tuple(fates.values()), counts[:, list(fates)] / rays
