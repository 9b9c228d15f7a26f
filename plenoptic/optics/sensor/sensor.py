"""The image sensor: a plane of square pixels."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.display import picture_of
from plenoptic.core.values import Floats, broadcast, checked_shape, length_in_mm, numbers, positive, set_field, value
from plenoptic.errors import InvalidValueError
from plenoptic.optics.sensor.angular_response import AngularResponse
from plenoptic.optics.sensor.dual_pixels import DualPixels


@value
class Sensor:
    """A plane of square pixels perpendicular to the optical axis, centred on it.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns.
    pixel_pitch : float
        Distance between the centres of neighbouring pixels in mm.
    pixel_aperture : (float, float), optional
        Width and height of the light-sensitive part in the middle of a pixel, over the pitch, above 0 and at most 1.
        The rest is insensitive, so that images get darker by their product, the fill factor.
    angular_response : AngularResponse or DualPixels, optional
        Dependence of a pixel's response on direction; None: no dependence.

    Raises
    ------
    InvalidValueError
        If the sensor has no pixels, the pitch is not positive or the aperture is out of range.

    Examples
    --------
    >>> import plenoptic as pl
    >>> sensor = pl.Sensor(shape=(512, 512), pixel_pitch=0.010)
    >>> sensor.size
    (5.12, 5.12)
    """

    shape: tuple[int, int]
    pixel_pitch: float
    pixel_aperture: tuple[float, float] = (1.0, 1.0)
    angular_response: AngularResponse | DualPixels | None = None

    def __post_init__(self) -> None:
        rows, columns = checked_shape(self.shape, ("rows of the sensor", "columns of the sensor"))
        set_field(self, "shape", (rows, columns))
        set_field(self, "pixel_pitch", length_in_mm(self.pixel_pitch, "pixel_pitch"))
        try:
            width, height = (positive(side, "pixel_aperture") for side in self.pixel_aperture)
        except (TypeError, ValueError):
            raise InvalidValueError(
                f"pixel_aperture is {self.pixel_aperture!r}; it must be (width, height) over the pitch, above 0"
            ) from None
        if max(width, height) > 1:
            raise InvalidValueError(f"pixel_aperture is {(width, height)}; no side can be larger than the pitch, 1")
        set_field(self, "pixel_aperture", (width, height))
        if self.angular_response is not None and not isinstance(self.angular_response, AngularResponse | DualPixels):
            raise InvalidValueError(
                f"angular_response is {self.angular_response!r}; it must be an AngularResponse, DualPixels or None"
            )

    @property
    def fill_factor(self) -> float:
        """Light-sensitive fraction of a pixel's area."""
        return self.pixel_aperture[0] * self.pixel_aperture[1]

    @property
    def size(self) -> tuple[float, float]:
        """Height and width in mm."""
        rows, columns = self.shape
        return rows * self.pixel_pitch, columns * self.pixel_pitch

    @property
    def half_diagonal(self) -> float:
        """Distance from the axis to a corner in mm."""
        return 0.5 * float(np.hypot(*self.size))

    def centre_of(self, row: ArrayLike, column: ArrayLike) -> Floats:
        """Centres (..., 2) of pixels in mm on the sensor, which is read out rotated by 180 degrees.

        x = -(column + 1/2 - W/2) pitch and y = (row + 1/2 - H/2) pitch.

        Examples
        --------
        >>> import plenoptic as pl
        >>> pl.Sensor(shape=(4, 4), pixel_pitch=1.0).centre_of(0, 0)
        array([ 1.5, -1.5])
        """
        rows, columns = self.shape
        y, x = broadcast(row=row, column=column)
        return np.stack([-(x + 0.5 - columns / 2), y + 0.5 - rows / 2], axis=-1) * self.pixel_pitch

    def pixel_of(self, points: ArrayLike) -> Floats:
        """Row and column (..., 2) of points (..., 2) on the sensor, in mm: the inverse of `centre_of`.

        Pixel centres have whole numbers.

        Examples
        --------
        >>> import plenoptic as pl
        >>> pl.Sensor(shape=(4, 4), pixel_pitch=1.0).pixel_of((1.5, -1.5))
        array([0., 0.])
        """
        rows, columns = self.shape
        xy = numbers(points, "points", columns=2)
        row = xy[..., 1] / self.pixel_pitch + rows / 2 - 0.5
        column = -xy[..., 0] / self.pixel_pitch + columns / 2 - 0.5
        return np.stack([row, column], axis=-1)

    _repr_html_ = picture_of
