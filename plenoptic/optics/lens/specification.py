"""Design specification of a lens, as stated in its file."""

from __future__ import annotations

import dataclasses
import enum
import math

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.values import Floats, Given, frozen_array, number, positive, set_field, value
from plenoptic.errors import InvalidValueError


class StopSize(enum.IntEnum):
    """Source of the stop size in a Zemax file. See `load_lens`.

    Examples
    --------
    >>> import plenoptic as pl
    >>> [choice.name for choice in pl.optics.StopSize]
    ['SYSTEM_APERTURE', 'DIAMETER']
    """

    SYSTEM_APERTURE = 0
    """System aperture, as in Zemax: entrance pupil diameter (ENPD), f-number (FNUM) or numerical aperture (OBNA), by
    the paraxial marginal ray. DIAMETER if the aperture floats by the stop (FLOA) or is missing."""
    DIAMETER = 1
    """Semi-diameter of the stop's surface (DIAM, or its aperture), regardless of the system aperture."""


@value
class Specification:
    """Fields, wavelengths, object and image of a lens, as stated in its file; `LensStack.specification` of Zemax files.

    Lengths are in mm, z in the lens frame.

    Parameters
    ----------
    fields : (n, 2) array
        Object points for `field=` of analyses: angles in radians if `z_object` is -inf, otherwise heights in mm.
    wavelengths : tuple of float
        nm, the primary one first.
    z_object : float
        z of the object; -inf for an object at infinity.
    z_image : float
        z of the vertex of the image surface.
    image_radius : float
        Radius of curvature of the image surface; inf: a plane.
    entrance_pupil_diameter : float, optional
        Paraxial diameter by the system aperture, at the primary wavelength, mm.
    stop_semi_diameter : float, optional
        Semi-diameter by the stop's surface, mm.

    Raises
    ------
    InvalidValueError
        If a number is out of range.

    Examples
    --------
    >>> import plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2")
    >>> z = pl.paraxial.cardinal_points(lens).rear_focus
    >>> specification = pl.optics.Specification([(0.0, 0.0), (0.0, 0.17)], (587.6, 486.1, 656.3), z_image=z)
    >>> wide = pl.aberrations.spot_diagram(lens, field=specification.fields[1],
    ...                                    z_image=z, wavelength=specification.wavelengths)
    >>> f"{wide.centroid[1]:.0f} mm"
    '-17 mm'
    """

    fields: Given[Floats, ArrayLike]
    wavelengths: tuple[float, ...]
    _: dataclasses.KW_ONLY
    z_object: float = -math.inf
    z_image: float
    image_radius: float = math.inf
    entrance_pupil_diameter: float | None = None
    stop_semi_diameter: float | None = None

    def __post_init__(self) -> None:
        set_field(self, "fields", frozen_array(self.fields, name="fields", shape=("n", 2)))
        if not np.isfinite(self.fields).all():
            raise InvalidValueError("fields holds a number that is not finite; give radians, or heights in mm")
        waves = tuple(positive(wave, "wavelength", "nm") for wave in self.wavelengths)
        if not waves:
            raise InvalidValueError("wavelengths is empty; give at least one in nm, such as (587.6,)")
        set_field(self, "wavelengths", waves)
        for name in ("z_object", "z_image", "image_radius"):
            set_field(self, name, number(getattr(self, name), name))
        for name in ("entrance_pupil_diameter", "stop_semi_diameter"):
            if getattr(self, name) is not None:
                set_field(self, name, positive(getattr(self, name), name, "mm"))

    def without_aperture(self) -> Specification:
        """Specification of the same lens with another stop: without aperture data."""
        return dataclasses.replace(self, entrance_pupil_diameter=None, stop_semi_diameter=None)
