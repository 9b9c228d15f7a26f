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
"""Cosine of half an angle below which it cannot be told which way round a turn goes."""
_MOST_DEG = 90.0
"""Angle between two keyframes of a screw."""


@value
class Motion:
    """A rigid motion: from keyframe to keyframe a body turns evenly about one axis, and its pivot moves on a line.

    Between two keyframes rotations follow the shorter great arc of their quaternions (slerp), so that a turn about a
    fixed axis, and a screw along it, are exact where the pivot lies on the axis. Before the first keyframe and after
    the last one the body stands still.

    Parameters
    ----------
    times : (n,) array
        Seconds, each later than the one before.
    poses : sequence of Pose
        From where the body stands to where it is at each time, p' = rotation @ p + position in the world, mm. For a
        camera without a pose of its own: its poses.
    pivot : (3,) array, optional
        The point of the body, where it stands, that moves on lines, mm. For a camera the default, its origin.

    Raises
    ------
    InvalidValueError
        Times that do not ascend or are not finite, poses of another number, or a half turn between two of them, which
        could go either way round.

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
        except TypeError:  # a single one, or an array without axes
            poses = (self.poses,)  # type: ignore[assignment]
        for pose in poses:
            check_kind(pose, "poses", Pose, "pl.Pose.look_at(...), for each of times")
        if len(poses) != len(self.times):
            raise InvalidValueError(f"there are {len(poses)} poses for {len(self.times)} times; give one for each")
        set_field(self, "poses", poses)
        set_field(self, "pivot", positions(self.pivot, name="pivot", shape=(3,)))
        _, cosines = self._turns()
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
        """A turn about an axis and a shift along it, both even: any of the two alone, or a screw.

        Parameters
        ----------
        times : (float, float)
            When it begins and ends, in s.
        axis : (3,) array
            Direction in the world, of any length above 0.
        through : (3,) array, optional
            A point of the axis, mm.
        angle_deg : float, optional
            Of the whole turn, counter-clockwise as seen by one whom the axis points at; 720 are two turns.
        advance : float, optional
            mm along the axis.

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
        share = np.linspace(0.0, 1.0, max(1, math.ceil(abs(angle) / _MOST_DEG)) + 1)
        along = frozen_array(axis, name="axis", shape=(3,))
        poses = []
        for part in share:
            turn = rotation_about(along, math.radians(math.fmod(part * angle, 360.0)))
            moved = pivot + part * shift * along / np.linalg.norm(along)
            poses.append(Pose(turn, moved - turn @ pivot))
        return cls(begin + share * (end - begin), poses, pivot)

    def at(self, time: float) -> Pose:
        """Pose of the body at a time in s."""
        matrix = self.matrices([time])[0]
        return Pose(matrix[:, :3], matrix[:, 3])

    def matrices(self, times: ArrayLike) -> Floats:
        """(n, 3, 4): rotation and shift, p' = M[:, :3] @ p + M[:, 3], at times (n,) in s."""
        when, last = np.asarray(times, dtype=np.float64), len(self.times) - 1
        turned, moved = self._keys()
        k = np.clip(np.searchsorted(self.times, when, side="right") - 1, 0, max(last - 1, 0))
        if last:
            steps = np.diff(self.times)
            share = np.clip((when - self.times[k]) / steps[k], 0.0, 1.0)
            turns, _ = self._turns()
            rotation = _rotations(share[:, None] * turns[k]) @ turned[k]
            # The mean of both ends, so that each end is met to the last bit.
            where = (1.0 - share)[:, None] * moved[k] + share[:, None] * moved[k + 1]
        else:
            rotation, where = turned[k], moved[k]
        return np.concatenate([rotation, (where - rotation @ self.pivot)[:, :, None]], axis=2)

    def seen_from(self, time: float) -> Motion:
        """The same motion of the body from where it is at a time, which becomes time 0.

        Examples
        --------
        >>> import plenoptic as pl
        >>> turn = pl.Motion.screw((0, 2), axis=(0, 0, 1), angle_deg=180)
        >>> turn.seen_from(1.0).at(1.0).to_world([1.0, 0.0, 0.0]).round(12).tolist()
        [0.0, 1.0, 0.0]
        """
        here, (turned, moved) = self.at(time), self._keys()
        pivot = here.to_world(self.pivot)
        poses = []
        for turn, place in zip(turned @ here.rotation.T, moved, strict=True):
            poses.append(Pose(turn, place - turn @ pivot))
        return Motion(self.times - time, poses, pivot)

    def carried(self, rotation: Floats, shift: Floats, scale: float = 1.0) -> Motion:
        """The same motion in a world moved by p' = scale * rotation @ p + shift."""
        turned, moved = self._keys()
        pivot = scale * rotation @ self.pivot + shift
        poses = []
        for turn, place in zip(rotation @ turned @ rotation.T, moved, strict=True):
            poses.append(Pose(turn, scale * rotation @ place + shift - turn @ pivot))
        return Motion(self.times, poses, pivot)

    def moves(self, begin: float, end: float) -> bool:
        """True if the body leaves, between two times, its pose at their beginning."""
        inside = self.times[(self.times > begin) & (self.times < end)]
        found = self.matrices(np.concatenate([[begin], inside, [end]]))
        return bool(np.any(found != found[0]))

    def _keys(self) -> tuple[Floats, Floats]:
        """Rotations (n, 3, 3) and places of the pivot (n, 3) at keyframes."""
        turned = np.array([pose.rotation for pose in self.poses])
        return turned, np.array([pose.to_world(self.pivot) for pose in self.poses])

    def _turns(self) -> tuple[Floats, Floats]:
        """(n - 1, 3): axis times angle from each keyframe to the next, in the world; cosines of half the angles."""
        turned, _ = self._keys()
        quaternions = _quaternions(turned[1:] @ turned[:-1].transpose(0, 2, 1))
        sine = np.linalg.norm(quaternions[:, 1:], axis=1)
        angle = 2.0 * np.arctan2(sine, quaternions[:, 0])
        over = np.divide(angle, sine, out=np.full_like(sine, 2.0), where=sine > 0)
        return over[:, None] * quaternions[:, 1:], quaternions[:, 0]


def ascending(times: ArrayLike, name: str) -> Floats:
    """(n,) times in s, at least one, or an error where they do not ascend."""
    given = frozen_array(times, name=name, shape=(None,))
    if not len(given) or not np.isfinite(given).all() or not np.all(np.diff(given) > 0):
        raise InvalidValueError(f"{name} is {given.tolist()!r:.80}; it must hold finite times in s that ascend")
    return given


def _quaternions(rotations: Floats) -> Floats:
    """(n, 4): w >= 0, x, y, z of rotations (n, 3, 3), by the largest of their squares (S. Shepperd, 1978)."""
    r = rotations
    trace = np.trace(r, axis1=1, axis2=2)
    squares = np.column_stack([trace, r[:, 0, 0], r[:, 1, 1], r[:, 2, 2]])
    # 4 times the outer product of the quaternion with itself: any of its rows is the quaternion, but for its length.
    outer = np.empty((len(r), 4, 4))
    outer[:, 0, 0] = 1.0 + trace
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        outer[:, k + 1, k + 1] = 1.0 + 2.0 * r[:, k, k] - trace
        outer[:, 0, k + 1] = outer[:, k + 1, 0] = r[:, j, i] - r[:, i, j]
        outer[:, i + 1, j + 1] = outer[:, j + 1, i + 1] = r[:, i, j] + r[:, j, i]
    found = outer[np.arange(len(r)), squares.argmax(axis=1)]
    found = found / np.linalg.norm(found, axis=1, keepdims=True)
    return np.asarray(np.where(found[:, :1] < 0, -found, found))


def _rotations(turns: Floats) -> Floats:
    """(n, 3, 3) of axes times angles (n, 3), by Rodrigues' formula; small angles keep their digits."""
    angle = np.linalg.norm(turns, axis=1)
    over = np.divide(1.0, angle, out=np.zeros_like(angle), where=angle > 0)
    x, y, z = (turns * over[:, None]).T
    none = np.zeros_like(x)
    cross = np.array([[none, -z, y], [z, none, -x], [-y, x, none]]).transpose(2, 0, 1)
    sine, versine = np.sin(angle)[:, None, None], 2.0 * (np.sin(0.5 * angle) ** 2)[:, None, None]
    return np.asarray(np.eye(3) + sine * cross + versine * (cross @ cross))
