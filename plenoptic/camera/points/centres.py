"""Centres of the micro images on the sensor, and chief rays, which come from the centre of the exit pupil."""

from __future__ import annotations

import dataclasses
import enum
import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from plenoptic.camera.assembly import ArrayAxes, array_axes, sensor_corners
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.gaussian import model_pupil
from plenoptic.camera.points.centroids import lit_centroids
from plenoptic.camera.points.micro_image_models import to_complex
from plenoptic.camera.points.white_centroids import white_centroids
from plenoptic.camera.points.white_fit import lattice_shift
from plenoptic.core.display import picture_of
from plenoptic.core.progress.bar import CallProgress
from plenoptic.core.values import Floats, check_kind, choice, coordinate, result
from plenoptic.core.warn import warn
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.pupil.ray_aiming import aimed_rays_reverse
from plenoptic.optics.microlens.aperture import Walls
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lattice import Lattice
from plenoptic.optics.microlens.lenslets import Lenslets

if TYPE_CHECKING:
    from plenoptic.rendering.exposure import Exposure

_SEARCH_MARGIN = 0.1
"""Margin of the search for microlenses over the sensor's size, for aberrations of the pupil."""
_MIN_IMAGE_SPACING = 0.1
"""Least spacing of images over that of microlenses for which all microlenses are listed."""
_RADII, _DEGREE = 48, 14
"""Traced fields of a centred lens, and degree of the polynomial in the squared radius that is fitted to them."""
_MIN_LOCATED = 64
"""Number of micro images in a white image from which on their lattice is expected to be found."""
_SIDE = 13
"""Traced fields along x and along y without rotational symmetry."""


def aimed_slopes(axes: ArrayAxes, points: Floats) -> Floats:
    """Aim reverse rays from points (n, 2) of the array at the iris's centre; return slopes dx/dz, dy/dz (n, 2).

    nan if no ray passes. Points and slopes are in local axes, see `array_axes`.
    """
    camera = axes.camera
    direction = np.full((len(points), 3), np.nan)
    for k, (x, y, z) in enumerate(axes.in_lens(points).tolist()):
        ray = aimed_rays_reverse(
            camera.lens, image_point=(x, y), z_image=z, pupil=np.zeros((1, 2)), wavelength=camera.wavelength
        )
        if ray.status[0] == 0:
            direction[k] = ray.direction[0]
    return axes.slopes_of(direction)


def chief_slopes(axes: ArrayAxes, points: Floats) -> Floats:
    """Slopes (n, 2) of chief rays at many points (n, 2): aimed at some fields, interpolated between them.

    With rotational symmetry, slope over radius is a polynomial of degree 14 in the squared radius, fitted to 48 fields
    up to the largest radius; otherwise slopes are polynomials of degree 12 in x and in y, through 13 x 13 fields. Up to
    that number of points, each one is aimed. nan beyond the first field without a chief ray.
    """
    if len(points) <= (_RADII if axes.lens_is_centred else _SIDE * _SIDE):
        return aimed_slopes(axes, points)
    return _interpolate_radial(axes, points) if axes.lens_is_centred else _interpolate_grid(axes, points)


def _interpolate_radial(axes: ArrayAxes, points: Floats) -> Floats:
    radius = np.hypot(points[:, 0], points[:, 1])
    largest = float(radius.max())
    # Chebyshev nodes in the radius; none is 0, at which slope over radius is a limit.
    traced = largest * np.cos(math.pi * (np.arange(_RADII) + 0.5) / (2 * _RADII))[::-1]
    slopes = aimed_slopes(axes, np.stack([traced, np.zeros(_RADII)], axis=1))[:, 0]
    is_valid = np.isfinite(slopes)
    n_valid = _RADII if is_valid.all() else int(np.argmin(is_valid))
    if n_valid == 0:
        return np.full(points.shape, np.nan)
    valid_radius = float(traced[n_valid - 1]) if n_valid < _RADII else largest
    knots = 2 * (traced[:n_valid] / valid_radius) ** 2 - 1
    series = chebyshev.chebfit(knots, slopes[:n_valid] / traced[:n_valid], min(_DEGREE, n_valid - 1))
    slope_over_radius = chebyshev.chebval(2 * np.minimum(radius / valid_radius, 1.0) ** 2 - 1, series)
    return np.asarray(np.where(radius <= valid_radius, slope_over_radius, np.nan)[:, None] * points)


def _interpolate_grid(axes: ArrayAxes, points: Floats) -> Floats:
    low, high = points.min(axis=0), points.max(axis=0)
    middle, half = (low + high) / 2, np.maximum((high - low) / 2, 1e-9)
    knots = np.cos(math.pi * (np.arange(_SIDE) + 0.5) / _SIDE)
    grid = np.stack(np.meshgrid(knots, knots, indexing="ij"), axis=-1).reshape(-1, 2)
    slopes = aimed_slopes(axes, middle + half * grid)
    if not np.isfinite(slopes).all():
        # With conditions missing, the polynomial would oscillate at the edge of the field.
        return aimed_slopes(axes, points)
    degrees = [_SIDE - 1, _SIDE - 1]
    series = np.linalg.solve(chebyshev.chebvander2d(grid[:, 0], grid[:, 1], degrees), slopes)
    normalised = (points - middle) / half
    return np.asarray(chebyshev.chebvander2d(normalised[:, 0], normalised[:, 1], degrees) @ series)


class CentreMethod(enum.IntEnum):
    """Definition of the centre of a micro image; without vignetting CHIEF_RAY and CENTROID nearly agree.

    Examples
    --------
    >>> import plenoptic as pl
    >>> [method.name for method in pl.CentreMethod]
    ['ORTHOGONAL', 'CHIEF_RAY', 'CENTROID']
    """

    ORTHOGONAL = 0
    """The microlens's optical centre, projected onto the sensor along the array's normal."""
    CHIEF_RAY = 1
    """The intersection with the sensor of the ray through the centres of the real iris and of the microlens: the image
    of the centre of the exit pupil."""
    CENTROID = 2
    """The centroid of the light of a uniform white scene through the microlens's cell, as in a white image."""


@result
class MicrolensCentres:
    """Centres of micro images, one per row. See `microlens_centres`, which makes it.

    Parameters
    ----------
    index : (n, 2) array of int
        Lattice indices (i, j); in FREE lattices (number, 0).
    type : (n,) array of int
        Row of the array's `focal_lengths`.
    on_array : (n, 2) array
        The microlenses' optical centres on the array's plane, x and y in mm; of flat glass, the middle of its opening.
    position, pixel : (n, 2) array
        Centres of their images on the sensor: x and y in mm, and row and column, whole numbers at centres of pixels.
    method : CentreMethod
        Definition of the centres.
    """

    index: NDArray[np.int64]
    type: NDArray[np.int64]
    on_array: Floats
    position: Floats
    pixel: Floats
    method: CentreMethod

    def __len__(self) -> int:
        return len(self.index)

    def __repr__(self) -> str:
        return f"MicrolensCentres({len(self)} microlenses, {self.method.name})"

    _repr_html_ = picture_of


def microlens_centres(
    camera: PlenopticCamera,
    method: CentreMethod = CentreMethod.CHIEF_RAY,
    *,
    white: Exposure | None = None,
    margin: float = 0.0,
    progress: bool = True,
) -> MicrolensCentres:
    """Compute the centres of all micro images on the sensor.

    Parameters
    ----------
    camera : PlenopticCamera
        With microlenses.
    method : CentreMethod, optional
        ORTHOGONAL, CHIEF_RAY or CENTROID. With vignetting all three differ; without it, CHIEF_RAY and CENTROID agree
        except for aberrations of the pupil and the illumination fall-off across an image.
    white : Exposure, optional
        For CENTROID: a white image of this camera, whose pixels are used in place of the geometry; incomplete micro
        images are left out. The centroid is over the cell around each CHIEF_RAY: it includes light of overlapping
        neighbours and excludes light of the image outside its cell, as of a missing lens. If the lattice of the image
        is displaced by more than 0.1 pixels from the camera's, chief rays are displaced with it, as
        `PlenopticCamera.fitted_to` does; a warning says where it cannot be located. Steps of the whole lattice cannot
        be seen: the centre of the image is displaced by at most half a pitch.
    margin : float, optional
        Largest distance of centres outside the sensor, in mm; negative: least distance inside.
    progress : bool, optional
        True: show a progress bar, or that kernels are compiled, from the second second on.

    Returns
    -------
    MicrolensCentres
        In the order of their indices, without microlenses that the chief ray, or for CENTROID any light, does not
        reach.

    Raises
    ------
    InvalidValueError
        For cameras without microlenses; if a white image is given for another method than CENTROID or does not match
        the camera; for CENTROID with walls.

    Notes
    -----
    The chief ray, at the camera's `wavelength`, is traced in reverse from the microlens through the centre of the real
    iris; with a lens that is not LensModel.EXACT, through the centre of the pupil of that model. It is traced for some
    fifty fields, more if parts are tilted, and interpolated by a polynomial (to 1e-9 mm for the double Gauss and a
    fisheye up to 20 mm from the axis). In plates (SPHERICAL, FLAT_HIGH_INDEX) it is the ray through the vertex of the
    curved side, which leaves the plate parallel to itself.

    Centroids are sums over rays from four points of the opening to 32 lines across the pupil, with their ends located
    by bisection; above 1089 microlenses of a type the difference from the chief ray is interpolated between 33 x 33
    fields. Both are accurate to some 0.01 pixels of 10 micrometres, less at the edge of the light. Microlenses are
    ideal there, between their principal planes, without aberrations. Openings that differ have their own centroids and
    the median of all second moments.

    Deviations of single microlenses (`imperfections`) displace their centres, and parts stand as built: a lens that is
    displaced, or whose neighbours in a FREE lattice are uneven, is clipped by its cell, which is not displaced. Light
    through clear gaps between openings contributes to the centroid. The optical centre of a missing lens is the centre
    of its opening. Dust and the angular response of the sensor are ignored, except in a white image. Microlenses
    between walls (`Walls.OPAQUE`) are separate cameras: their chief rays are along the array's normal.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.camera.example_camera(pl.CameraKind.PLENOPTIC_1, shape=(64, 64), lattice=pl.Lattice.SQUARE)
    >>> centres = pl.microlens_centres(camera)
    >>> centres.pixel[4].tolist(), (centres.pixel[4] - centres.pixel[3]).round(3).tolist()
    ([31.5, 31.5], [22.01, 0.0])
    """
    check_kind(camera, "camera", PlenopticCamera, "pl.PlenopticCamera(...)")
    method, margin = choice(method, CentreMethod, "method"), coordinate(margin, "margin")
    array = camera.microlenses
    if array is None:
        raise InvalidValueError("the camera has no microlenses, so there are no centres; give it a MicrolensArray")
    if white is not None and method is not CentreMethod.CENTROID:
        raise InvalidValueError(
            f"a white image is given, but {method.name} does not use it; use CentreMethod.CENTROID or leave it out"
        )
    if array.walls is Walls.OPAQUE and method is CentreMethod.CENTROID:
        raise InvalidValueError(
            "walls end the image of each microlens at its cell, and centroids are not defined for them; take "
            "CentreMethod.CHIEF_RAY"
        )
    with CallProgress("finding centres", kind="camera", show=progress):
        return _centres(camera, array, method, white, margin)


def _centres(
    camera: PlenopticCamera, array: MicrolensArray, method: CentreMethod, white: Exposure | None, margin: float
) -> MicrolensCentres:
    axes = array_axes(camera)
    lenses = _lenses_near_sensor(axes, array, margin)
    if array.model.focuses:
        # Flat glass has no optical axis.
        is_flat = (lenses.power == 0)[:, None]
        lenses = dataclasses.replace(lenses, axis=np.where(is_flat, lenses.centre, lenses.axis))
    centres = axes.local(lenses.axis)
    is_orthogonal = array.walls is Walls.OPAQUE or method is CentreMethod.ORTHOGONAL
    slopes = np.zeros_like(centres) if is_orthogonal else chief_slopes(axes, centres)
    position = axes.on_sensor(
        array.model.refraction.shift_chief_rays(array, centres, slopes, camera.wavelength, True), slopes
    )
    if method is CentreMethod.CENTROID:
        if white is None:
            position = lit_centroids(axes, array, lenses, slopes)
        else:
            chief = _on_sensor(camera, lenses, position, CentreMethod.CHIEF_RAY, 0.0)
            position = position + _white_shift(camera, white, chief, position)
            position = white_centroids(axes, array, white, lenses.design, position, _image_spacing(axes))
    return _on_sensor(camera, lenses, position, method, margin)


def _white_shift(camera: PlenopticCamera, white: Exposure, chief: MicrolensCentres, position: Floats) -> Floats:
    """Displacement (n, 2) of a white image's lattice from positions (n, 2) of the camera's, mm; 0 within tolerance."""
    shift, array = lattice_shift(camera, white, chief), camera.microlenses
    rows, columns = white.image.shape[:2]
    shown = len(chief) * rows * columns / math.prod(camera.sensor.shape)
    if shift is None and shown >= _MIN_LOCATED and array is not None and array.lattice is not Lattice.FREE:
        warn(
            "the micro images of the white image cannot be located, since they fill their cells evenly or lie far from "
            "those of the camera; centroids are those around its chief rays"
        )
    if shift is None or not shift.is_significant:
        return np.zeros_like(position)
    displacement = shift.at(to_complex(camera.sensor.pixel_of(position)))
    return camera.sensor.pixel_pitch * np.stack([displacement.real, displacement.imag], axis=1)


def _on_sensor(
    camera: PlenopticCamera, lenses: Lenslets, position: Floats, method: CentreMethod, margin: float
) -> MicrolensCentres:
    """Centres within a margin around the sensor."""
    # Rounding must not decide whether a centre on the edge is on the sensor.
    limit = 0.5 * np.array(camera.sensor.size[::-1]) + margin + 1e-9 * camera.sensor.pixel_pitch
    with np.errstate(invalid="ignore"):
        on_sensor = (np.abs(position) <= limit).all(axis=1)
    positions, pixels = position[on_sensor], camera.sensor.pixel_of(position[on_sensor])
    return MicrolensCentres(
        lenses.index[on_sensor], lenses.type[on_sensor], lenses.axis[on_sensor], positions, pixels, method
    )


def _image_spacing(axes: ArrayAxes) -> float:
    """Spacing of micro images over that of the microlenses, by the paraxial exit pupil."""
    array = axes.camera.microlenses
    if array is not None and array.walls is Walls.OPAQUE:
        return 1.0
    gap = axes.parts.z_plane - model_pupil(axes.camera)[0]
    return 1.0 + axes.parts.distance / gap if gap != 0 else math.inf


def _lenses_near_sensor(axes: ArrayAxes, array: MicrolensArray, margin: float) -> Lenslets:
    """Microlenses that can have their images on the sensor.

    Images are farther apart than microlenses, or closer if the exit pupil lies behind the array.
    """
    axis_point = axes.parts.local_to_lens.inverse().points(np.array([0.0, 0.0, axes.parts.z_plane]))[:2]
    corners = sensor_corners(axes.camera, axes.parts)[:, :2]
    lens_corners = axis_point + (corners - axis_point) / max(_image_spacing(axes), _MIN_IMAGE_SPACING)
    corners_on_array = axes.on_array(np.concatenate([corners, lens_corners]))
    low, high = corners_on_array.min(axis=0), corners_on_array.max(axis=0)
    margin *= (high - low).max() / (corners.max() - corners.min())
    reach = _SEARCH_MARGIN * (high - low) + max(array.pitches) + margin
    return array.lenses(low - reach, np.maximum(high + reach, low - reach))
