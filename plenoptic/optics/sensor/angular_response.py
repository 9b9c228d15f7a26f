"""Dependence of a pixel's response on the direction of light."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.values import Floats, finite, number, set_field, value
from plenoptic.errors import InvalidValueError


@value
class AngularResponse:
    """A pixel as a photodiode at the bottom of a well, whose opening may be shifted to centre the chief ray.

    Light at an angle to the normal illuminates, at the bottom of a well of depth d and square opening w, a square that
    is displaced by d tan(theta') along the two axes; the overlap with the photodiode counts. theta' is the angle in
    the well's dielectric. The response is multiplied by cos(theta)^exponent for reflection and absorption at the
    surface. Sensors for short exit pupils shift their openings towards the axis, so that the chief ray from a pupil at
    `pupil_distance` meets the middle of every photodiode. The response then falls off for light from other points.

    The projected area of the pixel (one factor cos) is already part of every image.

    Parameters
    ----------
    well_depth : float
        Depth of the well over the width of its opening, d / w; 0: no roll-off.
    index : float
        Refractive index in the well, at least 1.
    pupil_distance : float
        Distance in mm from the sensor to the exit pupil for which openings are shifted; inf: no shift.
    exponent : float
        Exponent of the cosine, at least 0.

    Raises
    ------
    InvalidValueError
        If a number is out of range.

    Notes
    -----
    Model of P. B. Catrysse, X. Liu, A. El Gamal, "QE reduction due to pixel vignetting in CMOS image sensors", Proc.
    SPIE 3965 (2000), with the photodiode as wide as the opening.

    Examples
    --------
    >>> import math, plenoptic as pl
    >>> response = pl.sensor.AngularResponse(well_depth=0.8, index=1.5)
    >>> f"{response.at(math.tan(math.radians(20.0)), 0.0):.4f}"
    '0.8127'
    """

    well_depth: float = 0.0
    index: float = 1.5
    pupil_distance: float = math.inf
    exponent: float = 0.0

    def __post_init__(self) -> None:
        for name, minimum in (("well_depth", 0.0), ("index", 1.0), ("exponent", 0.0)):
            checked = finite(getattr(self, name), name)
            if checked < minimum:
                raise InvalidValueError(f"{name} is {checked:g}; it must be at least {minimum:g}")
            set_field(self, name, checked)
        set_field(self, "pupil_distance", number(self.pupil_distance, "pupil_distance"))
        if not self.pupil_distance > 0:
            raise InvalidValueError(f"pupil_distance is {self.pupil_distance:g} mm; it must be above 0, or inf")

    def at(self, slope_x: ArrayLike, slope_y: ArrayLike, *, x: ArrayLike = 0.0, y: ArrayLike = 0.0) -> Floats:
        """Response, at most 1, to light from the directions (slope_x, slope_y, -1) at points of the sensor.

        Parameters
        ----------
        slope_x, slope_y : array_like
            Slopes against the sensor's normal of the direction towards the lens.
        x, y : array_like, optional
            Points of the sensor in mm.
        """
        sx, sy = np.asarray(slope_x, dtype=np.float64), np.asarray(slope_y, dtype=np.float64)
        cos = 1.0 / np.sqrt(1.0 + sx**2 + sy**2)
        chief_x, chief_y = -np.asarray(x) / self.pupil_distance, -np.asarray(y) / self.pupil_distance
        chief_cos = 1.0 / np.sqrt(1.0 + chief_x**2 + chief_y**2)
        wells = np.ones(())
        for slope, chief in ((sx, chief_x), (sy, chief_y)):
            displacement = np.abs(self._slope_inside(slope, cos) - self._slope_inside(chief, chief_cos))
            wells = wells * np.clip(1.0 - self.well_depth * displacement, 0.0, None)
        return np.asarray(wells * cos**self.exponent)

    def _slope_inside(self, slope: Floats, cos: Floats) -> Floats:
        """Slope in the well: by Snell's law the sines along both axes shrink by the index."""
        sine2 = (1.0 - cos**2) / self.index**2
        return np.asarray(slope * cos / self.index / np.sqrt(1.0 - sine2))
