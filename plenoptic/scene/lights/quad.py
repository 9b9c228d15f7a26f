"""Parallelograms that light a scene."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.values import Floats, Given, checked_field, flag, length_in_mm, value
from plenoptic.errors import SceneError
from plenoptic.scene.geometry.mesh import Mesh
from plenoptic.scene.lights.fields import channel_mean, direction_towards, place_in_mm
from plenoptic.scene.materials.emissive import Emissive
from plenoptic.scene.textures.color import Colour, as_colour


@value
class QuadLight:
    """A parallelogram that emits the same radiance in all directions.

    It emits towards `edge_u` x `edge_v`, is black otherwise, and is seen by the camera like any surface.

    Parameters
    ----------
    center : (3,) array
        mm, the middle of the parallelogram.
    edge_u, edge_v : (3,) array
        mm, two neighbouring edges, whole lengths. They need not be perpendicular.
    radiance : float or (float, float, float)
        Emitted radiance in scene units, 0 or more: one number, or (red, green, blue).
    two_sided : bool
        Whether the other side emits too.

    Raises
    ------
    InvalidValueError
        Of another shape, a radiance that is not finite, or a `two_sided` that is not True or False.
    SceneError
        Edges that span no area, coordinates that are not finite, a negative radiance.

    Examples
    --------
    >>> import plenoptic as pl
    >>> light = pl.QuadLight((0, 0, 100), (20, 0, 0), (0, 10, 0), radiance=5.0)
    >>> light.normal.tolist(), light.area
    ([0.0, 0.0, 1.0], 200.0)
    """

    center: Given[Floats, ArrayLike] = checked_field(place_in_mm)
    edge_u: Given[Floats, ArrayLike] = checked_field(place_in_mm)
    edge_v: Given[Floats, ArrayLike] = checked_field(place_in_mm)
    radiance: Colour = checked_field(as_colour, default=1.0)
    two_sided: bool = checked_field(flag, default=False)

    def __post_init__(self) -> None:
        if not self.area > 0:
            raise SceneError(
                f"edge_u {self.edge_u.tolist()} and edge_v {self.edge_v.tolist()} span no area; "
                "they must be longer than 0 mm and not parallel"
            )

    @classmethod
    def facing(
        cls,
        center: ArrayLike,
        target: ArrayLike,
        size: tuple[float, float],
        *,
        radiance: Colour = 1.0,
        two_sided: bool = False,
    ) -> QuadLight:
        """A rectangle that faces a point, with its width horizontal (perpendicular to y).

        Parameters
        ----------
        center, target : (3,) array
            mm, the middle of the light, and the point that it faces.
        size : (float, float)
            (width, height), mm, above 0.
        radiance, two_sided : float or (float, float, float), bool
            As in `QuadLight`.

        Raises
        ------
        InvalidValueError
            A size that is not above 0.
        SceneError
            The target is the light's own centre.

        Examples
        --------
        >>> import plenoptic as pl
        >>> lamp = pl.QuadLight.facing((0, 60, -360), (0, 0, -360), (40, 20), radiance=10)
        >>> lamp.normal.tolist(), lamp.area
        ([0.0, -1.0, 0.0], 800.0)
        """
        middle = place_in_mm(center, "center")
        normal = direction_towards(middle, target, "center")
        try:
            width, height = size
        except (TypeError, ValueError):
            raise SceneError(f"size is {size!r}; it must be (width, height) in mm") from None
        # Straight up or down there is no horizontal to prefer: the height then lies along z.
        up = (0.0, 1.0, 0.0) if abs(normal[1]) < 1 - 1e-9 else (0.0, 0.0, 1.0)
        u = np.cross(up, normal)
        u /= np.linalg.norm(u)
        edge_v = np.cross(normal, u) * length_in_mm(height, "height")
        return cls(middle, u * length_in_mm(width, "width"), edge_v, radiance, two_sided)

    @property
    def normal(self) -> Floats:
        """(3,), unit length: the direction in which the light emits.

        Examples
        --------
        >>> import plenoptic as pl
        >>> pl.QuadLight((0, 0, 0), (0, 2, 0), (0, 0, 2)).normal.tolist()
        [1.0, 0.0, 0.0]
        """
        cross = np.cross(self.edge_u, self.edge_v)
        return np.asarray(cross / np.linalg.norm(cross))

    @property
    def area(self) -> float:
        """Area of one side, mm^2.

        Examples
        --------
        >>> import plenoptic as pl
        >>> pl.QuadLight((0, 0, 0), (2, 0, 0), (1, 3, 0)).area
        6.0
        """
        return float(np.linalg.norm(np.cross(self.edge_u, self.edge_v)))

    @property
    def power(self) -> float:
        """All the light it emits, the mean of its channels, radiance mm^2 sr: pi radiance area, for each side.

        Examples
        --------
        >>> import plenoptic as pl
        >>> light = pl.QuadLight((0, 0, 0), (2, 0, 0), (0, 3, 0), radiance=(1, 2, 3), two_sided=True)
        >>> round(light.power, 6)
        75.398224
        """
        return np.pi * self.area * (1 + self.two_sided) * channel_mean(self.radiance)

    def moved(self, matrix: Floats, scale: float) -> QuadLight:
        """The light where a (4, 4) similarity of that scale puts it; its radiance stays."""
        turn = matrix[:3, :3]
        center = turn @ self.center + matrix[:3, 3]
        return dataclasses.replace(self, center=center, edge_u=turn @ self.edge_u, edge_v=turn @ self.edge_v)

    def mesh(self) -> Mesh:
        """The light as two emissive triangles, counter-clockwise as seen from the side that emits.

        Examples
        --------
        >>> import plenoptic as pl
        >>> pl.QuadLight((0, 0, 0), (2, 0, 0), (0, 2, 0)).mesh().bounds.tolist()
        [[-1.0, -1.0, 0.0], [1.0, 1.0, 0.0]]
        """
        u, v = 0.5 * self.edge_u, 0.5 * self.edge_v
        corners = self.center + np.array([-u - v, u - v, u + v, -u + v])
        return Mesh(corners, [[0, 1, 2], [0, 2, 3]], Emissive(self.radiance, self.two_sided), name="light")
