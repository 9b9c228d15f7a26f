"""Raw image and white image of the same pixels, and reading between them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.core.values import Floats, check_kind, coordinate, finite, numbers, value
from plenoptic.errors import InvalidValueError
from plenoptic.rendering.exposure import Exposure

_BRIGHT = 99.0
"""Percentile of the white image that counts as full light."""


@value
class RawArrays:
    """A shot and its white image on the same pixels, (H, W, C), and the variances of their errors."""

    shot: Floats
    white: Floats
    variance: Floats | None
    white_variance: Floats | None
    first: tuple[int, int]
    """Row and column of the first pixel on the sensor."""
    least: float
    """Below it the white image counts as dark."""

    def read(self, pixel: Floats) -> tuple[Floats, Floats | None]:
        """Radiance (n, C) and its variance at places (n, 2), row and column; nan where it is dark or outside.

        The quotient of two sums of light over the same four pixels: where the white image falls off, bright pixels
        count more, and a white image read by itself is 1.
        """
        row, column, weight = _corners(pixel - np.array(self.first), self.shot.shape[:2])

        def between(plane: Floats, shares: Floats) -> Floats:
            return np.asarray(np.einsum("nk,nkc->nc", shares, plane[row, column]))

        light = between(self.white, weight)
        with np.errstate(invalid="ignore"):
            light = np.where(light >= self.least, light, np.nan)
        radiance = between(self.shot, weight) / light
        return radiance, self.variance_of(radiance, light, lambda plane: between(plane, weight**2))

    def variance_of(self, radiance: Floats, light: Floats, read: Callable[[Floats], Floats]) -> Floats | None:
        """Of shot over white, where `read` gives a plane's values, and `light` is the white image there."""
        if self.variance is None:
            return None
        spread = read(self.variance)
        if self.white_variance is not None:
            spread = spread + radiance**2 * read(self.white_variance)
        return np.asarray(spread / light**2)


def _corners(place: Floats, shape: tuple[int, ...]) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats]:
    """Rows, columns and bilinear weights (n, 4) of the pixels around places; weights are nan outside the image."""
    high = np.array(shape) - 1
    # Rounding of a place on the last pixel must not lose it.
    outside = ((place < -1e-9) | (place > high + 1e-9)).any(axis=1)
    place = np.clip(place, 0, high)
    base = np.minimum(np.floor(place).astype(np.int64), np.maximum(high - 1, 0))
    down, right = (place - base).T
    shares = np.stack([(1 - down) * (1 - right), (1 - down) * right, down * (1 - right), down * right], axis=1)
    shares[outside] = np.nan
    rows = np.minimum(base[:, :1] + [0, 0, 1, 1], high[0])
    columns = np.minimum(base[:, 1:] + [0, 1, 0, 1], high[1])
    return rows, columns, shares


def raw_arrays(shot: Exposure, white: Exposure, least_light: float) -> RawArrays:
    """Cut the white image to the pixels of the shot; its dark parts are below `least_light` of its 99th percentile."""
    cut, first = crop_in_white_image(shot, white)

    def plane(image: NDArray[np.float32]) -> Floats:
        return np.asarray(np.broadcast_to(image[cut].astype(np.float64), shot.image.shape))

    known = white.image[np.isfinite(white.image)]
    bright = float(np.percentile(known, _BRIGHT)) if known.size else 0.0
    if not bright > 0:
        raise InvalidValueError("the white image is black; render it with render_white(camera, samples=...)")
    return RawArrays(
        shot=shot.image.astype(np.float64),
        white=plane(white.image),
        variance=None if shot.standard_error is None else np.square(shot.standard_error, dtype=np.float64),
        white_variance=None if white.standard_error is None else plane(white.standard_error) ** 2,
        first=first,
        least=least_light * bright,
    )


def relative_light(least_light: float) -> float:
    """`least_light`, or an error."""
    least = finite(least_light, "least_light")
    if not 0 < least <= 1:
        raise InvalidValueError(f"least_light is {least:g}; it must be above 0 and at most 1")
    return least


def camera_of(shot: Exposure, camera: PlenopticCamera | None) -> PlenopticCamera:
    """The camera that took a shot, or the one given, or an error."""
    found = shot.camera if camera is None else camera
    if not isinstance(found, PlenopticCamera):
        raise InvalidValueError("the shot names no camera that took it; give camera=")
    return found


def checked_viewpoint(viewpoint: tuple[float, float]) -> tuple[float, float]:
    """A place in the pupil, or an error."""
    place = numbers(viewpoint, "viewpoint")
    if place.shape != (2,):
        raise InvalidValueError(f"viewpoint has shape {place.shape}; it must be (x, y), in semi-diameters of the iris")
    return coordinate(place[0], "viewpoint[0]"), coordinate(place[1], "viewpoint[1]")


def crop_in_white_image(shot: Exposure, white: Exposure) -> tuple[tuple[slice, slice], tuple[int, int]]:
    """Where the pixels of a shot are in a white image, and the first one on the sensor; or an error."""
    check_kind(shot, "shot", Exposure, "pl.render(scene, camera)")
    check_kind(white, "white", Exposure, "pl.render_white(camera)")
    if white.white is False:
        raise InvalidValueError("the white image shows a scene; give what pl.render_white(camera) made")
    _check_same_camera(shot.camera, white.camera)
    rows, columns, channels = shot.image.shape
    first = (0, 0) if shot.region is None else (shot.region[0], shot.region[2])
    start = (0, 0) if white.region is None else (white.region[0], white.region[2])
    top, left = first[0] - start[0], first[1] - start[1]
    if top < 0 or left < 0 or top + rows > white.image.shape[0] or left + columns > white.image.shape[1]:
        raise InvalidValueError(
            f"the white image holds {white.image.shape[0]} x {white.image.shape[1]} pixels from row {start[0]}, column "
            f"{start[1]}, and not all {rows} x {columns} of the shot from row {first[0]}, column {first[1]}; render it "
            "of the same region"
        )
    if white.image.shape[2] not in (1, channels):
        raise InvalidValueError(
            f"the white image has {white.image.shape[2]} channels and the shot {channels}; render one with 1 or "
            f"{channels}"
        )
    return (slice(top, top + rows), slice(left, left + columns)), first


_SAME = ("microlenses", "sensor", "stop_to_microlenses", "microlenses_to_sensor", "microlenses_placement")
"""What images of a camera at several stops have in common, by its names in `PlenopticCamera`."""


def _check_same_camera(shot: PlenopticCamera | None, white: PlenopticCamera | None) -> None:
    if isinstance(shot, PlenopticCamera) and isinstance(white, PlenopticCamera):
        for name in (*_SAME, "sensor_placement", "diffraction"):
            if getattr(shot, name) != getattr(white, name):
                raise InvalidValueError(
                    f"the white image is of another camera than the shot: they differ in {name}; render it anew"
                )
