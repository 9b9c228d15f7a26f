"""Substitute for the main lens of a camera without one."""

from __future__ import annotations

import math

from plenoptic.core.values import length_in_mm
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.stops.circle import CircularStop
from plenoptic.optics.surfaces.surface import Surface


def no_lens(semi_diameter: float) -> LensStack:
    """Opening without a lens: a microlens array behind it is an array of cameras.

    The stack is a stop and a plane in air, with LensModel.NONE.

    Parameters
    ----------
    semi_diameter : float
        Radius in mm of the round opening at z = 0, in front of the array. It blocks all light outside. Rays sample all
        of it, so it should be just large enough for the array and its field.

    Examples
    --------
    >>> import plenoptic as pl
    >>> array = pl.MicrolensArray(pitch=10.0, focal_lengths=(8.0,), lattice=pl.Lattice.SQUARE,
    ...     aperture=pl.optics.MicrolensAperture(pl.optics.ApertureShape.CIRCLE, fill_factor=0.01),
    ...     walls=pl.optics.Walls.OPAQUE)
    >>> cameras = pl.PlenopticCamera(lens=pl.no_lens(25.0), microlenses=array, stop_to_microlenses=1.0,
    ...     microlenses_to_sensor=8.1, sensor=pl.Sensor(shape=(300, 300), pixel_pitch=0.1))
    >>> cameras.report().kind.name
    'CAMERA_ARRAY'
    """
    radius = length_in_mm(semi_diameter, "semi_diameter")
    return LensStack(
        [CircularStop(radius), Surface(radius=math.inf, semi_diameter=2.0 * radius)],
        name="no lens",
        model=LensModel.NONE,
    )
