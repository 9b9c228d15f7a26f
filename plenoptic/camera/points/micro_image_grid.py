"""MicroImageGrid: the lattice of the micro images on a sensor, in pixels, without a camera."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.display import picture_of
from plenoptic.core.values import (
    Floats,
    Given,
    checked_shape,
    choice,
    frozen_array,
    numbers,
    plain_array,
    set_field,
    value,
)
from plenoptic.errors import InvalidValueError
from plenoptic.optics.microlens.lattice import Lattice, lattice_basis

_INVERSIONS, _LARGEST_SLOPE = 20, 0.5
"""Steps of the inversion of the deviation, and largest change of it per pixel, with which they converge to 1e-6."""


@value
class MicroImageGrid:
    """Lattice of the micro images on a sensor, in pixels: positions are (row, column).

    The first pixel's centre is at (0, 0). The micro image with the index (k, l) is centred at p + deviation(p), where
    p = origin + k basis[0] + l basis[1]. Indices are those of `microlens_centres`, except for a symmetry of the
    lattice: k counts towards smaller columns, l towards larger rows, if the lattice is not turned.

    Parameters
    ----------
    lattice : Lattice
        HEXAGONAL, SQUARE or RECTANGULAR, along the vectors of `basis`: the lattice may be turned by any angle.
    origin : (2,) array_like
        Position of the micro image (0, 0), without deviation.
    basis : (2, 2) array_like
        Rows are the steps (row, column) from (k, l) to (k + 1, l) and to (k, l + 1). Its determinant is positive. In a
        HEXAGONAL lattice the steps are about 60 degrees apart.
    shape : (int, int)
        Rows and columns of the sensor.
    deviation : (n, n, 2) array_like, optional
        Smooth deviation from the lattice: coefficients of the products T_i(y) T_j(x) of Chebyshev polynomials, in
        pixels along rows and columns, with y and x from -1 to 1 across the rows and columns of the sensor.
    index : (m, 2) array_like of int, optional
        Indices (k, l) of measured micro images, one a row of the arrays that follow.
    centre : (m, 2) array_like, optional
        Their measured centres.
    standard_error : (m, 2) array_like, optional
        Standard errors of the centres.
    radius : (m,) array_like, optional
        Their radii up to half of the light, pixels.
    type_pattern : (p, q) array_like of int
        Type of the micro image (k, l), at [k mod p, l mod q], from 0; as `MicrolensArray.type_pattern`.
    border : (t,) array_like, optional
        Width of the border over which the light of each type fades out, pixels: that of the opening of a microlens,
        out of focus, the pitch times abs(1 - b / f), and 0 in an unfocused camera (1.0). None where micro images touch
        so closely that it does not show.

    Raises
    ------
    InvalidValueError
        If the lattice is FREE, flat or mirrored, arrays do not fit, or the deviation changes by more than half a pixel
        per pixel.

    Examples
    --------
    >>> import plenoptic as pl
    >>> grid = pl.calibration.MicroImageGrid(
    ...     pl.Lattice.HEXAGONAL, origin=(80.0, 100.0), basis=[(0.0, -20.0), (17.32, -10.0)], shape=(160, 200)
    ... )
    >>> grid
    MicroImageGrid(HEXAGONAL, pitch 20 pixels along rows, rotation 0.00 degrees, 160 x 200 pixels)
    >>> grid.centres_of((1, 2)), grid.indices_of((115.0, 61.0))
    (array([114.64,  60.  ]), array([1, 2]))
    """

    lattice: Lattice
    _: KW_ONLY
    origin: Given[Floats, ArrayLike]
    basis: Given[Floats, ArrayLike]
    shape: tuple[int, int]
    deviation: Given[Floats | None, ArrayLike | None] = Given(default=None)
    index: Given[NDArray[np.int64] | None, ArrayLike | None] = Given(default=None)
    centre: Given[Floats | None, ArrayLike | None] = Given(default=None)
    standard_error: Given[Floats | None, ArrayLike | None] = Given(default=None)
    radius: Given[Floats | None, ArrayLike | None] = Given(default=None)
    type_pattern: Given[NDArray[np.int64], ArrayLike] = Given(default=((0,),))
    border: Given[Floats | None, ArrayLike | None] = Given(default=None)

    def __post_init__(self) -> None:
        set_field(self, "lattice", choice(self.lattice, Lattice, "lattice"))
        if self.lattice is Lattice.FREE:
            raise InvalidValueError("lattice is FREE, whose micro images lie on no grid; give HEXAGONAL or SQUARE")
        set_field(self, "origin", frozen_array(self.origin, name="origin", shape=(2,)))
        set_field(self, "basis", frozen_array(self.basis, name="basis", shape=(2, 2)))
        set_field(self, "shape", checked_shape(self.shape, ("rows", "columns")))
        set_field(
            self,
            "type_pattern",
            frozen_array(self.type_pattern, name="type_pattern", shape=(None, None), dtype=np.int64),
        )
        if self.border is not None:
            types = int(self.type_pattern.max()) + 1
            set_field(self, "border", frozen_array(self.border, name="border", shape=(types,)))
            if not (np.isfinite(self.border) & (self.border >= 0)).all():
                raise InvalidValueError(f"border is {self.border.tolist()}; give widths in pixels, 0 for sharp ones")
        lengths = np.hypot(*self.basis.T)
        if not (np.isfinite(self.origin).all() and abs(np.linalg.det(self.basis)) > 0.1 * lengths.prod()):
            raise InvalidValueError(f"basis is {self.basis.tolist()}; give two steps in different directions")
        is_obtuse = self.lattice is Lattice.HEXAGONAL and self.basis[0] @ self.basis[1] < 0
        if is_obtuse or np.linalg.det(self.basis) < 0:
            raise InvalidValueError(
                f"basis is {self.basis.tolist()}, of another lattice or mirrored; give steps (row, column), in a "
                "hexagonal lattice 60 degrees apart, with a positive determinant"
            )
        self._check_measurements()
        if self.deviation is not None:
            series = frozen_array(self.deviation, name="deviation", shape=(None, None, 2))
            set_field(self, "deviation", series)
            # Derivatives of T_n reach n^2 at the ends.
            n = np.arange(len(series))[:, None] ** 2, np.arange(series.shape[1]) ** 2
            slopes = [(np.abs(series) * d[..., None]).sum() * 2 / size for d, size in zip(n, self.shape, strict=True)]
            if not max(slopes) < _LARGEST_SLOPE:
                raise InvalidValueError("deviation changes by more than half a pixel per pixel; put it into the basis")

    def _check_measurements(self) -> None:
        rows = None if self.index is None else len(plain_array(self.index, "index"))
        for name, columns, dtype in (
            ("index", (2,), np.int64),
            ("centre", (2,), np.float64),
            ("standard_error", (2,), np.float64),
            ("radius", (), np.float64),
        ):
            array = getattr(self, name)
            if array is not None:
                if rows is None:
                    raise InvalidValueError(f"{name} is given without index; give the indices of the micro images too")
                set_field(self, name, frozen_array(array, name=name, shape=(rows, *columns), dtype=dtype))

    @property
    def pitches(self) -> tuple[float, float]:
        """Distances of neighbours along both vectors of `basis` in pixels."""
        first, second = np.hypot(*self.basis.T).tolist()
        return first, second

    @property
    def pitch(self) -> float:
        """Root of the product of both `pitches`."""
        return math.sqrt(math.prod(self.pitches))

    @property
    def is_along_rows(self) -> bool:
        """True if neighbours stand nearer to the rows of the sensor than to the columns, as in SQUARE lattices."""
        return self.lattice is not Lattice.HEXAGONAL or abs(self._turn(30.0)) <= abs(self._turn(0.0))

    @property
    def rotation(self) -> float:
        """Least rotation that brings neighbours of a lattice along rows, or columns, here; in radians.

        It is positive from larger rows to larger columns, as a turn of the array by `moved(tilt=(0, 0, rotation))`.
        """
        return math.radians(self._turn(30.0 if self.lattice is Lattice.HEXAGONAL and self.is_along_rows else 0.0))

    def _turn(self, from_angle: float) -> float:
        """Least angle in degrees from a lattice of equal angles, itself turned from that of `lattice_basis`."""
        symmetry = 6 if self.lattice is Lattice.HEXAGONAL else 4 if self.lattice is Lattice.SQUARE else 2
        # Columns run against the array's x, rows along its y.
        steps, ideal_steps = self.basis @ (1j, -1.0), lattice_basis(self.lattice, self.pitches) @ (1.0, 1j)
        angle = math.degrees(np.angle(np.vdot(ideal_steps, steps))) - from_angle
        return angle - 360.0 / symmetry * round(angle * symmetry / 360.0)

    def centres_of(self, index: ArrayLike) -> Floats:
        """Centres (..., 2) of micro images (k, l) of the lattice, with the smooth deviation."""
        p = self.origin + numbers(index, "index", columns=2) @ self.basis
        return p + self._deviation_at(p)

    def indices_of(self, position: ArrayLike) -> NDArray[np.int64]:
        """Indices (..., 2) of the micro images whose centres are nearest to positions (..., 2)."""
        target = numbers(position, "position", columns=2)
        p = target
        for _ in range(_INVERSIONS if self.deviation is not None else 0):
            p = target - self._deviation_at(p)
        steps = (p - self.origin) @ np.linalg.inv(self.basis)
        lower = np.floor(steps)
        corners = lower[..., None, :] + np.array([(0, 0), (0, 1), (1, 0), (1, 1)])
        distance = np.linalg.norm((steps[..., None, :] - corners) @ self.basis, axis=-1)
        nearest = distance.argmin(axis=-1)[..., None, None]
        return np.asarray(np.take_along_axis(corners, nearest, axis=-2)[..., 0, :], dtype=np.int64)

    def sensor_fractions(self, position: Floats) -> Floats:
        """Positions (..., 2) in pixels, from -1 to 1 across the rows and across the columns."""
        return np.asarray((2.0 * position - np.subtract(self.shape, 1)) / self.shape)

    def types_of(self, index: ArrayLike) -> NDArray[np.int64]:
        """Types (...) of micro images (k, l)."""
        k, l = np.moveaxis(frozen_array(index, name="index", shape=np.shape(index), dtype=np.int64), -1, 0)
        p, q = self.type_pattern.shape
        return np.asarray(self.type_pattern[k % p, l % q])

    @property
    def on_sensor(self) -> NDArray[np.int64]:
        """Indices (n, 2) of all micro images of the lattice with their centres on the sensor, by k, then l."""
        rows, columns = self.shape
        edge = np.array([(row, column) for row in (0, rows - 1) for column in (0, columns - 1)])
        low, high = self.indices_of(edge).min(axis=0) - 2, self.indices_of(edge).max(axis=0) + 2
        index = np.stack(np.meshgrid(*map(np.arange, low, high + 1), indexing="ij"), axis=-1).reshape(-1, 2)
        centre = self.centres_of(index)
        return np.asarray(index[((centre >= -0.5) & (centre <= np.subtract(self.shape, 0.5))).all(axis=1)])

    def _deviation_at(self, p: Floats) -> Floats | float:
        if self.deviation is None:
            return 0.0
        # Beyond the sensor it goes on as at the edge.
        y, x = np.clip(self.sensor_fractions(p), -1.1, 1.1).T
        return np.asarray(np.moveaxis(chebyshev.chebval2d(y.T, x.T, self.deviation), 0, -1))

    _repr_html_ = picture_of

    def __repr__(self) -> str:
        pitches = " x ".join(
            f"{p:.5g}" for p in dict.fromkeys(self.pitches if self.lattice is Lattice.RECTANGULAR else [self.pitch])
        )
        direction = f" along {'rows' if self.is_along_rows else 'columns'}" if self.lattice is Lattice.HEXAGONAL else ""
        types, n = int(self.type_pattern.max()) + 1, 0 if self.index is None else len(self.index)
        facts: list[Any] = [self.lattice.name, f"pitch {pitches} pixels{direction}"]
        facts.append(f"rotation {round(math.degrees(self.rotation), 2) + 0.0:.2f} degrees")
        facts += [f"{types} types"] * (types > 1) + [f"{n} centres"] * (n > 0)
        return f"MicroImageGrid({', '.join(facts)}, {self.shape[0]} x {self.shape[1]} pixels)"
