"""Reflecting surfaces, and unfolding of the path behind them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.values import Floats, positions, set_field, value
from plenoptic.errors import PrescriptionError
from plenoptic.optics.glass.media import Medium

_STEEPEST = 1e-6
"""Smallest cosine of the angle between the axis and a fold's normal; below it, light is parallel to the mirror."""


@value
class Mirror:
    """Medium of a reflecting surface: the ray stays in the medium in front.

    The lens frame is unfolded: elements behind a mirror are described by their mirror images. Light therefore always
    travels towards +z and gaps are positive. A surface of positive radius is convex towards the incident light: a
    concave mirror has a negative radius, a convex one a positive one. Behind an odd number of mirrors radii have the
    opposite sign than in prescriptions that reverse the axis. A ray reflected at a height z over the mirror's vertex
    continues from -z. In paraxial optics the mirror is a surface of the power -2 n c.

    Parameters
    ----------
    fold : (3,) array, optional
        Normal of the plane of unfolding, through the mirror's vertex on the axis; stored with length 1 and z above 0.
        Along the axis, unless a tilted mirror folds the axis itself: then the mirror's own normal.

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
                f"fold is {normal.tolist()}; it must be the normal of a plane that reflects light along the axis, such "
                "as (0, 0, 1)"
            )
        set_field(self, "fold", positions(normal / (length if normal[2] > 0 else -length), name="fold", shape=(3,)))

    def index(self, wavelength: float) -> float:
        """Raise PrescriptionError, since a mirror has no index. See `LensStack.indices`."""
        raise PrescriptionError(
            f"a mirror has no refractive index at {wavelength:g} nm, and no medium precedes it; use it as the "
            "medium of a surface of a lens, and call lens.indices()"
        )

    @property
    def unfolding(self) -> Floats:
        """(3, 3) reflection in the plane of the fold."""
        normal = np.asarray(self.fold)
        return np.asarray(np.eye(3) - 2.0 * np.outer(normal, normal))


MIRROR = Mirror()
"""A mirror on the axis: `pl.Surface(-400.0, medium=pl.optics.MIRROR, ...)`."""


def medium_behind(medium: Medium, before: Medium) -> Medium:
    """Medium in the gap behind a surface: the medium before it for a mirror."""
    return before if isinstance(medium, Mirror) else medium
