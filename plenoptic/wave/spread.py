"""Image of a point by waves, with the sampling of its fields."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats, result
from plenoptic.optics.sensor.sensor import Sensor


@result
class Sampling:
    """Sampling of the field of one wavelength, with its error. See `point_spread`.

    Attributes
    ----------
    wavelength : float
        nm, in vacuum.
    spacing : (2,) array
        Between samples on array and sensor along x and y, mm.
    shape : (2,) array of int
        Samples along x and y.
    denser : float
        Samples in a period of the light most inclined, over the two that it needs.
    directions : (2,) array of int
        Plane waves that stand for the light of the main lens, along x and y.
    phase_error : float
        Of these waves, against rays: root mean square, waves.
    beside : float
        Part of the light that falls beside the part of the array that is looked at, or on its rim.
    stopped : float
        Part of the light there that openings and dark microlenses stop.
    steep : float
        Part of the light behind the array that is estimated to go into directions too steep for the samples.
    lost : float
        Part of the light behind the array that leaves the grid, or lands beside the part of the sensor looked at.
    """

    wavelength: float
    spacing: Floats
    shape: NDArray[np.int64]
    denser: float
    directions: NDArray[np.int64]
    phase_error: float
    beside: float
    stopped: float
    steep: float
    lost: float

    @property
    def error(self) -> float:
        """Bound of the light that pixels have wrong, over that of all of them.

        Light outside or lost is missing; light that is too steep is missing in one place and arrives in another.
        """
        return self.beside + 2.0 * self.steep + self.lost + 2.0 * np.pi * self.phase_error

    def __repr__(self) -> str:
        (x, y), (dx, dy) = self.shape.tolist(), (1e3 * self.spacing).tolist()
        return (
            f"<Sampling at {self.wavelength:g} nm: {x} x {y} samples {dx:.3g} x {dy:.3g} um apart, {self.denser:g} "
            f"times what light needs; phase within {self.phase_error:.1g} waves; beside {100 * self.beside:.2g} %, too "
            f"steep {100 * self.steep:.2g} %, lost {100 * self.lost:.2g} %>"
        )


@result
class WaveSpread:
    """The image of a point on the sensor, with diffraction; made by `point_spread`.

    Attributes
    ----------
    image : (rows, columns) array
        As that of `CameraSpread`: the value of a pixel for a small Lambertian emitter at the point, for each unit of
        its radiance and each mm^2 of its area, sr/mm^2. Of several wavelengths, their mean by weight.
    corner : (2,) array of int
        Row and column on the sensor of the first pixel of `image`.
    points : (3,) array
        The point in the world in mm.
    light : float
        Projected solid angle in sr of the light that passes the main lens.
    wavelengths, weights : (w,) array
        nm, and the part of the light that each has.
    samplings : tuple of Sampling
        Of each wavelength.
    sensor : Sensor

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.camera.example_camera()
    >>> spread = pl.wave.point_spread(camera, (0.0, 0.0, -404.0))
    >>> spread.whole().shape, bool(0.95 < spread.landed <= 1.0)
    ((512, 512), True)
    """

    image: Floats
    corner: NDArray[np.int64]
    points: Floats
    light: float
    wavelengths: Floats
    weights: Floats
    samplings: tuple[Sampling, ...]
    sensor: Sensor

    @property
    def landed(self) -> float:
        """The light on the sensor over that behind the main lens."""
        return float(self.image.sum()) * self.sensor.pixel_pitch**2 / self.light if self.light > 0 else 0.0

    @property
    def region(self) -> tuple[slice, slice]:
        """Rows and columns of the sensor that `image` holds, as `render` takes them."""
        (row, column), (rows, columns) = self.corner.tolist(), self.image.shape
        return slice(row, row + rows), slice(column, column + columns)

    def whole(self) -> Floats:
        """The image on the whole sensor."""
        full = np.zeros(self.sensor.shape)
        full[self.region] = self.image
        return full

    def __repr__(self) -> str:
        rows, columns = self.image.shape
        waves = ", ".join(f"{wave:g}" for wave in self.wavelengths)
        return (
            f"<WaveSpread: {rows} x {columns} pixels at {waves} nm, {100 * self.landed:.3g} % of the light landed, "
            f"sampling uncertain by {100 * max((part.error for part in self.samplings), default=0.0):.2g} %>"
        )
