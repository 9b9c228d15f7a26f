"""Wave-optical image of a point, and the sampling of its field."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats, result
from plenoptic.optics.sensor.sensor import Sensor


@result
class Sampling:
    """Sampling of the field at one wavelength, and the errors it causes. See `point_spread`.

    Attributes
    ----------
    wavelength : float
        Vacuum wavelength in nm.
    spacing : (2,) array
        Distance between samples on array and sensor along x and y, mm.
    shape : (2,) array of int
        Samples along x and y.
    denser : float
        Samples per period of the most oblique light, over the required two.
    directions : (2,) array of int
        Number of plane waves of the main lens, along x and y.
    phase_error : float
        Phase error of these waves against rays: root mean square, waves.
    beside : float
        Fraction of the light outside of the sampled part of the array, or on its rim.
    stopped : float
        Fraction of the light on that part that openings and dark microlenses block.
    steep : float
        Estimated fraction of the light behind the array in directions too steep for the samples.
    lost : float
        Fraction of the light behind the array that leaves the grid, or the valid part of the sensor.
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
        """Estimated error of the light on pixels, relative to the total light.

        Light that is beside or lost is missing; light that is too steep is missing in one place and appears in another.
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
    """Image of a point on the sensor, with diffraction; made by `point_spread`.

    Attributes
    ----------
    image : (rows, columns) array
        As in `CameraSpread`: measured light of a small Lambertian emitter at the point, per unit of its radiance and
        per mm^2 of its area, sr/mm^2. Weighted mean over several wavelengths.
    corner : (2,) array of int
        Row and column on the sensor of the first pixel of `image`.
    points : (3,) array
        World position of the point in mm.
    light : float
        Projected solid angle in sr of the light that passes the main lens.
    wavelengths, weights : (w,) array
        Vacuum wavelengths in nm, and the fraction of the light of each.
    samplings : tuple of Sampling
        Sampling at each wavelength.
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
        """Light on the sensor over the light behind the main lens."""
        return float(self.image.sum()) * self.sensor.pixel_pitch**2 / self.light if self.light > 0 else 0.0

    @property
    def region(self) -> tuple[slice, slice]:
        """Rows and columns of the sensor that `image` covers, as arguments of `render`."""
        (row, column), (rows, columns) = self.corner.tolist(), self.image.shape
        return slice(row, row + rows), slice(column, column + columns)

    def whole(self) -> Floats:
        """Image on the whole sensor."""
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
