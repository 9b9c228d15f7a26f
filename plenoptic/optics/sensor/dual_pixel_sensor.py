"""Sensors of dual and quad pixels."""

from __future__ import annotations

import dataclasses
import math
import os

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.values import Floats, file_path, length_in_mm, not_negative, radians
from plenoptic.errors import FileError, InvalidValueError
from plenoptic.optics.sensor.dual_pixels import DualPixels
from plenoptic.optics.sensor.sensor import Sensor


def dual_pixel(
    pitch: float,
    shape: tuple[int, int],
    *,
    split: tuple[int, int] = (1, 2),
    cra: float = 0.0,
    height: float | None = None,
    gap: float = 0.0,
    crosstalk: float | ArrayLike = 0.0,
    table: str | os.PathLike[str] | ArrayLike | None = None,
) -> Sensor:
    """Sensor of dual or quad pixels: an on-chip lens over each pixel, and two or four wells below it.

    The lens sends light of each direction to one point of the wells, through a stack of index 1.5. The left well sees
    the left half of the pupil as seen from behind the camera. Light in gaps, and beyond the walls of a pixel, is lost.
    Images are those of whole pixels; `well_cameras` gives a camera for each well, `read_wells` the pair.

    Parameters
    ----------
    pitch : float
        Distance between pixels in mm.
    shape : (int, int)
        Rows and columns of pixels.
    split : (int, int), optional
        Rows and columns of wells in a pixel: (1, 2), or (2, 2) for quads.
    cra : float, optional
        Chief-ray angle in radians at the sensor's corners for which on-chip lenses are shifted, from 0 to below pi / 2.
        The shift is that of an exit pupil at half the diagonal over tan(cra).
    height : float, optional
        Distance from the on-chip lens to the wells in mm; None: 2 pitches, which accept light of f/1.4.
    gap : float, optional
        Insensitive width between neighbouring wells in mm, below that of a well.
    crosstalk : float or (3, 3) array, optional
        Share of the light of a well that its four neighbours collect instead, or the shares of all wells around it,
        which add up to 1: upper row first, columns from the left. `read_wells` applies it.
    table : path or (n, 3) array, optional
        Measured responses of two wells, in place of the geometry: angle along columns, left and right. Angles count
        from the chief ray, positive for light from the right half of the pupil; in degrees in a CSV file, in radians in
        an array. Beyond the table its ends hold. Responses are at least 0 and add up to at most 1.

    Raises
    ------
    InvalidValueError
        If a number is out of range.
    FileError
        If the table cannot be read.

    Examples
    --------
    >>> import math, plenoptic as pl
    >>> sensor = pl.sensor.dual_pixel(0.0014, (3024, 4032), cra=math.radians(30.0), gap=0.0001, crosstalk=0.02)
    >>> f"{sensor.angular_response.pupil_distance:.2f} mm"
    '6.11 mm'
    """
    sensor, angle = Sensor(shape, pitch), radians(cra, "cra")
    if not 0 <= angle < math.pi / 2:
        raise InvalidValueError(f"cra is {angle:g} rad; it must be from 0 to below pi / 2 = 1.571")
    pixels = DualPixels(
        split=split,
        depth=2.0 if height is None else length_in_mm(height, "height") / sensor.pixel_pitch,
        gap=not_negative(gap, "gap", "mm") / sensor.pixel_pitch,
        pupil_distance=math.inf if angle == 0 else sensor.half_diagonal / math.tan(angle),
        crosstalk=crosstalk,
        table=_read_table(table) if isinstance(table, str | os.PathLike) else table,
    )
    return dataclasses.replace(sensor, angular_response=pixels)


def wells_of(sensor: Sensor) -> DualPixels:
    """Dual pixels of a sensor; an InvalidValueError if it has none."""
    pixels = sensor.angular_response
    if not isinstance(pixels, DualPixels):
        raise InvalidValueError(
            "the camera's sensor has no dual pixels; make it with pl.sensor.dual_pixel(pitch, shape)"
        )
    return pixels


def _read_table(path: str | os.PathLike[str]) -> Floats:
    """Table of responses in a CSV file of angles in degrees, with a row of names or without."""
    name = file_path(path)
    try:
        lines = name.read_text(encoding="utf-8-sig").splitlines()
        has_names = not lines[0].partition(",")[0].strip().lstrip("+-.").replace(".", "").isdigit()
        rows = np.loadtxt(lines[has_names:], delimiter=",", ndmin=2, usecols=(0, 1, 2))
    except (OSError, UnicodeDecodeError, ValueError, IndexError) as error:
        raise FileError(
            f"{name} is no table of angle in degrees, left and right, separated by commas: {error}"
        ) from None
    return np.column_stack([np.radians(rows[:, 0]), rows[:, 1:]])
