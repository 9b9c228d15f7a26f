"""Position and orientation of a camera in the world."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.motions.rotation import rotation_matrix
from plenoptic.core.values import Floats, Given, checked_field, frozen_array, numbers, positions, value
from plenoptic.errors import InvalidValueError


@value
class Pose:
    """A rigid motion from the camera's frame to the world: world = rotation @ camera + position.

    Parameters
    ----------
    rotation : (3, 3) array
        Columns are the camera's x (right), y (up) and z (backwards, against the view) in the world.
    position : (3,) array
        The camera's origin, the centre of its iris, in the world in mm.

    Raises
    ------
    InvalidValueError
        If the rotation is not orthonormal and right-handed, or a number is not finite.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pose = pl.Pose.look_at(position=(0, 0, 900), target=(0, 0, 0))
    >>> pose.to_world([[0.0, 0.0, -400.0]])
    array([[  0.,   0., 500.]])
    """

    rotation: Given[Floats, ArrayLike] = checked_field(
        rotation_matrix, remedy="scaling and mirroring belong to the scene"
    )
    position: Given[Floats, ArrayLike] = checked_field(positions, shape=(3,))

    @classmethod
    def look_at(cls, position: ArrayLike, target: ArrayLike, up: ArrayLike = (0.0, 1.0, 0.0)) -> Pose:
        """A camera at `position` that looks at `target` with `up` towards the top of its image.

        Parameters
        ----------
        position, target : (3,) arrays
            World points in mm.
        up : (3,) array
            Any direction that is not along the view.

        Raises
        ------
        InvalidValueError
            If the two points coincide or are not finite, or `up` lies along the view.

        Examples
        --------
        >>> import plenoptic as pl
        >>> pl.Pose.look_at(position=(0, 0, 900), target=(0, 0, 0))
        Pose(rotation=[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], position=[0.0, 0.0, 900.0])
        """
        start = frozen_array(position, name="position", shape=(3,))
        backwards = start - frozen_array(target, name="look_at", shape=(3,))
        upwards = frozen_array(up, name="up", shape=(3,))
        distance = float(np.linalg.norm(backwards))
        if not np.isfinite(distance) or distance == 0.0:
            raise InvalidValueError(f"position and look_at are {distance} mm apart; give distinct finite points")
        z = backwards / distance
        x = np.cross(upwards, z)
        sine = float(np.linalg.norm(x))
        if not sine > 1e-6 * float(np.linalg.norm(upwards)):
            raise InvalidValueError(f"up {tuple(upwards.tolist())} lies along the view; choose another direction")
        x = x / sine
        return cls(rotation=np.stack([x, np.cross(z, x), z], axis=1), position=start)

    def to_world(self, points: ArrayLike) -> Floats:
        """World coordinates in mm of points (..., 3) of the camera's frame."""
        return np.asarray(numbers(points, "points", columns=3) @ self.rotation.T + self.position)

    def to_camera(self, points: ArrayLike) -> Floats:
        """Coordinates in mm of world points (..., 3) in the camera's frame."""
        return np.asarray((numbers(points, "points", columns=3) - self.position) @ self.rotation)
