"""The image sensor: a plane of square pixels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plenoptic._values import positive, set_field, value, whole
from plenoptic.errors import InvalidValueError


@value
class Sensor:
    """A plane of square pixels across the optical axis, centred on it.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns.
    pixel_pitch : float
        Distance between the centres of neighbouring pixels in mm; pixels have no gaps.

    Raises
    ------
    InvalidValueError
        For a sensor without pixels or a pitch that is not positive.

    Examples
    --------
    >>> import plenoptic as pl
    >>> sensor = pl.Sensor(shape=(512, 512), pixel_pitch=0.010)
    >>> sensor.size
    (5.12, 5.12)
    """

    shape: tuple[int, int]
    pixel_pitch: float

    def __post_init__(self) -> None:
        try:
            rows, columns = self.shape
        except (TypeError, ValueError):
            raise InvalidValueError(f"shape is {self.shape!r}; it must be (rows, columns)") from None
        set_field(
            self,
            "shape",
            (whole(rows, "rows of the sensor", at_least=1), whole(columns, "columns of the sensor", at_least=1)),
        )
        set_field(self, "pixel_pitch", positive(self.pixel_pitch, "pixel_pitch", "mm"))

    @property
    def size(self) -> tuple[float, float]:
        """Height and width in mm."""
        rows, columns = self.shape
        return rows * self.pixel_pitch, columns * self.pixel_pitch

    @property
    def half_diagonal(self) -> float:
        """Distance from the axis to a corner in mm."""
        return 0.5 * float(np.hypot(*self.size))

    def centre_of(self, row: NDArray[np.integer] | int, column: NDArray[np.integer] | int) -> NDArray[np.float64]:
        """Centres of pixels on the sensor, which is read out rotated by 180 degrees.

        Parameters
        ----------
        row, column : int or arrays of int

        Returns
        -------
        (..., 2) array
            x = -(column + 1/2 - W/2) pitch and y = (row + 1/2 - H/2) pitch in mm.

        Examples
        --------
        >>> import plenoptic as pl
        >>> pl.Sensor(shape=(4, 4), pixel_pitch=1.0).centre_of(0, 0)
        array([ 1.5, -1.5])
        """
        rows, columns = self.shape
        x = -(np.asarray(column) + 0.5 - columns / 2) * self.pixel_pitch
        y = (np.asarray(row) + 0.5 - rows / 2) * self.pixel_pitch
        return np.stack(np.broadcast_arrays(x, y), axis=-1)
