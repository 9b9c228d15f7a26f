"""Cameras of scene files."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.rays import Frustum
from plenoptic.core.values import Floats, Given, checked_field, finite, positions, positive, value
from plenoptic.errors import InvalidValueError


@value
class View:
    """A camera of a scene file: its place, its direction and how much it sees; nothing of its optics.

    Parameters
    ----------
    name : str
        For the reader.
    position : (3,) array
        mm, in the world.
    look_at : (3,) array
        mm, a point straight ahead; in files, which do not give the distance of their objects, one unit ahead.
    up : (3,) array
        The direction that is up in the picture; not along the view.
    vertical_field_of_view : float, optional
        Radians, between the lower and the upper edge of the picture, above 0 and below pi. None: an orthographic view.
    aspect_ratio : float, optional
        Width over height of the picture, above 0. None: the file does not say.

    Raises
    ------
    InvalidValueError
        Of another shape, not finite, out of range; a look_at at the position, an up along the view.

    Examples
    --------
    A camera in its place, with its field of view: the sensor is as high as the picture behind the lens.

    >>> import math, plenoptic as pl
    >>> view = pl.scene.View("front", (0, 0, 400), (0, 0, 0), vertical_field_of_view=0.4, aspect_ratio=1.5)
    >>> height = 2 * 50.0 * math.tan(view.vertical_field_of_view / 2)
    >>> camera = pl.PlenopticCamera(lens=pl.no_lens(semi_diameter=1.0), stop_to_microlenses=50.0,
    ...     sensor=pl.Sensor(shape=(40, 60), pixel_pitch=height / 40))
    >>> camera = camera.posed(position=view.position, look_at=view.look_at, up=view.up)
    >>> camera.pose.position.tolist()
    [0.0, 0.0, 400.0]
    """

    name: str
    position: Given[Floats, ArrayLike] = checked_field(positions, shape=(3,))
    look_at: Given[Floats, ArrayLike] = checked_field(positions, shape=(3,))
    up: Given[Floats, ArrayLike] = checked_field(positions, shape=(3,), default=(0.0, 1.0, 0.0))
    vertical_field_of_view: float | None = checked_field(finite, default=None)
    aspect_ratio: float | None = checked_field(positive, default=None)

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise InvalidValueError(f"name is {self.name!r}; it must be a text")
        ahead = self.look_at - self.position
        if not ahead.any():
            raise InvalidValueError(f"look_at is the position, {self.position.tolist()} mm; give a point ahead of it")
        across = np.linalg.norm(np.cross(ahead, self.up))
        if not across > 1e-9 * np.linalg.norm(ahead) * np.linalg.norm(self.up):
            raise InvalidValueError(f"up is {self.up.tolist()}, along the view; give a direction across it")
        angle = self.vertical_field_of_view
        if angle is not None and not 0 < angle < math.pi:
            raise InvalidValueError(f"vertical_field_of_view is {angle:g} rad; it must be above 0 and below pi")

    @property
    def frustum(self) -> Frustum:
        """Rays through the corners of the picture; parallel ones, one unit apart, for an orthographic view.

        Examples
        --------
        >>> import plenoptic as pl
        >>> pl.scene.View("front", (0, 0, 100), (0, 0, 0), vertical_field_of_view=1.0).frustum.directions[0].round(2)
        array([-0.43, -0.43, -0.79])
        """
        ahead = (self.look_at - self.position) / np.linalg.norm(self.look_at - self.position)
        right = np.cross(ahead, self.up)
        right /= np.linalg.norm(right)
        high, wide = np.array([-1, -1, 1, 1]), np.array([-1, 1, 1, -1]) * (self.aspect_ratio or 1.0)
        aside = np.outer(wide, right) + np.outer(high, np.cross(right, ahead))
        origins = np.tile(self.position, (4, 1))
        if self.vertical_field_of_view is None:
            return Frustum(origins + aside, np.tile(ahead, (4, 1)))
        directions = ahead + math.tan(0.5 * self.vertical_field_of_view) * aside
        return Frustum(origins, directions / np.linalg.norm(directions, axis=1, keepdims=True))

    def moved(self, matrix: Floats) -> View:
        """The view from where a (4, 4) similarity puts it."""
        turn, shift = matrix[:3, :3], matrix[:3, 3]
        position, look_at = turn @ self.position + shift, turn @ self.look_at + shift
        return dataclasses.replace(self, position=position, look_at=look_at, up=turn @ self.up)
