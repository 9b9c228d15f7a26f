"""Observations of a calibration: corners of boards in micro images or in views, and centres of micro images."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.display import picture_of
from plenoptic.core.values import Floats, Given, check_kind, choice, frozen_array, positions, positive, set_field, value
from plenoptic.errors import InvalidValueError
from plenoptic.optics.microlens.lattice import Lattice
from plenoptic.optics.sensor.sensor import Sensor


def is_in_views(index: NDArray[np.int64] | Floats) -> bool:
    """True for fractional lattice indices (n, 2): those of corners in views; False for corners in micro images."""
    return bool(np.any(index % 1))


@value
class Observations:
    """Corners of boards seen through microlenses, and centres of the micro images of a white image.

    All are of one focus setting. Without corners, which have shapes (0, 2) and (0,), they are a white image alone.

    Parameters
    ----------
    index : (n, 2) array
        Lattice indices of the microlens through which a corner is seen, as in `Projection.index`. Fractional ones are
        the corner's position in a view of an unfocused camera (1.0), between microlenses.
    pixel : (n, 2) array
        Row and column of the corner's image; whole numbers are centres of pixels. In a view, its pixel of a micro image
        centred at the corner.
    frame : (n,) array of int
        Number of the image; the camera or the board moves between images.
    point : (n,) array of int
        Row of `board`.
    board : (p, 3) array
        Points of the board in its own axes in mm, as designed; its face looks along +z.
    centre_index, centre_pixel : (m, 2) array
        Lattice indices and position, row and column, of micro images of the white image.
    sensor : Sensor
        Shape and pixel pitch of the raw images.
    lattice : Lattice, optional
        Lattice of the microlenses, in any orientation.
    blur : (n,) array, optional
        Radius of the corner's blur in pixels, positive if the microlens focuses in front of the sensor; or the size of
        that radius, if none is negative. Focal lengths of microlenses follow from it, in micro images.
    standard_error : (n, 2) array, optional
        Standard errors of the corners' rows and columns; their ratios are the weights of the corners.
    radius : float, optional
        Radius of the micro images in pixels up to half of the light, from which the f-number of the lens follows.

    Raises
    ------
    InvalidValueError
        If shapes differ, numbers are not finite, or points are not on the board.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.calibration.Observations(index=[[0, 0]], pixel=[[9.5, 11.2]], frame=[0], point=[0], board=[[0, 0, 0]],
    ...     centre_index=[[0, 0]], centre_pixel=[[10.0, 10.0]], sensor=pl.Sensor(shape=(20, 20), pixel_pitch=0.0055))
    Observations(1 corner in 1 frame, 1 board point, 1 centre)
    """

    index: Given[NDArray[np.int64] | Floats, ArrayLike]
    pixel: Given[Floats, ArrayLike]
    frame: Given[NDArray[np.int64], ArrayLike]
    point: Given[NDArray[np.int64], ArrayLike]
    board: Given[Floats, ArrayLike]
    centre_index: Given[NDArray[np.int64], ArrayLike]
    centre_pixel: Given[Floats, ArrayLike]
    sensor: Sensor
    lattice: Lattice = Lattice.HEXAGONAL
    blur: Given[Floats | None, ArrayLike | None] = Given(default=None)
    standard_error: Given[Floats | None, ArrayLike | None] = Given(default=None)
    radius: float | None = None

    def __post_init__(self) -> None:
        check_kind(self.sensor, "sensor", Sensor, "pl.Sensor(shape=(3068, 4080), pixel_pitch=0.0055)")
        set_field(self, "lattice", choice(self.lattice, Lattice, "lattice"))
        if self.lattice in (Lattice.FREE, Lattice.RECTANGULAR):
            raise InvalidValueError(f"lattice is {self.lattice.name}; a calibration needs HEXAGONAL or SQUARE")
        set_field(self, "pixel", positions(self.pixel, name="pixel", shape=("n", 2)))
        set_field(self, "board", positions(self.board, name="board", shape=("p", 3)))
        set_field(self, "centre_pixel", positions(self.centre_pixel, name="centre_pixel", shape=("m", 2)))
        n, m = len(self.pixel), len(self.centre_pixel)
        set_field(self, "index", positions(self.index, name="index", shape=(n, 2)))
        shapes: dict[str, tuple[Any, ...]] = {"frame": (n,), "point": (n,), "centre_index": (m, 2)}
        if not self.in_views:
            shapes["index"] = (n, 2)
        for name, shape in shapes.items():
            set_field(self, name, frozen_array(getattr(self, name), name=name, shape=shape, dtype=np.int64))
        if self.blur is not None:
            set_field(self, "blur", positions(self.blur, name="blur", shape=(n,)) if n else None)
        if self.standard_error is not None:
            errors = positions(self.standard_error, name="standard_error", shape=(n, 2)) if n else None
            set_field(self, "standard_error", errors)
            if errors is not None and not (errors > 0).all():
                raise InvalidValueError(f"standard_error holds {errors.min():g}; errors of corners are above 0")
        if self.radius is not None:
            set_field(self, "radius", positive(self.radius, "radius"))
        if n and not 0 <= self.point.min() <= self.point.max() < len(self.board):
            raise InvalidValueError(
                f"point holds numbers from {self.point.min()} to {self.point.max()}; the board has {len(self.board)} "
                "points, counted from 0"
            )

    @property
    def in_views(self) -> bool:
        """True for corners in views, whose indices are fractional; False for corners in micro images."""
        return is_in_views(self.index)

    @property
    def frames(self) -> NDArray[np.int64]:
        """Numbers of the frames, in ascending order."""
        return np.unique(self.frame)

    _repr_html_ = picture_of

    def __repr__(self) -> str:
        counts = (
            (len(self.pixel), "corner"), (len(self.frames), "frame"),
            (len(self.board), "board point"), (len(self.centre_pixel), "centre"),
        )  # fmt: skip
        corners, frames, points, centres = (f"{n} {noun}{'s' * (n != 1)}" for n, noun in counts)
        return f"Observations({corners} in {frames}, {points}, {centres})"
