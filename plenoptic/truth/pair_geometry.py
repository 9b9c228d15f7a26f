"""Geometry of pairs of images by dual pixels: disparity, defocus, light of both halves; from traced rays."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.camera_rays import CameraRays
from plenoptic.camera.camera_record import camera_record, response_record
from plenoptic.camera.gaussian import image_plane, object_plane
from plenoptic.camera.sampling.aperture_regions import illuminated_pixels
from plenoptic.camera.sampling.sampling_records import batch_record
from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, STATUS, WEIGHT, L, M, N, X, Y, Z
from plenoptic.core.values import Floats, broadcast, check_kind, numbers, result
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.microlens.kernels.to_lens import fill_well_response
from plenoptic.optics.microlens.microlens_record import SensorPlane, WellsRecord
from plenoptic.optics.sensor.dual_pixel_sensor import wells_of
from plenoptic.optics.sensor.dual_pixels import DualPixels

_NODES, _DEGREE, _SAMPLES, _PUPIL = 13, 6, 1 << 16, 1 << 11
"""Nodes along each side of the sensor, degree of the polynomials through them, rays of a node, and those that are kept
for blur."""
_ROUNDING = 1e-12
_ORDERS = [(i, j) for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i)]


@result
class PairGeometry:
    """Disparity and light of the pairs of a camera with dual pixels, traced through its lens. See `pair_geometry`.

    Arrays (H, W) are those of a region of the sensor, its first and end row and column; of the whole sensor for None.
    They are nan near and beyond the places where a half gets no light, but for an asymmetry of 1 or -1.

    Attributes
    ----------
    camera : PlenopticCamera
    coefficients : (5, 7, 7) array
        Legendre polynomials over the field by orders along rows and columns, before crosstalk: share of the left half,
        difference of the halves' centroids in the plane z = 0 and by z, and the centroid of the pixel's beam, all rays
        that pass the lens, in that plane and by z.
    pupils : (13, 13, n, 6) array
        Rays in front of the lens of pixels on a grid over the field, to its ends: x and -y, along columns and rows, in
        the plane z = 0 and by z, relative to the centroid of the pixel's beam; and the light of both halves before
        crosstalk, which adds up to 1. 0 where a half is dark.
    lit : (12, 12) array
        Parts of the field: 0 where both halves get light at all corners, 1 where the left one alone does and -1 where
        the right one, nan elsewhere.
    """

    camera: PlenopticCamera
    coefficients: Floats
    pupils: Floats
    lit: Floats

    def disparity(self, depth: ArrayLike, *, region: tuple[int, int, int, int] | None = None) -> Floats:
        """Signed disparity (H, W) of pixels in pixels, for depths in mm, one or (H, W); inf is allowed.

        The column of a point in the left image minus that in the right one: positive for points nearer than the plane
        in focus. With X_L(c) and X_R(c), the centroids of the light of both halves of pixel c in the plane of the
        depth, and X(c), that of the pixel's whole beam, it is (X_R - X_L) / (dX/dc): the distance between the centroids
        of both images of a point. Halves are those after crosstalk between wells: a scalar crosstalk q takes q of the
        disparity and adds q / 2 pixels, since the wells at a pixel's sides share light with the next pixels.
        """
        _, a, b, c, d = self._features(region)
        depths, _ = broadcast(depth=_checked_depths(depth), region=a)
        inverse_z = -1.0 / depths
        return np.asarray(-(a * inverse_z + b) / (c * inverse_z + d))

    def depth(self, disparity: ArrayLike, *, region: tuple[int, int, int, int] | None = None) -> Floats:
        """Depths (H, W) in mm of pixels with signed disparities, one or (H, W); nan beyond that of infinity."""
        _, a, b, c, d = self._features(region)
        pixels, _ = broadcast(disparity=disparity, region=a)
        to_infinity = b + pixels * d
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = np.where(np.abs(to_infinity) <= _ROUNDING * np.abs(b), math.inf, (a + pixels * c) / to_infinity)
        return np.where(depth > 0, depth, np.nan)

    def defocus(self, depth: ArrayLike) -> Floats:
        """Distances in mm by which the paraxial images of points of depths in mm lie behind the sensor."""
        lens, wavelength, z_sensor = self.camera.lens, self.camera.wavelength, self.camera.z_sensor
        front, rear = object_plane(lens, math.inf, wavelength), image_plane(lens, -math.inf, wavelength)
        # Newton's equation: (z - front) (z' - rear) is the same for all pairs of planes.
        product = (object_plane(lens, z_sensor, wavelength) - front) * (z_sensor - rear)
        return np.asarray(rear - product / (_checked_depths(depth) + front) - z_sensor)

    def asymmetry(self, *, region: tuple[int, int, int, int] | None = None) -> Floats:
        """Vignetting asymmetry (H, W) of a white image: (left - right) / (left + right)."""
        return np.asarray(2.0 * self._features(region)[0] - 1.0)

    def blur(self, disparity: ArrayLike, *, node: tuple[int, int] = (_NODES // 2, _NODES // 2)) -> Floats:
        """Columns and rows (..., n, 2) by which the rays of one of `pupils` displace images of points.

        The points have disparities (...) in pixels. The rays are those of the centre, or of another node, a row and
        column of the grid; nan where a half is dark.
        """
        rows, columns = self.pupils.shape[:2]
        if node not in list(np.ndindex(rows, columns)):
            raise InvalidValueError(f"node is {node!r:.60}; give a row and column of {rows} x {columns} nodes")
        pixels, (v, u) = numbers(disparity, "disparity")[..., None, None], np.array(node) / (_NODES // 2) - 1.0
        _, a, b, c, d = self._values(np.array([v]), np.array([u]))[:, 0, 0]
        inverse_z, rays = -(b + pixels * d) / (a + pixels * c), self.pupils[node]
        return np.asarray(-(rays[:, :2] * inverse_z + rays[:, 2:4]) / (c * inverse_z + d))

    def _features(self, region: tuple[int, int, int, int] | None) -> Floats:
        """(5, H, W) share, differences of the halves' centroids, and derivatives of the beam's centroid by columns."""
        rows, columns = self.camera.sensor.shape
        ends = np.array([0, rows, 0, columns]) if region is None else numbers(region, "region")
        top, bottom, left, right = ends if ends.shape == (4,) else np.zeros(4)
        if not (0 <= top < bottom <= rows and 0 <= left < right <= columns and (ends == np.round(ends)).all()):
            raise InvalidValueError(
                f"region is {region!r:.60}; give the first and end row, and the first and end column, of a part of "
                f"{rows} x {columns} pixels"
            )
        v, u = (2.0 * np.arange(top, bottom) + 1.0) / rows - 1.0, (2.0 * np.arange(left, right) + 1.0) / columns - 1.0
        return self._values(v, u)

    def _values(self, v: Floats, u: Floats) -> Floats:
        """Features (5, n, m), after crosstalk, at places along columns and rows in half sides from the centre."""
        by_row, by_column, orders = _powers(v), _powers(u), np.eye(_DEGREE + 1)
        by_u = np.polynomial.legendre.legval(u, np.polynomial.legendre.legder(orders))
        left_part, *differences = by_row.T @ self.coefficients[:3] @ by_column
        rows, columns = (np.minimum((0.5 * at + 0.5) * len(self.lit), len(self.lit) - 1).astype(int) for at in (v, u))
        lit = self.lit[np.ix_(rows, columns)]
        left_part = np.where(lit == 0, np.clip(left_part, 0.0, 1.0), 0.5 + 0.5 * lit)
        differences = [np.where(lit == 0, difference, np.nan) for difference in differences]
        slopes = by_row.T @ self.coefficients[3:] @ by_u * (2.0 / self.camera.sensor.shape[1])
        # Each half keeps a part of its light and gives others to its sides: to the other half of its own pixel, and to
        # that of the next pixel, a column away.
        to_left, retention, to_right = wells_of(self.camera.sensor).crosstalk.sum(axis=0)
        crosstalk = to_left + to_right
        left, right = (
            retention * left_part + crosstalk * (1.0 - left_part),
            retention * (1.0 - left_part) + crosstalk * left_part,
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            factor = 1.0 - crosstalk * ((1.0 - left_part) / left + left_part / right)
            by_columns = to_right * (1.0 - left_part) / left + to_left * left_part / right
        return np.stack([left, *(factor * differences - by_columns * slopes), *slopes])


def _checked_depths(depth: ArrayLike) -> Floats:
    depths = numbers(depth, "depth")
    if (depths <= 0).any():
        raise InvalidValueError(f"depth holds {np.nanmin(depths):g} mm; it must be above 0")
    return depths


def _powers(at: Floats) -> Floats:
    """Legendre polynomials (orders, n) at n places."""
    return np.asarray(np.polynomial.legendre.legvander(at, _DEGREE).T)


def pair_geometry(camera: PlenopticCamera) -> PairGeometry:
    """Trace the geometry of the pairs of a camera with dual pixels: the truth of disparity, defocus and light.

    65 536 rays of each of 169 pixels go through the lens. Their centroids, weighted by the responses of both halves,
    are fitted by polynomials of order 6 over the field.

    Parameters
    ----------
    camera : PlenopticCamera
        A camera without microlens array whose sensor is one of `dual_pixel`. Its pose does not matter.

    Raises
    ------
    InvalidValueError
        If the sensor has no dual pixels, the camera has microlenses or no lens, or the field is mostly dark.

    Examples
    --------
    >>> import plenoptic as pl
    >>> sensor = pl.sensor.dual_pixel(0.0054, (40, 60))
    >>> lens = pl.load_lens("double-gauss-100mm-f2").scaled(focal_length=50.0).with_model(pl.LensModel.PARAXIAL)
    >>> camera = pl.PlenopticCamera(lens, sensor, 60.0).focused_at(-2000.0)
    >>> geometry = pl.sensor.pair_geometry(camera)
    >>> [round(float(geometry.disparity(depth)[20, 30])) for depth in (1500.0, 2000.0, 3000.0)]
    [16, 0, -16]
    """
    check_kind(
        camera, "camera", PlenopticCamera, "pl.PlenopticCamera(lens, pl.sensor.dual_pixel(pitch, shape), distance)"
    )
    pixels = wells_of(camera.sensor)
    if camera.microlenses is not None or camera.lens.model is LensModel.NONE:
        raise InvalidValueError("pairs need a lens, and no microlens array: its microlenses are those on the pixels")
    plain = dataclasses.replace(camera.sensor, angular_response=None)
    plain_camera = dataclasses.replace(camera, pose=None, sensitivity=None, diffraction=None, sensor=plain)
    v, u = (part.ravel() for part in np.meshgrid(*2 * [np.linspace(-1.0, 1.0, _NODES)], indexing="ij"))
    nodes = (np.stack([v, u], axis=1) + 1.0) * camera.sensor.shape / 2 - 0.5
    features, pupils = _trace(plain_camera, pixels, nodes)
    lit, asymmetry = np.isfinite(features[:, 1]), (2.0 * features[:, 0] - 1.0).reshape(_NODES, _NODES)
    corners = np.stack([asymmetry[:-1, :-1], asymmetry[:-1, 1:], asymmetry[1:, :-1], asymmetry[1:, 1:]])
    one_half = np.where(np.abs(corners.sum(axis=0)) == len(corners), corners[0], np.nan)
    parts = np.where((np.abs(corners) < 1).all(axis=0), 0.0, one_half)
    # As many orders as there are places.
    rows, columns = (lit.reshape(_NODES, _NODES).any(axis=axis).sum() for axis in (1, 0))
    orders = [(i, j) for i, j in _ORDERS if i < rows and j < columns]
    if lit.sum() < 2 * len(_ORDERS) or parts[_NODES // 2, _NODES // 2] != 0:
        raise InvalidValueError(
            f"{np.sum(~lit)} of {lit.size} places on the sensor get no light in one of the halves; take a smaller "
            "sensor, or a cra nearer to the chief rays of the lens"
        )
    terms = np.stack([_powers(v)[i] * _powers(u)[j] for i, j in orders], axis=1)
    coefficients = np.zeros((5, _DEGREE + 1, _DEGREE + 1))
    coefficients[:, *np.transpose(orders)] = np.linalg.lstsq(terms[lit], features[lit], rcond=None)[0].T
    return PairGeometry(camera, coefficients, pupils.reshape(_NODES, _NODES, _PUPIL, 6), parts)


def _trace(camera: PlenopticCamera, pixels: DualPixels, nodes: Floats) -> tuple[Floats, Floats]:
    """Features (n, 5) of nodes (n, 2) in rows and columns, and rays (n, rays, 6), see `PairGeometry.pupils`.

    Where a half is dark, the part of the left half alone is finite; where both are, none.
    """
    record = camera_record(camera)
    parts, to_local = record.parts, record.parts.sensor_to_local
    local = to_local.points(np.column_stack([camera.sensor.centre_of(*nodes.T), np.zeros(len(nodes))]))
    illuminated = illuminated_pixels(record, np.ascontiguousarray(local[:, :2]), np.zeros(len(nodes), np.int64))
    camera_rays = CameraRays(record, illuminated, batch_record(np.uint64(0), 0, _SAMPLES, 1, 0, 0), _SAMPLES)
    halves = [_half_record(camera, pixels, column) for column in (0, 1)]
    features, pupils = np.full((len(nodes), 5), np.nan), np.zeros((len(nodes), _PUPIL, 6))
    for k, node in enumerate(illuminated.place):
        bundle = camera_rays.sample(k * _SAMPLES, _SAMPLES)
        responses = _responses(bundle, record.sensor.plane, halves)
        camera_rays.fill_through_array(bundle)
        camera_rays.fill_through_lens(bundle)
        fields = bundle.reshape(-1, RAY // BLOCK, BLOCK)
        arrived = fields[:, STATUS // BLOCK] == 0
        point, direction = (
            np.stack([fields[:, row // BLOCK][arrived] for row in rows]) for rows in ((X, Y, Z), (L, M, N))
        )
        weights = responses[:, arrived] * fields[:, WEIGHT // BLOCK][arrived]
        if parts.lens_to_camera is not None:
            point, direction = parts.lens_to_camera.points(point.T).T, parts.lens_to_camera.directions(direction.T).T
        light = weights.sum(axis=1)
        if not light.any():
            continue
        shares = light / light.sum()
        features[node, 0] = shares[0]
        if not light.all():
            continue
        weights /= light[:, None]
        slopes = direction[:2] / direction[2]
        planes = np.stack([point[:2] - slopes * point[2], slopes]) * [[1.0], [-1.0]]
        (left, right), beam = weights @ planes[:, 0].T, planes.mean(axis=2)
        features[node] = [shares[0], *(left - right), *beam[:, 0]]
        kept, weights = planes[..., :_PUPIL] - beam[..., None], weights[:, :_PUPIL]
        weights = weights / np.maximum(weights.sum(axis=1, keepdims=True), _ROUNDING) * shares[:, None]
        pupils[node, : kept.shape[-1]] = np.concatenate([*kept, weights]).T
    return features, pupils


def _half_record(camera: PlenopticCamera, pixels: DualPixels, column: int) -> WellsRecord:
    """Wells of one half of the pixels, in all rows."""
    half = dataclasses.replace(pixels, split=(1, 2), well=(0, column))
    reading = dataclasses.replace(camera, sensor=dataclasses.replace(camera.sensor, angular_response=half))
    record = response_record(reading, camera_record(camera).parts)
    assert isinstance(record, WellsRecord)
    return record._replace(rows=dataclasses.replace(pixels, well=None).intervals(0))


def _responses(bundle: Floats, plane: SensorPlane, halves: list[WellsRecord]) -> Floats:
    """Responses (2, n / BLOCK, BLOCK) of the wells of both halves to n aimed samples, whose weights are kept."""
    weights = bundle.reshape(-1, RAY // BLOCK, BLOCK)[:, WEIGHT // BLOCK]
    kept, responses = weights.copy(), np.empty((2, *weights.shape))
    for half, response in zip(halves, responses, strict=True):
        weights[:] = 1.0
        fill_well_response(bundle, plane, half)
        response[:] = weights
    weights[:] = kept
    return responses
