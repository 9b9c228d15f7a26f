"""Results of forward tracing: point-spread functions, as sums of light over pixels, and hits of single rays."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from itertools import groupby
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.psf.sensor_hits import ForwardRecord, RayTask, trace_task
from plenoptic.core.display import picture_of
from plenoptic.core.kernels.ray_blocks import CAUSES
from plenoptic.core.lost_rays import cause_and_element
from plenoptic.core.parallel import run_in_order
from plenoptic.core.values import Floats, result, whole
from plenoptic.errors import InvalidValueError
from plenoptic.optics.sensor.sensor import Sensor

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera


@result
class CameraSpread:
    """Point-spread functions of a whole camera; made by `point_spread`.

    Shapes are for one point; for n points, all have n as the first dimension. Images are cropped to the part of the
    sensor that the light of a point reaches, of the same size for all points.

    Attributes
    ----------
    image : (rows, columns) array
        Value of each pixel for a small Lambertian emitter at the point that faces along the camera's axis, per unit of
        radiance and mm^2 of its area: sr/mm^2.
    standard_error : (rows, columns) array or None
        Standard error of each pixel of `image`; None with fewer than two replicates.
    corner : (2,) array of int
        Row and column on the sensor of the first pixel of `image`.
    points : (3,) array
        The points in the world in mm.
    light : float
        Projected solid angle in sr of the light that reaches the sensor: sum of the image times the area of a pixel.
    light_error : float or None
        Standard error of `light`.
    centroid : (2,) array
        Mean x and y on the sensor, in its own axes, of the light that reaches it, mm; NaN if none does.
    centroid_error : (2,) array or None
        Standard error of `centroid` in mm.
    fates : tuple of (str, int or None)
        Possible fates of a ray, and the lens element that stops it: "landed", "beside_sensor", "beside_opening" (on a
        pixel, but outside its sensitive area) or a lower-case name of `RayStatus`.
    fractions : (fates,) array
        Fraction of the rays with each fate. Rays are aimed at a polygon close around the lens's opening. Rays are
        counted, not light: one attenuated by dust or a grey mask has landed.
    sensor : Sensor
    rays : int
        Rays per point.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.camera.example_camera(pl.CameraKind.CONVENTIONAL)
    >>> spread = pl.point_spread(camera, (5.0, 0.0, -404.0))
    >>> spread.whole().shape, bool(abs(spread.image.sum() * 0.01**2 / spread.light - 1) < 1e-12)
    ((512, 512), True)
    >>> x, y = spread.centroid          # upside down on the sensor; images are turned when they are read out
    >>> bool(x < 0)
    True
    """

    image: Floats
    standard_error: Floats | None
    corner: NDArray[np.int64]
    points: Floats
    light: Floats | float
    light_error: Floats | float | None
    centroid: Floats
    centroid_error: Floats | None
    fates: tuple[tuple[str, int | None], ...]
    fractions: Floats
    sensor: Sensor
    rays: int

    @property
    def _is_batch(self) -> bool:
        return self.points.ndim == 2

    @property
    def regions(self) -> tuple[tuple[slice, slice], ...]:
        """Rows and columns of the sensor of each point's image, as for `render`; one entry per point."""
        rows, columns = self.image.shape[-2:]
        return tuple((slice(r, r + rows), slice(c, c + columns)) for r, c in np.atleast_2d(self.corner).tolist())

    @property
    def fraction_by_fate(self) -> dict[str, Floats]:
        """`fractions` by name, summed over all lens elements."""
        fractions: dict[str, Floats] = {}
        for k, (name, _) in enumerate(self.fates):
            fractions[name] = fractions.get(name, 0.0) + self.fractions[..., k]
        return fractions

    def of(self, number: int) -> CameraSpread:
        """Select one of several points.

        Parameters
        ----------
        number : int
            Index of the point, from 0; InvalidValueError if there is no such point.

        Examples
        --------
        >>> import plenoptic as pl
        >>> camera = pl.camera.example_camera(pl.CameraKind.CONVENTIONAL)
        >>> pl.point_spread(camera, [(0, 0, -404), (5, 0, -404)], rays=1024).of(1).points.tolist()
        [5.0, 0.0, -404.0]
        """
        count = len(np.atleast_2d(self.points))
        if whole(number, "number", at_least=0) >= count:
            raise InvalidValueError(f"number is {number}; there are {count} points: use 0 to {count - 1}")
        if not self._is_batch:
            return self

        arrays = {name: array[number] for name, array in vars(self).items() if isinstance(array, np.ndarray)}
        values: dict[str, Any] = {name: each if each.ndim else float(each) for name, each in arrays.items()}
        return dataclasses.replace(self, **values)

    def whole(self) -> Floats:
        """Image on the whole sensor: (rows, columns), or (n, rows, columns) for several points."""
        images = self.image if self._is_batch else self.image[None]
        on_sensor = np.zeros((len(images), *self.sensor.shape))
        for target, image, region in zip(on_sensor, images, self.regions, strict=True):
            target[region] = image
        return on_sensor if self._is_batch else on_sensor[0]

    def __repr__(self) -> str:
        count, (rows, columns) = len(np.atleast_2d(self.points)), self.image.shape[-2:]
        landed = 100 * float(np.mean(self.fraction_by_fate["landed"]))
        return (
            f"<CameraSpread of {count} point{'s' * (count != 1)}: {rows} x {columns} pixels, "
            f"{landed:.3g} % of {self.rays} rays landed>"
        )

    _repr_html_ = picture_of


@result
class LandingPoints:
    """Intersections with the sensor of single rays from points; made by `landing_points`.

    Attributes
    ----------
    position : (m, 2) array
        x and y on the sensor, in its own axes, of the rays that reach it, mm.
    weight : (m,) array
        Projected solid angle of each ray at the point, sr; with ideal lenses or microlenses that on the sensor
        times (n' / n)^2, see
        `point_spread`. Reduced by dust, masks, opaque microlenses and the pixel's angular response, down to 0.
    source : (m,) array of int
        Index of the point from which each ray comes.
    microlens : (m, 2) array or None
        Designed centre of the microlens that each ray passes, on the plane of the array, mm; None without microlenses.
    index : (m, 2) array of int or None
        Its lattice indices, those of `MicrolensArray.lenses`; in FREE lattices (number, 0).

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> camera = pl.camera.example_camera()
    >>> landed = pl.camera.landing_points(camera, (0.0, 0.0, -404.0))
    >>> middle = (landed.index == 0).all(axis=1)          # through the microlens on the axis
    >>> bool(np.abs(landed.position[middle]).max() < 0.03)
    True
    """

    position: Floats
    weight: Floats
    source: NDArray[np.int64]
    microlens: Floats | None
    index: NDArray[np.int64] | None

    def __repr__(self) -> str:
        return f"<LandingPoints: {len(self.position)} rays>"


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


def _trace_crop(record: ForwardRecord, task: RayTask, seed: np.uint64) -> SensorCrop:
    """Trace one task and sum its light over pixels."""
    from plenoptic.camera.psf.kernels.source_rays import fill_crop

    rays = trace_task(record, task, seed)
    rows, counts = rays.rows, np.append(rays.counts, [rays.beside_opening, rays.beside_sensor, len(rays.rows)])
    if not len(rows):
        return SensorCrop(np.zeros(2, np.int64), np.zeros((0, 0)), np.zeros(3), counts)
    pixels = np.stack([rows["row"], rows["column"]])
    corner = pixels.min(axis=1)
    sums, moments = np.zeros(pixels.max(axis=1) + 1 - corner), np.zeros(3)
    fill_crop(sums, moments, rows, *corner)
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


def dark_spot(record: ForwardRecord, replicates: int) -> Spot:
    """Image of a point without light."""
    counts = np.zeros(CAUSES * (len(record.camera.lens.elements) + 1) + 3, np.int64)
    crop = SensorCrop(np.zeros(2, np.int64), np.zeros((0, 0)), np.zeros(3), counts)
    return Spot(crop, np.zeros((0, 0)), np.zeros((replicates, 3)))


def add_spots(first: Spot, second: Spot) -> Spot:
    """Sum of two images of a point with independent errors; counts are those of the first."""
    corner, shape = _bounding_rectangle([first.crop, second.crop])
    images, errors = (
        [_paste(pixels, spot.crop.corner, corner, shape) for pixels, spot in zip(parts, (first, second), strict=True)]
        for parts in ((first.crop.sums, second.crop.sums), (first.error, second.error))
    )
    crop = SensorCrop(corner, images[0] + images[1], first.crop.moments + second.crop.moments, first.crop.counts)
    return Spot(crop, np.hypot(*errors), first.moments + second.moments)


def trace_spots(
    record: ForwardRecord, tasks: list[RayTask], rays_per_replicate: int, seed: np.uint64, threads: int
) -> Iterator[tuple[int, Spot]]:
    """Trace tasks; yield index and spot of each visible point."""

    def trace_one(task: RayTask) -> tuple[RayTask, SensorCrop]:
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
    from plenoptic.camera.psf.kernels.source_rays import fill_centroids

    centroid, error = np.empty((2, len(moments), 2))
    fill_centroids(centroid, error, moments)
    return centroid, error


def _fates(counts: NDArray[np.int64], rays: int) -> tuple[tuple[tuple[str, int | None], ...], Floats]:
    """Fates of rays, name and lens element, and the fraction of rays with each."""
    beside_opening, beside_sensor, landed = (counts.shape[1] - k for k in (3, 2, 1))
    fates: dict[int, tuple[str, int | None]] = {landed: ("landed", None), beside_sensor: ("beside_sensor", None)}
    if counts[:, beside_opening].any():
        fates[beside_opening] = "beside_opening", None
    for code in (np.flatnonzero(counts[:, 1:beside_opening].any(axis=0)) + 1).tolist():
        fates[code] = cause_and_element(code)
    return tuple(fates.values()), counts[:, list(fates)] / rays
