"""Gaussian model of the views of a light field, and the displacement of the real camera's images from it.

In the model, the image of an object plane shifts by the same amount between all neighbouring views. In the real camera,
aberrations of the main lens move the intersection of each pixel's ray with the plane, differently in each view and over
the field.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np
from numpy.polynomial.legendre import legder, legvander
from numpy.typing import NDArray

from plenoptic.camera.assembly import array_axes
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.gaussian import image_plane, lateral_magnification, model_pupil
from plenoptic.core.rays import RayBundle
from plenoptic.core.values import Floats
from plenoptic.lightfield.outward_rays import aperture_variance, chief_rays, plane_intersections
from plenoptic.lightfield.pinhole_model import (
    ObjectPlane,
    PlanePair,
    image_distance_behind_array,
    lens_front_z,
    linear_in_disparity,
    object_z,
)

_NODES, _TERMS = 8, 5
"""Traced pixels along a side of a view, and terms of the series fitted to them along each side."""
_RAYS = 3
"""Traced rays along the side of a pixel of the raw image: views show the mean of those that the lens passes."""
_CLEAR = 0.9
"""Light of a view, relative to the one with most of it, from which on it counts in disparities."""
_DISTANCES = (3.0, 30.0, 7.0)
"""Distances of object planes from the lens, over that from the iris to the array; the first two that have images."""


class Moebius(NamedTuple):
    """The function (a + b d) / (f - g d) of the model's disparity d: a traced disparity, for each pixel."""

    a: Floats
    b: Floats
    f: Floats
    g: Floats

    def of(self, disparity: float | Floats) -> Floats:
        """Traced disparity."""
        return np.asarray((self.a + self.b * disparity) / (self.f - self.g * disparity))

    def inverse(self, traced: float | Floats) -> Floats:
        """The model's disparity."""
        return np.asarray((self.f * traced - self.a) / (self.b + self.g * traced))


class ViewModel(NamedTuple):
    """Model of U x V views: a point at q of the central view is seen at q - d step + displacement in another one.

    d is the model's disparity, that of the point's plane by Gaussian optics. Lengths are in pixels of the views.
    """

    planes: PlanePair
    """Two object planes, whose `disparity_per_pitch` is their disparity."""
    vergence: float
    """Inverse distance from the exit pupil to the array, 1/mm."""
    per_lever: float
    """Disparity over e D / (D + e), of an image e behind the array seen from the pupil D in front of it; 1/mm."""
    step: Floats
    """(U, V, 2): shift in rows and columns per unit of disparity, against the step from view to view."""
    series: Floats
    """(2, U, V, 2, k, l): displacement in rows and columns as Legendre series in row and column: of the coefficient
    of 1, then of d. nan for views that no light reaches."""
    light: Floats
    """(U, V): fraction of a view's rays that the lens passes; 0 for views that lose more than a tenth of them, and get
    light through neighbouring microlenses."""
    size: tuple[int, int]
    """Rows and columns of a view."""
    axis: tuple[int, int]
    """Row and column of the pixel nearest to the axis of the lens."""

    def displacement(self, u: int, v: int) -> Floats:
        """Displacement of the pixels of a view, (rows, columns, 2, 2), as `ImageStack.residual_displacement`."""
        return np.moveaxis(_values(self.series[:, u, v], self.size), (0, 1), (2, 3))

    def shifts(self, disparity: float, u: int) -> Floats:
        """Shifts (V, rows, columns, 2) of the points of a plane from the central view to the views of a u."""
        series = self.series[0, u] + disparity * self.series[1, u]
        central = self.series[0, *self.centre] + disparity * self.series[1, *self.centre]
        shift = _values(series - central, self.size) - disparity * self.step[u, :, :, None, None]
        # The displacement is that at the shifted position.
        return np.moveaxis(shift / (1.0 - self._growth(series)), 1, 3)

    def model_positions(self, view: tuple[int, int], at: Floats, disparity: Floats) -> Floats:
        """Positions (..., n, 2) in the model's central view of points seen `at` (n, 2) in a view.

        The disparity (..., n) is the model's, here and in `seen_at`.
        """
        displacement, _ = self._displacement_at(view, at, disparity)
        return np.asarray(at + disparity[..., None] * self.step[view] - displacement)

    def seen_at(self, view: tuple[int, int], model_positions: Floats, disparity: Floats, near: Floats) -> Floats:
        """Positions (..., n, 2) in a view, `near` (n, 2), of points at positions in the model's central view."""
        displacement, growth = self._displacement_at(view, near, disparity)
        shift = model_positions - disparity[..., None] * self.step[view] + displacement - near
        # The displacement is that at the shifted position.
        return np.asarray(near + shift / (1.0 - growth))

    def _displacement_at(self, view: tuple[int, int], at: Floats, disparity: Floats) -> tuple[Floats, Floats]:
        """Displacement (..., n, 2) at positions (n, 2) of a view, and its change per pixel along the same axis."""
        series = self.series[:, *view]
        row, column = (legvander(_unit(at[:, k], n), series.shape[2 + k] - 1) for k, n in enumerate(self.size))
        change = np.zeros_like(series)
        for k, n in enumerate(self.size):
            part = legder(series[:, k], axis=1 + k) * (2.0 / max(n - 1, 1))
            change[:, k, : part.shape[1], : part.shape[2]] = part
        both = np.einsum("nk,gdakl,nl->gdna", row, np.stack([series, change]), column, optimize=True)
        return tuple(constant + disparity[..., None] * linear for constant, linear in both)

    @property
    def centre(self) -> tuple[int, int]:
        """Index of the central view."""
        return len(self.step) // 2, self.step.shape[1] // 2

    def traced_disparity(self, axis: int) -> Moebius:
        """Traced disparity from view to view for each pixel of v, along rows (axis 0), or of u, along columns (axis 1).

        Slope of the shifts of a point over all views, by least squares, weighed by the light of the views.
        """
        central = self.series[:, *self.centre]
        growth = self._growth(central)[:, axis]
        weight = np.where(np.isfinite(self.series[0, :, :, 0, 0, 0]), self.light * self.step[..., axis], 0.0)
        total = float((weight * self.step[..., axis]).sum())
        change = np.nan_to_num(self.series[:, :, :, axis]) - central[:, None, None, axis]
        mean = _values(np.einsum("uv,kuvij->kij", weight / (total or 1.0), change), self.size)
        return Moebius(-mean[0], 1.0 - mean[1], 1.0 - growth[0], growth[1])

    def _growth(self, series: Floats) -> Floats:
        """Change (..., 2, rows, columns) of displacements per pixel: in rows down a view, in columns to the right."""
        down, right = (
            2.0 / max(n - 1, 1) * _values(legder(series[..., axis, :, :], axis=axis - 2), self.size)
            for axis, n in enumerate(self.size)
        )
        return np.stack([down, right], axis=-3)

    def object_z(self, disparity: Floats) -> Floats:
        """Axial positions of the planes of given disparities of the model, in the axes of the lens, mm."""
        lever = disparity / self.per_lever
        with np.errstate(divide="ignore", invalid="ignore"):
            return object_z(self.planes, lever / (1.0 - lever * self.vergence))

    def disparity(self, camera: PlenopticCamera, z: float) -> float:
        """The model's disparity of the plane z."""
        return self.per_lever * _lever(image_distance_behind_array(camera, z), self.vergence)


def view_model(
    camera: PlenopticCamera,
    offsets: tuple[Floats, Floats],
    positions: Floats,
    origin: Floats,
    spacing: tuple[float, float],
) -> ViewModel:
    """Model of views (u, v) whose pixels have positions (rows, columns, 4): `pixel` and `on_array`.

    Rays of some pixels of all views are traced; the models of the last cameras are kept.
    """
    rows, columns = positions.shape[:2]
    nodes = [np.unique(np.rint(np.linspace(0, n - 1, min(n, _NODES)))).astype(np.int64) for n in (rows, columns)]
    row, column = (index.ravel() for index in np.meshgrid(*nodes, indexing="ij"))
    known = np.isfinite(positions[row, column]).all(axis=1)
    traced = np.column_stack([row, column, positions[row, column]])[known]
    u, v = (tuple(offset.tolist()) for offset in offsets)
    parts = (positions[..., None, axis] + offset for axis, offset in ((1, offsets[0]), (0, offsets[1])))
    wide = tuple(tuple(np.nanmean(4.0 * (x % 1.0) * (-x % 1.0), axis=(0, 1)).tolist()) for x in parts)
    return _traced_model(camera, (rows, columns), traced.tobytes(), ((u, v), wide), tuple(origin.tolist()), spacing)


@functools.lru_cache(maxsize=8)
def _traced_model(
    camera: PlenopticCamera,
    size: tuple[int, int],
    nodes: bytes,
    across_and_down: tuple[tuple[tuple[float, ...], ...], tuple[tuple[float, ...], ...]],
    origin: tuple[float, ...],
    spacing: tuple[float, float],
) -> ViewModel:
    """`view_model` as a function of values: `nodes` (n, 6) are row, column and position of pixels.

    `across_and_down` are offsets, and the part of the pixels' light that falls onto two at once.
    """
    array, axes = camera.microlenses, array_axes(camera)
    assert array is not None
    vergence = 1.0 / (camera.stop_to_microlenses - model_pupil(camera)[0])
    per_lever = camera.sensor.pixel_pitch / (camera.microlenses_to_sensor * spacing[0])
    planes = _planes(camera, vergence, per_lever)
    offsets, wide = (tuple(np.array(numbers) for numbers in pair) for pair in across_and_down)
    table = np.frombuffer(nodes).reshape(-1, 6)
    (row, column), positions = table[:, :2].T.astype(np.int64), table[:, 2:]
    u, v = np.meshgrid(*offsets, indexing="ij")
    step = np.stack([v * spacing[0] / spacing[1], u], axis=-1)
    footprints = _footprints(camera, offsets, wide, positions)
    light = footprints.sums(np.ones(footprints.mask.shape))
    pixel_slope = camera.sensor.pixel_pitch / camera.microlenses_to_sensor
    opening = math.sqrt(2.0 * aperture_variance(array)) * np.array([(1, 0), (-1, 0), (0, 1), (0, -1)])
    # cos^4 of the angle to the axis moves the centre of a pixel's light on the microlens towards the pixel.
    slopes = pixel_slope * np.stack([v, u], axis=-1)[..., None, :] - opening / camera.microlenses_to_sensor
    cos4 = (1.0 + (slopes**2).sum(axis=-1)) ** -2.0
    towards_pixel = (cos4 @ opening) / cos4.sum(axis=-1, keepdims=True)
    displacement = []
    for plane in planes:
        points = plane.magnification * plane_intersections(footprints.rays, plane.z)
        image = np.column_stack([points, np.full(len(points), plane.z_image)])
        on_array = axes.parts.local_to_lens.inverse().points(image)[:, :2] / (1.0 + plane.behind * vergence)
        # The sensor is read out rotated by 180 degrees: columns run towards -x, rows towards +y. (U, V, nodes, 2)
        sums = [footprints.sums(along) for along in (on_array[:, 1] - origin[1], origin[0] - on_array[:, 0])]
        central = np.stack(sums, axis=-1) / np.maximum(light, 1e-12)[..., None]
        central = (central + towards_pixel[:, :, None]) / spacing[::-1]
        modelled = central - plane.disparity_per_pitch * step[:, :, None]
        displacement.append(np.stack([row, column], axis=-1) - modelled)
    both = np.stack(linear_in_disparity(planes, np.stack(displacement)))
    both[:, light == 0] = np.nan
    mean_light = light.mean(axis=-1)
    mean_light[mean_light < _CLEAR * mean_light.max()] = 0.0
    at_axis = -origin[1] / spacing[1], origin[0] / spacing[0]
    nearest_row, nearest_column = (int(np.clip(np.rint(k), 0, n - 1)) for k, n in zip(at_axis, size, strict=True))
    series = _fit(both, row, column, size)
    return ViewModel(planes, vergence, per_lever, step, series, mean_light, size, (nearest_row, nearest_column))


class _Footprints(NamedTuple):
    """Rays from samples of the pixels around n points, and their weights in views.

    A view reads four pixels with bilinear weights, each over all of its area.
    """

    rays: RayBundle
    mask: Floats
    """(n, r, c): 1 for rays that pass the lens, 0 for others."""
    in_row: Floats
    """(n, V, r): weights of rows of samples, of sum 1."""
    in_column: Floats
    """(n, U, c)."""

    def sums(self, values: Floats) -> Floats:
        """Weighted sums (U, V, n) of values of the rays."""
        passed = np.where(self.mask > 0, values.reshape(self.mask.shape), 0.0)
        return np.moveaxis(self.in_row @ passed @ self.in_column.swapaxes(1, 2), (0, 1, 2), (2, 1, 0))


def _footprints(
    camera: PlenopticCamera, offsets: tuple[Floats, ...], wide: tuple[Floats, ...], positions: Floats
) -> _Footprints:
    """Footprints of views at points with positions (n, 4)."""
    array, axes = camera.microlenses, array_axes(camera)
    assert array is not None
    pixel, passed, pitch = positions[:, None, :2], positions[:, None, 2:], camera.sensor.pixel_pitch
    (in_row, row), (in_column, column) = (
        _footprint_weights(offsets[k], wide[k], pixel[..., 1 - k], pitch / camera.microlenses_to_sensor) for k in (1, 0)
    )
    at = np.rint(pixel) + np.stack(np.meshgrid(row, column, indexing="ij"), axis=-1).reshape(-1, 2)
    on_array = np.broadcast_to(passed, at.shape).reshape(-1, 2)
    rays = chief_rays(axes, array, at.reshape(-1, 2), on_array, 1, clipping=True)
    mask = (rays.status == 0).reshape(-1, len(row), len(column)).astype(np.float64)
    return _Footprints(rays, mask, in_row, in_column)


def _footprint_weights(offsets: Floats, wide: Floats, pixel: Floats, slope: float) -> tuple[Floats, Floats]:
    """Weights (n, U, s) of samples in the footprints of views at pixels (n, 1), and their positions (s,).

    Positions are counted from the nearest whole pixel. Footprints are a pixel wide where views meet pixels, two wide
    halfway between, and in the mean over all fractions a quadratic B-spline. Light falls off by cos^4 of the slopes.
    """
    whole = np.arange(math.floor(offsets.min()) - 2, math.ceil(offsets.max()) + 3)
    samples = (whole[:, None] + (np.arange(_RAYS) + 0.5) / _RAYS - 0.5).ravel()
    distance = np.abs(samples - (pixel - np.rint(pixel) + offsets)[..., None])
    narrow, broad = (np.clip(half + 0.5 / _RAYS - distance, 0.0, 1.0 / _RAYS) / half / 2 for half in (0.5, 1.0))
    spline = np.where(distance < 0.5, 0.75 - distance**2, 0.5 * np.maximum(1.5 - distance, 0.0) ** 2) / _RAYS
    few, many = (np.maximum(part, 0.0)[:, None] for part in (1.0 - 1.5 * wide, 3.0 * wide - 2.0))
    weight = few * narrow + many * broad + (1.0 - few - many) * spline
    weight = weight / (1.0 + (slope * samples) ** 2) ** 2
    return weight / weight.sum(axis=-1, keepdims=True), samples


def _fit(values: Floats, row: NDArray[np.int64], column: NDArray[np.int64], size: tuple[int, int]) -> Floats:
    """Legendre series (2, U, V, 2, k, l) that fit values (2, U, V, n, 2) at n pixels of the views."""
    terms = [min(len(np.unique(index)), _TERMS) for index in (row, column)]
    tables = [legvander(_unit(index, n), k - 1) for index, n, k in zip((row, column), size, terms, strict=True)]
    table = np.einsum("nk,nl->nkl", *tables).reshape(len(row), -1)
    shape, count = values.shape[1:3], len(row)
    right = values.transpose(1, 2, 3, 0, 4).reshape(-1, count, 4)
    series = np.full((len(right), table.shape[1], 4), np.nan)
    valid = np.isfinite(right).all(axis=2)
    for mask in np.unique(valid, axis=0):
        alike = (valid == mask).all(axis=1)
        if mask.any():
            columns = np.moveaxis(right[alike][:, mask], 1, 0).reshape(mask.sum(), -1)
            fitted = np.linalg.lstsq(table[mask], columns, rcond=1e-9)[0]
            series[alike] = np.moveaxis(fitted.reshape(table.shape[1], -1, 4), 0, 1)
    return series.reshape(*shape, *terms, 2, 2).transpose(4, 0, 1, 5, 2, 3)


def _values(series: NDArray[np.floating], size: tuple[int, int]) -> Floats:
    """Values (..., rows, columns) of Legendre series (..., k, l) in row and column of a view."""
    rows, columns = (legvander(_unit(np.arange(n), n), k - 1) for n, k in zip(size, series.shape[-2:], strict=True))
    return np.asarray(rows @ series @ columns.T)


def _unit(index: NDArray[np.int64] | Floats, count: int) -> Floats:
    """Indices of `count` rows or columns as numbers from -1 to 1."""
    return np.asarray(2.0 * index / (count - 1) - 1.0 if count > 1 else 0.0 * index)


def _lever(behind: float, vergence: float) -> float:
    """E D / (D + e), of an image e behind the array and a pupil D in front of it."""
    if math.isinf(behind):
        return 1.0 / vergence if vergence else behind
    return behind / (1.0 + behind * vergence)


def _planes(camera: PlenopticCamera, vergence: float, per_lever: float) -> PlanePair:
    """Two object planes in front of the lens that have images at finite distances."""
    planes = []
    for distance in _DISTANCES:
        z = lens_front_z(camera) - distance * camera.stop_to_microlenses
        z_image = image_plane(camera.lens, z, camera.wavelength)
        if math.isfinite(z_image):
            behind = z_image - camera.stop_to_microlenses
            magnification = lateral_magnification(camera.lens, z, camera.wavelength)
            planes.append(ObjectPlane(z, z_image, per_lever * _lever(behind, vergence), behind, magnification))
    return planes[0], planes[1]
