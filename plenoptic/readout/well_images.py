"""Images of the wells of dual and quad pixels."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Literal

import numpy as np

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.core.values import Floats, check_kind, result
from plenoptic.errors import InvalidValueError
from plenoptic.optics.sensor.dual_pixel_sensor import wells_of
from plenoptic.rendering.exposure import Exposure


@result
class WellImages:
    """Images of the wells of dual or quad pixels, after crosstalk. See `read_wells`, which returns it.

    Attributes
    ----------
    camera : PlenopticCamera
        The camera of whole pixels.
    exposures : tuple of Exposure
        One for each well, row by row; `develop` makes raw images of them, each with a seed of its own.
    """

    camera: PlenopticCamera
    exposures: tuple[Exposure, ...]

    @property
    def wells(self) -> Floats:
        """(rows, columns, H, W, C) images of the wells: left and right of dual pixels, the four of quads."""
        return _as_wells(self.camera, [exposure.image for exposure in self.exposures])

    @property
    def left(self) -> Floats:
        """(H, W, C) image through the left half of the pupil."""
        return np.asarray(self.wells[:, 0].sum(axis=0))

    @property
    def right(self) -> Floats:
        """(H, W, C) image through the right half of the pupil."""
        return np.asarray(self.wells[:, 1].sum(axis=0))

    @property
    def whole(self) -> Floats:
        """(H, W, C) sum of all wells: left + right."""
        return self.left + self.right

    def __repr__(self) -> str:
        rows, columns = wells_of(self.camera.sensor).split
        return f"WellImages({rows} x {columns} wells of {self.exposures[0]!r})"


def _as_wells(camera: PlenopticCamera, images: Sequence[np.ndarray]) -> Floats:
    stack = np.stack(images).astype(np.float64)
    return stack.reshape(*wells_of(camera.sensor).split, *stack.shape[1:])


def _reading(camera: PlenopticCamera, well: tuple[int, int] | None) -> PlenopticCamera:
    pixels = dataclasses.replace(wells_of(camera.sensor), well=well)
    return dataclasses.replace(camera, sensor=dataclasses.replace(camera.sensor, angular_response=pixels))


def well_cameras(camera: PlenopticCamera) -> tuple[PlenopticCamera, ...]:
    """Cameras that read one well of each pixel, row by row: left and right for dual pixels.

    Raises an InvalidValueError if the camera's sensor is not one of `dual_pixel`.

    Examples
    --------
    >>> import plenoptic as pl
    >>> sensor = pl.sensor.dual_pixel(0.0054, (16, 24), split=(2, 2))
    >>> camera = pl.PlenopticCamera(pl.load_lens("double-gauss-100mm-f2"), sensor, 134.6)
    >>> [each.sensor.angular_response.well for each in pl.sensor.well_cameras(camera)]
    [(0, 0), (0, 1), (1, 0), (1, 1)]
    """
    check_kind(camera, "camera", PlenopticCamera, "pl.PlenopticCamera(lens, pl.sensor.dual_pixel(pitch, shape), 50.0)")
    rows, columns = wells_of(camera.sensor).split
    return tuple(_reading(camera, (row, column)) for row in range(rows) for column in range(columns))


def read_wells(exposures: Sequence[Exposure]) -> WellImages:
    """Images of wells from renders of `well_cameras`, with the light that wells exchange by crosstalk.

    At the image's border, wells get as much light from beyond as they lose: the last pixels are continued.

    Parameters
    ----------
    exposures : sequence of Exposure
        One for each of `well_cameras`, in their order.

    Raises
    ------
    InvalidValueError
        If these are not all wells of one camera, of one region.

    Examples
    --------
    >>> import plenoptic as pl
    >>> sensor = pl.sensor.dual_pixel(0.1, (8, 12), crosstalk=0.04)
    >>> camera = pl.PlenopticCamera(pl.load_lens("double-gauss-100mm-f2"), sensor, 134.6)
    >>> halves = [pl.render_white(each, samples=16, progress=False) for each in pl.sensor.well_cameras(camera)]
    >>> images = pl.sensor.read_wells(halves)
    >>> images.left.shape, images.wells.shape
    ((8, 12, 1), (1, 2, 8, 12, 1))
    """
    shots = tuple(exposures) if isinstance(exposures, list | tuple) else (exposures,)
    for shot in shots:
        check_kind(shot, "an item of exposures", Exposure, "pl.render(scene, camera)")
    cameras = tuple(shot.camera for shot in shots)
    if not shots or cameras[0] is None or cameras != well_cameras(cameras[0]):
        raise InvalidValueError(
            f"the {len(shots)} exposures are not those of all wells of one camera, row by row; render one for each of "
            "pl.sensor.well_cameras(camera)"
        )
    if len({(shot.image.shape, shot.region) for shot in shots}) > 1:
        raise InvalidValueError("exposures of wells differ in shape or region; render all of one region")
    camera = _reading(cameras[0], None)
    shares = wells_of(camera.sensor).crosstalk
    images = after_crosstalk(_as_wells(camera, [shot.image for shot in shots]), shares)
    errors = [
        np.full(shot.image.shape, np.nan) if shot.standard_error is None else shot.standard_error for shot in shots
    ]
    after = np.sqrt(after_crosstalk(_as_wells(camera, errors) ** 2, shares**2))
    parts = zip(shots, images, (None if np.isnan(error).any() else error for error in after), strict=True)
    return WellImages(camera, tuple(dataclasses.replace(s, image=i, standard_error=e) for s, i, e in parts))


def after_crosstalk(wells: Floats, shares: Floats, beyond: Literal["edge", "wrap"] = "edge") -> Floats:
    """Light (rows columns, H, W, C) of wells (rows, columns, H, W, C) after each has given `shares` to those around.

    Beyond the border, the last pixels ("edge") or the whole image ("wrap") are continued.
    """
    rows, columns, height, width, channels = wells.shape
    if shares[1, 1] == 1.0:
        return wells.reshape(-1, height, width, channels)
    padded = np.pad(wells, ((0, 0), (0, 0), (1, 1), (1, 1), (0, 0)), mode=beyond)
    lattice = padded.transpose(2, 0, 3, 1, 4).reshape((height + 2) * rows, (width + 2) * columns, channels)
    after = np.zeros((height * rows, width * columns, channels))
    for down, right in np.ndindex(3, 3):
        row, column = rows + 1 - down, columns + 1 - right
        after += shares[down, right] * lattice[row : row + height * rows, column : column + width * columns]
    return after.reshape(height, rows, width, columns, channels).transpose(1, 3, 0, 2, 4).reshape(-1, *wells.shape[2:])
