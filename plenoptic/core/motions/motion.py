"""Rigid motions in time: keyframes, and screws between them."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.motions.pose import Pose
from plenoptic.core.motions.rotation import rotation_about
from plenoptic.core.values import Floats, Given, check_kind, finite, frozen_array, positions, set_field, value
from plenoptic.errors import InvalidValueError

_HALF_TURN = 1e-4
"""Cosine of half a rotation angle below which the sense of the rotation is ambiguous."""
_MAX_STEP_DEG = 90.0
"""Largest angle between two keyframes of a screw motion."""


@value
class Motion:
    """A rigid motion: between keyframes a body rotates uniformly about one axis, and its pivot moves on a line.

    Between two keyframes rotations follow the shorter great arc of their quaternions (slerp). A rotation about a fixed
    axis, and a screw motion along it, are therefore exact if the pivot lies on the axis. The body is at rest before the
    first keyframe and after the last one.

    Parameters
    ----------
    times : (n,) array
        Seconds, ascending.
    poses : sequence of Pose
        Transform at each time from the body as modelled to the world, p' = rotation @ p + position, mm. For a
        camera without a pose of its own: its poses.
    pivot : (3,) array, optional
        Point of the body as modelled that moves on lines, mm. For a camera the default, its origin.

    Raises
    ------
    InvalidValueError
        If times do not ascend or are not finite, the number of poses differs, or two consecutive poses are half a turn
        apart, so that the sense of the rotation is ambiguous.

    Notes
    -----
    K. Shoemake, Animating rotation with quaternion curves, SIGGRAPH 1985, doi 10.1145/325165.325242.

    Examples
    --------
    >>> import plenoptic as pl
    >>> poses = [pl.Pose.look_at((x, 0, 0), target=(0, 0, -404)) for x in (-50, 50)]
    >>> pl.Motion((0.0, 2.0), poses).at(0.5).position.tolist()
    [-25.0, 0.0, 0.0]
    """

    times: Given[Floats, ArrayLike]
    poses: Given[tuple[Pose, ...], Iterable[Pose]]
    pivot: Given[Floats, ArrayLike] = Given(default=(0.0, 0.0, 0.0))

    def __post_init__(self) -> None:
        set_field(self, "times", ascending(self.times, "times"))
        try:
            poses = tuple(self.poses)
        except TypeError:  # a single pose, or an array without axes
            poses = (self.poses,)  # type: ignore[assignment]
        for pose in poses:
            check_kind(pose, "poses", Pose, "pl.Pose.look_at(...), for each of times")
        if len(poses) != len(self.times):
            raise InvalidValueError(f"there are {len(poses)} poses for {len(self.times)} times; give one for each")
        set_field(self, "poses", poses)
        set_field(self, "pivot", positions(self.pivot, name="pivot", shape=(3,)))
        _, cosines = self._rotation_vectors()
        for k in np.flatnonzero(cosines < _HALF_TURN):
            raise InvalidValueError(
                f"poses {k} and {k + 1} are half a turn apart, which could go either way round; give one in between"
            )

    @classmethod
    def screw(
        cls,
        times: tuple[float, float],
        *,
        axis: ArrayLike,
        through: ArrayLike = (0.0, 0.0, 0.0),
        angle_deg: float = 0.0,
        advance: float = 0.0,
    ) -> Motion:
        """Uniform rotation about an axis and uniform shift along it: either alone, or a screw motion.

        Parameters
        ----------
        times : (float, float)
            Begin and end in s.
        axis : (3,) array
            Direction in the world, of any length above 0.
        through : (3,) array, optional
            A point of the axis, mm.
        angle_deg : float, optional
            Total angle, counter-clockwise seen from the tip of the axis; 720 is two turns.
        advance : float, optional
            Shift along the axis in mm.

        Examples
        --------
        >>> import plenoptic as pl
        >>> half = pl.Motion.screw((0, 2), axis=(0, 0, 1), through=(1, 0, 0), angle_deg=180, advance=6).at(1.0)
        >>> half.to_world([2.0, 0.0, 0.0]).round(12).tolist()
        [1.0, 1.0, 3.0]
        """
        begin, end = (finite(time, "times") for time in frozen_array(times, name="times", shape=(2,)).tolist())
        angle, shift = finite(angle_deg, "angle_deg"), finite(advance, "advance")
        pivot = positions(through, name="through", shape=(3,))
        fractions = np.linspace(0.0, 1.0, max(1, math.ceil(abs(angle) / _MAX_STEP_DEG)) + 1)
        direction = frozen_array(axis, name="axis", shape=(3,))
        poses = []
        for fraction in fractions:
            rotation = rotation_about(direction, math.radians(math.fmod(fraction * angle, 360.0)))
            position = pivot + fraction * shift * direction / np.linalg.norm(direction)
            poses.append(Pose(rotation, position - rotation @ pivot))
        return cls(begin + fractions * (end - begin), poses, pivot)

    def at(self, time: float) -> Pose:
        """Pose of the body at a time in s."""
        matrix = self.matrices([time])[0]
        return Pose(matrix[:, :3], matrix[:, 3])

    def matrices(self, times: ArrayLike) -> Floats:
        """(n, 3, 4) rotation and shift, p' = M[:, :3] @ p + M[:, 3], at times (n,) in s."""
        t, last = np.asarray(times, dtype=np.float64), len(self.times) - 1
        rotations, pivots = self._keyframes()
        k = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, max(last - 1, 0))
        if last:
            steps = np.diff(self.times)
            fraction = np.clip((t - self.times[k]) / steps[k], 0.0, 1.0)
            steps_between, _ = self._rotation_vectors()
            rotation = _rotations(fraction[:, None] * steps_between[k]) @ rotations[k]
            # A weighted mean of both ends reproduces each end to the last bit.
            pivot = (1.0 - fraction)[:, None] * pivots[k] + fraction[:, None] * pivots[k + 1]
        else:
            rotation, pivot = rotations[k], pivots[k]
        return np.concatenate([rotation, (pivot - rotation @ self.pivot)[:, :, None]], axis=2)

    def seen_from(self, time: float) -> Motion:
        """The same motion relative to the body's pose at a time, which becomes time 0.

        Examples
        --------
        >>> import plenoptic as pl
        >>> turn = pl.Motion.screw((0, 2), axis=(0, 0, 1), angle_deg=180)
        >>> turn.seen_from(1.0).at(1.0).to_world([1.0, 0.0, 0.0]).round(12).tolist()
        [0.0, 1.0, 0.0]
        """
        reference, (rotations, pivots) = self.at(time), self._keyframes()
        pivot = reference.to_world(self.pivot)
        poses = []
        for rotation, position in zip(rotations @ reference.rotation.T, pivots, strict=True):
            poses.append(Pose(rotation, position - rotation @ pivot))
        return Motion(self.times - time, poses, pivot)

    def in_frame(self, rotation: Floats, shift: Floats, scale: float = 1.0) -> Motion:
        """The same motion in a world transformed by p' = scale * rotation @ p + shift."""
        rotations, pivots = self._keyframes()
        pivot = scale * rotation @ self.pivot + shift
        poses = []
        for turn, position in zip(rotation @ rotations @ rotation.T, pivots, strict=True):
            poses.append(Pose(turn, scale * rotation @ position + shift - turn @ pivot))
        return Motion(self.times, poses, pivot)

    def moves(self, begin: float, end: float) -> bool:
        """True if the body leaves its pose at the beginning of an interval of time during it."""
        inside = self.times[(self.times > begin) & (self.times < end)]
        matrices = self.matrices(np.concatenate([[begin], inside, [end]]))
        return bool(np.any(matrices != matrices[0]))

    def _keyframes(self) -> tuple[Floats, Floats]:
        """Rotations (n, 3, 3) and positions of the pivot (n, 3) at keyframes."""
        rotations = np.array([pose.rotation for pose in self.poses])
        return rotations, np.array([pose.to_world(self.pivot) for pose in self.poses])

    def _rotation_vectors(self) -> tuple[Floats, Floats]:
        """(n - 1, 3) axis times angle between keyframes in the world, and cosines (n - 1,) of half the angle."""
        rotations, _ = self._keyframes()
        quaternions = _quaternions(rotations[1:] @ rotations[:-1].transpose(0, 2, 1))
        sine = np.linalg.norm(quaternions[:, 1:], axis=1)
        angle = 2.0 * np.arctan2(sine, quaternions[:, 0])
        angle_over_sine = np.divide(angle, sine, out=np.full_like(sine, 2.0), where=sine > 0)
        return angle_over_sine[:, None] * quaternions[:, 1:], quaternions[:, 0]


def ascending(times: ArrayLike, name: str) -> Floats:
    """(n,) times in s, at least one, or an error if they do not ascend."""
    array = frozen_array(times, name=name, shape=(None,))
    if not len(array) or not np.isfinite(array).all() or not np.all(np.diff(array) > 0):
        raise InvalidValueError(f"{name} is {array.tolist()!r:.80}; it must hold finite times in s that ascend")
    return array


def _quaternions(rotations: Floats) -> Floats:
    """(n, 4) quaternions (w >= 0, x, y, z) of rotations (n, 3, 3), from the largest component (S. Shepperd, 1978)."""
    r = rotations
    trace = np.trace(r, axis1=1, axis2=2)
    squares = np.column_stack([trace, r[:, 0, 0], r[:, 1, 1], r[:, 2, 2]])
    # 4 times the outer product of the quaternion with itself: each of its rows is parallel to the quaternion.
    outer = np.empty((len(r), 4, 4))
    outer[:, 0, 0] = 1.0 + trace
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        outer[:, k + 1, k + 1] = 1.0 + 2.0 * r[:, k, k] - trace
        outer[:, 0, k + 1] = outer[:, k + 1, 0] = r[:, j, i] - r[:, i, j]
        outer[:, i + 1, j + 1] = outer[:, j + 1, i + 1] = r[:, i, j] + r[:, j, i]
    rows = outer[np.arange(len(r)), squares.argmax(axis=1)]
    rows = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    return np.asarray(np.where(rows[:, :1] < 0, -rows, rows))


def _rotations(vectors: Floats) -> Floats:
    """(n, 3, 3) rotations about axes by angles, given as products (n, 3), by Rodrigues' formula, accurate if small."""
    angle = np.linalg.norm(vectors, axis=1)
    inverse = np.divide(1.0, angle, out=np.zeros_like(angle), where=angle > 0)
    x, y, z = (vectors * inverse[:, None]).T
    zero = np.zeros_like(x)
    cross = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
    sine, versine = np.sin(angle)[:, None, None], 2.0 * (np.sin(0.5 * angle) ** 2)[:, None, None]
    return np.asarray(np.eye(3) + sine * cross + versine * (cross @ cross))
