"""Raw image and white image of the same pixels, and interpolation between pixels."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.as_built_values import with_true_distances
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.points.centres import CentreMethod, MicrolensCentres, microlens_centres
from plenoptic.camera.points.white_fit import LatticeShift, array_motion, has_contrast, lattice_shift
from plenoptic.core.last_result import LastResultCache
from plenoptic.core.values import Floats, check_has, coordinate, finite, numbers, value
from plenoptic.core.warn import warn
from plenoptic.errors import InvalidValueError

if TYPE_CHECKING:
    from plenoptic.rendering.exposure import Exposure

_BRIGHT = 99.0
"""Percentile of the white image taken as full light."""
_SAME = (
    *("microlenses", "sensor", "stop_to_microlenses", "microlenses_to_sensor", "microlenses_placement"),
    *("sensor_placement", "diffraction"),
)
"""Fields of `PlenopticCamera` that a shot and its white image have in common."""


@value
class RawArrays:
    """Raw image and white image of the same pixels, (H, W, C), and the variances of their errors."""

    shot: Floats
    white: Floats
    variance: Floats | None
    white_variance: Floats | None
    first: tuple[int, int]
    """Row and column of the first pixel on the sensor."""
    least: float
    """Level of the white image below which a pixel is dark."""

    def read(self, pixel: Floats) -> tuple[Floats, Floats | None]:
        """Radiance (n, C) and its variance at fractional pixels (n, 2), row and column; nan in the dark or outside.

        The quotient of the sums of light over the same four pixels: where the white image falls off, bright pixels
        weigh more, and a white image divided by itself is 1.
        """
        row, column, weight = corners(pixel - np.array(self.first), self.shot.shape[:2])

        def between(plane: Floats, weights: Floats) -> Floats:
            return np.asarray(np.einsum("nk,nkc->nc", weights, plane[row, column]))

        light = between(self.white, weight)
        with np.errstate(invalid="ignore"):
            light = np.where(light >= self.least, light, np.nan)
        radiance = between(self.shot, weight) / light
        return radiance, self.variance_of(radiance, light, lambda plane: between(plane, weight**2))

    def near(self, pixel: Floats, margin: float) -> NDArray[np.bool_]:
        """True for the pixels (n, 2) of the sensor that lie within the image, or within a margin around it, (n,)."""
        first = np.array(self.first)
        last = first + self.shot.shape[:2] - 1
        return np.asarray(((pixel >= first - margin) & (pixel <= last + margin)).all(axis=1))

    def variance_of(self, radiance: Floats, light: Floats, read: Callable[[Floats], Floats]) -> Floats | None:
        """Variance of shot over white; `read` interpolates an array, and `light` is the white image."""
        if self.variance is None:
            return None
        shot_variance = read(self.variance)
        if self.white_variance is not None:
            shot_variance = shot_variance + radiance**2 * read(self.white_variance)
        return np.asarray(shot_variance / light**2)


def corners(point: Floats, shape: tuple[int, ...]) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats]:
    """Rows, columns and bilinear weights (n, 4) of the pixels around points; weights are nan outside the image."""
    high = np.array(shape) - 1
    # A point on the last pixel stays inside despite rounding.
    outside = ((point < -1e-9) | (point > high + 1e-9)).any(axis=1)
    point = np.clip(point, 0, high)
    base = np.minimum(np.floor(point).astype(np.int64), np.maximum(high - 1, 0))
    down, right = (point - base).T
    weights = np.stack([(1 - down) * (1 - right), (1 - down) * right, down * (1 - right), down * right], axis=1)
    weights[outside] = np.nan
    rows = np.minimum(base[:, :1] + [0, 0, 1, 1], high[0])
    columns = np.minimum(base[:, 1:] + [0, 1, 0, 1], high[1])
    return rows, columns, weights


def raw_arrays(shot: Exposure, white: Exposure, least_light: float, name: str = "least_light") -> RawArrays:
    """Crop the white image to the pixels of the shot; pixels below a fraction of its 99th percentile are dark.

    Raises InvalidValueError unless the fraction, an argument of a given name, lies in (0, 1].
    """
    min_relative_light = finite(least_light, name)
    if not 0 < min_relative_light <= 1:
        raise InvalidValueError(f"{name} is {min_relative_light:g}; it must be above 0 and at most 1")
    crop, first = crop_in_white_image(shot, white)

    def plane(image: NDArray[np.float32]) -> Floats:
        return np.asarray(np.broadcast_to(image[crop].astype(np.float64), shot.image.shape))

    finite_light = white.image[np.isfinite(white.image)]
    full_light = float(np.percentile(finite_light, _BRIGHT)) if finite_light.size else 0.0
    if not full_light > 0:
        raise InvalidValueError("the white image is black; render it with render_white(camera, samples=...)")
    return RawArrays(
        shot=shot.image.astype(np.float64),
        white=plane(white.image),
        variance=None if shot.standard_error is None else np.square(shot.standard_error, dtype=np.float64),
        white_variance=None if white.standard_error is None else plane(white.standard_error) ** 2,
        first=first,
        least=min_relative_light * full_light,
    )


def camera_of(shot: Exposure, camera: PlenopticCamera | None) -> PlenopticCamera:
    """The camera passed by the caller or stored in the shot; raise InvalidValueError without one that fits the shot.

    Displacements along the axis are in its distances, by which the pinhole model counts.
    """
    chosen = shot.camera if camera is None else camera
    if not isinstance(chosen, PlenopticCamera):
        raise InvalidValueError("the shot names no camera; give camera=")
    _check_size(shot, chosen, "shot")
    return with_true_distances(chosen)


def _check_size(exposure: Exposure, camera: PlenopticCamera, name: str) -> None:
    """Raise InvalidValueError unless an exposure is that of the whole sensor, or of a region of it."""
    (height, width), region = exposure.image.shape[:2], exposure.region
    rows, columns = camera.sensor.shape
    if (height, width) != (rows, columns) if region is None else region[1] > rows or region[3] > columns:
        raise InvalidValueError(
            f"the image of {name} is {height} x {width}, its region {region}, the sensor {rows} x {columns}; give "
            "region= of Exposure, the part of the sensor that it shows, or the camera that took it"
        )


_last_shifts: LastResultCache[Exposure, list[tuple[PlenopticCamera, LatticeShift | None, bool]]] = LastResultCache(
    lambda _: []
)
"""The camera last compared with a white image, the displacement, and True without a lattice, while the image exists."""


def check_white(camera: PlenopticCamera, white: Exposure, centres: MicrolensCentres | None = None) -> None:
    """Warn of a white image that shows its micro images beside those of the camera; raise above half a pitch.

    Warns as well if it shows no lattice. `centres` are those of the camera by CHIEF_RAY, if the caller has computed
    them.
    """
    _check_size(white, camera, "white")
    last = _last_shifts(white)
    if not last or last[0][0] is not camera:
        chief = microlens_centres(camera, CentreMethod.CHIEF_RAY, progress=False) if centres is None else centres
        shift = lattice_shift(camera, white, chief)
        last[:] = [(camera, shift, shift is None and has_contrast(camera, white, chief))]
    _, shift, is_missing = last[0]
    if is_missing:
        warn(
            "the white image shows no lattice of micro images near that of the camera, and cannot be compared with it: "
            "it may be saturated, turned, transposed, or of another camera; give one of render_white(camera)"
        )
    if shift is None or not shift.is_significant:
        return
    (x, y), turn, ratio = array_motion(camera, shift)
    message = (
        f"the micro images of the white image lie up to {shift.largest:.3g} pixels from those of the camera, whose "
        f"array fits when it is shifted by ({x:.4g}, {y:.4g}) mm, turned by {turn:.3g} rad, and its pitch multiplied "
        f"by {ratio:.6g}; give camera=camera.fitted_to(white).camera, or the white image of this camera"
    )
    if shift.largest > 0.5 * shift.pitch:
        raise InvalidValueError(message)
    warn(message)


def checked_viewpoint(viewpoint: tuple[float, float]) -> tuple[float, float]:
    """Return a point of the pupil as two finite numbers; raise InvalidValueError otherwise."""
    point = numbers(viewpoint, "viewpoint")
    if point.shape != (2,):
        raise InvalidValueError(f"viewpoint has shape {point.shape}; it must be (x, y), in semi-diameters of the iris")
    return coordinate(point[0], "viewpoint[0]"), coordinate(point[1], "viewpoint[1]")


def crop_in_white_image(shot: Exposure, white: Exposure) -> tuple[tuple[slice, slice], tuple[int, int]]:
    """Slices of the white image with the pixels of a shot, and the shot's first pixel on the sensor.

    Raises InvalidValueError if the white image shows a scene, is of another camera, or does not cover the shot.
    """
    check_has(shot, "shot", "Exposure", "pl.render(scene, camera)", "white", "camera", "region")
    check_has(white, "white", "Exposure", "pl.render_white(camera)", "white", "camera", "region")
    if white.white is False:
        raise InvalidValueError("the white image shows a scene; give one of pl.render_white(camera)")
    if isinstance(shot.camera, PlenopticCamera) and isinstance(white.camera, PlenopticCamera):
        for name in _SAME:
            if getattr(shot.camera, name) != getattr(white.camera, name):
                raise InvalidValueError(
                    f"the white image is of another camera than the shot: they differ in {name}; render it again"
                )
    rows, columns, channels = shot.image.shape
    first = (0, 0) if shot.region is None else (shot.region[0], shot.region[2])
    start = (0, 0) if white.region is None else (white.region[0], white.region[2])
    top, left = first[0] - start[0], first[1] - start[1]
    if top < 0 or left < 0 or top + rows > white.image.shape[0] or left + columns > white.image.shape[1]:
        raise InvalidValueError(
            f"the white image has {white.image.shape[0]} x {white.image.shape[1]} pixels from row {start[0]}, column "
            f"{start[1]}; it does not cover the {rows} x {columns} pixels of the shot from row {first[0]}, column "
            f"{first[1]}; render it for the same region"
        )
    if white.image.shape[2] not in (1, channels):
        raise InvalidValueError(
            f"the white image has {white.image.shape[2]} channels and the shot {channels}; render one with 1 or "
            f"{channels}"
        )
    return (slice(top, top + rows), slice(left, left + columns)), first
