"""Surfaces that reflect, and how the path behind them is unfolded."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.values import Floats, positions, set_field, value
from plenoptic.errors import PrescriptionError
from plenoptic.optics.glass.media import Medium

_STEEPEST = 1e-6
"""Cosine of the angle between the axis and the normal of a fold below which light would run along the mirror."""


@value
class Mirror:
    """Medium behind a reflecting surface: light stays in the medium in front.

    Behind a mirror the lens's frame shows later elements as seen in the mirror, so that light always goes towards +z,
    gaps are positive, and a surface is convex towards the light that meets it where its radius is positive: a concave
    mirror has a negative radius, a convex one a positive one, and behind an odd number of mirrors radii have the other
    sign than in prescriptions that turn the axis round. A ray met by a mirror at a height z over its vertex goes on
    from -z. To paraxial rays the mirror is a surface of the power -2 n c.

    Parameters
    ----------
    fold : (3,) array, optional
        Normal of the plane through the mirror's place on the axis in which later elements are seen; kept with length 1
        and z above 0. Along the axis, unless a mirror that stands askew folds the axis itself: then its own normal.

    Raises
    ------
    PrescriptionError
        If the normal has no direction, or is perpendicular to the axis.

    Examples
    --------
    >>> import plenoptic as pl
    >>> primary = pl.Surface(-400.0, medium=pl.optics.MIRROR, semi_diameter=50.0, conic=-1.0)
    >>> newton = pl.LensStack([pl.CircularStop(50.0), primary])
    >>> pl.paraxial.cardinal_points(newton).efl
    200.0
    """

    fold: ArrayLike = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        normal = np.asarray(positions(self.fold, name="fold", shape=(3,)))
        length = float(np.linalg.norm(normal))
        if not abs(normal[2]) > _STEEPEST * length:
            raise PrescriptionError(
                f"fold is {normal.tolist()}; it must be the normal of a plane that light comes to along the axis, such "
                "as (0, 0, 1)"
            )
        set_field(self, "fold", positions(normal / (length if normal[2] > 0 else -length), name="fold", shape=(3,)))

    def index(self, wavelength: float) -> float:
        """An error: a mirror has no index of its own. See `LensStack.indices`."""
        raise PrescriptionError(
            f"a mirror has no refractive index at {wavelength:g} nm, and there is nothing before it; put it on a "
            "surface of a lens and ask lens.indices()"
        )

    @property
    def unfolding(self) -> Floats:
        """(3, 3): reflection in the plane of the fold."""
        normal = np.asarray(self.fold)
        return np.asarray(np.eye(3) - 2.0 * np.outer(normal, normal))


MIRROR = Mirror()
"""A mirror on the axis: `pl.Surface(-400.0, medium=pl.optics.MIRROR, ...)`."""


def medium_behind(medium: Medium, before: Medium) -> Medium:
    """Medium of the gap behind a surface: the one before it where the surface is a mirror."""
    return before if isinstance(medium, Mirror) else medium
