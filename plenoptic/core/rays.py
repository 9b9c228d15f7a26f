"""Bundles of rays and their status."""

from __future__ import annotations

import dataclasses
import enum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.values import (
    Floats,
    Given,
    frozen_array,
    number,
    numbers,
    plain_array,
    read_only,
    result,
    set_field,
    value,
    wavelength_in_nm,
)
from plenoptic.errors import InvalidValueError

UNIT_TOLERANCE = 8 * np.finfo(np.float64).eps
"""Directions whose length differs from 1 by less stay unchanged: normalising would add error, not remove it."""

_ARRAYS = ("origin", "direction", "weight", "status", "lost_at")


class RayStatus(enum.IntEnum):
    """Cause of the loss of a ray; `OK` is 0, so that `status == 0` or `not status` selects rays that are not lost.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.RayStatus(2).name
    'CLIPPED'
    """

    OK = 0
    MISSED = 1
    """The ray does not intersect a surface."""
    CLIPPED = 2
    """The ray is outside the semi-diameter of a surface or the opening of a stop."""
    TOTAL_REFLECTION = 3
    """The ray is totally reflected."""
    NOT_FINITE = 4
    """The ray's numbers are infinite or not numbers."""
    OUTSIDE_MICROLENS = 5
    """The ray hits another microlens than the one it was aimed at (and is counted there)."""
    NOT_CONVERGED = 6
    """The intersection with an aspheric surface did not converge within the limit of iterations."""
    BENT_IN = 7
    """Diffraction deflects the path's light into the pixel from beyond the margin around the sensor that is traced."""


@value
class RayBundle:
    """Rays as arrays: one row a ray.

    Parameters
    ----------
    origin : (n, 3) array
        Points on the rays in mm.
    direction : (n, 3) array
        Directions. Rows that are not of unit length are normalised; rows that are within 8 eps of it are
        kept to the last bit.
    wavelength : float
        Vacuum wavelength of all rays in nm.
    weight : (n,) array, optional
        Weight of each ray; 1 by default, 0 for a lost ray.
    status : (n,) array, optional
        `RayStatus` of each ray; OK by default.
    lost_at : (n,) array, optional
        Index of the lens element at which the ray was lost; -1 by default and where it was not lost.

    Raises
    ------
    InvalidValueError
        If shapes do not fit, the wavelength is not positive or a weight is not finite. An origin or direction
        that is not finite, or a direction of length 0, is no error but a ray with status `NOT_FINITE`.

    Examples
    --------
    >>> import plenoptic as pl
    >>> rays = pl.RayBundle([[0, 0, -100]], [[0, 0.6, 0.8]])
    >>> rays.at(10.0)
    array([[  0.,   6., -92.]])
    """

    origin: Given[Floats, ArrayLike]
    direction: Given[Floats, ArrayLike]
    wavelength: float = 587.6
    _: dataclasses.KW_ONLY
    weight: Given[Floats, ArrayLike | None] = Given(default=None)
    status: Given[NDArray[np.uint8], ArrayLike | None] = Given(default=None)
    lost_at: Given[NDArray[np.int16], ArrayLike | None] = Given(default=None)

    def __post_init__(self) -> None:
        weight: ArrayLike | None = self.weight
        status: ArrayLike | None = self.status
        lost_at: ArrayLike | None = self.lost_at
        points = frozen_array(self.origin, name="origin", shape=(None, 3))
        n = len(points)
        vectors = np.array(frozen_array(self.direction, name="direction", shape=(n, 3)))
        with np.errstate(all="ignore"):
            length = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
            unnormalised = np.abs(length - 1.0) > UNIT_TOLERANCE
            if unnormalised.any():
                vectors[unnormalised] = _normalise(vectors[unnormalised])
            not_finite = ~(np.isfinite(points).all(axis=1) & np.isfinite(vectors).all(axis=1))
        if status is None:
            state = np.where(not_finite, np.uint8(RayStatus.NOT_FINITE), np.uint8(0))
        else:
            state = np.array(frozen_array(status, name="status", shape=(n,), dtype=np.uint8))
            if state.size and state.max() > max(RayStatus):
                raise InvalidValueError(f"status {state.max()} is not one of RayStatus; use 0 to {max(RayStatus):d}")
            state[not_finite & (state == 0)] = RayStatus.NOT_FINITE
        weights = np.ones(n) if weight is None else np.array(frozen_array(weight, name="weight", shape=(n,)))
        if not np.isfinite(weights).all():
            raise InvalidValueError("weight holds a number that is not finite; give 0 to rays that carry nothing")
        weights[state != 0] = 0.0
        element = np.full(n, -1, np.int16) if lost_at is None else lost_at
        set_field(self, "origin", points)
        set_field(self, "direction", read_only(vectors))
        set_field(self, "wavelength", wavelength_in_nm(self.wavelength))
        set_field(self, "weight", read_only(weights))
        set_field(self, "status", read_only(state))
        set_field(self, "lost_at", frozen_array(element, name="lost_at", shape=(n,), dtype=np.int16))

    @classmethod
    def through(cls, origin: Floats, direction: Floats, wavelength: float) -> RayBundle:
        """Rays of weight 1 along directions (n, 3) of any length, arrays of the package's own that are not checked."""
        with np.errstate(all="ignore"):
            unit = _normalise(direction)
            not_finite = ~np.isfinite(unit[:, 0] + origin[:, 0] + origin[:, 1])
        status = np.where(not_finite, np.uint8(RayStatus.NOT_FINITE), np.uint8(0))
        weight = np.where(not_finite, 0.0, 1.0)
        return cls._from_arrays(origin, unit, wavelength, weight, status, np.full(len(origin), -1, np.int16))

    @classmethod
    def _from_arrays(
        cls,
        origin: Floats,
        direction: Floats,
        wavelength: float,
        weight: Floats,
        status: NDArray[np.uint8],
        lost_at: NDArray[np.int16],
    ) -> RayBundle:
        """A bundle of arrays that a kernel has just filled: neither copied nor checked."""
        bundle = object.__new__(cls)
        arrays: tuple[NDArray[Any], ...] = (origin, direction, weight, status, lost_at)
        for name, array in zip(_ARRAYS, arrays, strict=True):
            array.flags.writeable = False
            set_field(bundle, name, array)
        set_field(bundle, "wavelength", wavelength)
        return bundle

    def __len__(self) -> int:
        return len(self.origin)

    def at(self, distance: ArrayLike) -> Floats:
        """Points at a distance along the rays.

        Parameters
        ----------
        distance : float or (n,) array
            Distance from the origins in mm, positive along the direction.

        Returns
        -------
        (n, 3) array
        """
        t = numbers(distance, "distance")
        if t.shape not in ((), (len(self),)):
            raise InvalidValueError(f"distance has shape {t.shape}; give one number or ({len(self)},), one a ray")
        return self.origin + t[..., None] * self.direction

    def at_z(self, z: float) -> Floats:
        """Intersections of the rays, or of their backward extensions, with a plane perpendicular to the axis.

        Parameters
        ----------
        z : float
            Position of the plane in mm.

        Returns
        -------
        (n, 3) array
            Not finite for rays parallel to the plane.

        Examples
        --------
        >>> import plenoptic as pl
        >>> pl.RayBundle([[0, 0, -100]], [[0, 0.6, 0.8]]).at_z(-92.0)
        array([[  0.,   6., -92.]])
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            points = self.at((number(z, "z") - self.origin[:, 2]) / self.direction[:, 2])
        points[:, 2] = z
        return points

    def selected(self, mask: ArrayLike) -> RayBundle:
        """The rays selected by a mask (n,) or an array of row numbers."""
        selection, n = plain_array(mask, "mask"), len(self)
        if selection.dtype == bool:
            rows = np.flatnonzero(selection) if selection.shape == (n,) else np.array([n])
        else:
            rows = frozen_array(selection, name="mask", shape=("n",), dtype=np.intp)
        if ((rows < -n) | (rows >= n)).any():
            raise InvalidValueError(f"mask must be ({n},) of booleans, or numbers of rows below {n}")
        arrays = {name: getattr(self, name)[rows] for name in _ARRAYS}
        return RayBundle(wavelength=self.wavelength, **arrays)

    def __repr__(self) -> str:
        n_ok = int(np.count_nonzero(self.status == 0))
        return f"RayBundle({len(self)} ray{'s' * (len(self) != 1)}, {n_ok} OK, {self.wavelength:g} nm)"


def _normalise(direction: Floats) -> Floats:
    # Scaling by the largest component first keeps squares of tiny and of huge numbers in range.
    x, y, z = np.abs(direction).T
    largest = np.maximum(np.maximum(x, y), z)[:, None]
    scaled = direction / largest
    return np.asarray(scaled / np.sqrt(np.einsum("ij,ij->i", scaled, scaled))[:, None])


@result
class Frustum:
    """Rays through the four corners of a camera's field of view, in the world, of a `PlenopticCamera` or a `View`.

    Attributes
    ----------
    origins : (4, 3) array
        Points in mm at which the rays leave the camera, in order around the image.
    directions : (4, 3) array
        Unit vectors into the scene.
    in_focus : (4, 3) array or None
        Intersections with the plane in focus, in mm; None if none lies in front of the camera, or it is unknown.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.PlenopticCamera(lens=pl.load_lens("double-gauss-100mm-f2"),
    ...     sensor=pl.Sensor(shape=(16, 16), pixel_pitch=0.1), stop_to_microlenses=134.6)
    >>> camera.frustum.in_focus.round(1).tolist()
    [[2.5, 2.5, -404.2], [-2.5, 2.5, -404.2], [-2.5, -2.5, -404.2], [2.5, -2.5, -404.2]]
    """

    origins: Floats
    directions: Floats
    in_focus: Floats | None = None
