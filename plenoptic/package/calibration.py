"""Calibration points: images of known points of targets behind the microlenses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.as_built_values import with_true_distances
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.gaussian import image_plane, opening_width
from plenoptic.camera.points.projection import project
from plenoptic.core.files.text_lines import csv_text
from plenoptic.core.values import Floats, check_kind, result
from plenoptic.core.warn import warn
from plenoptic.errors import FileError, InvalidValueError, UnseenSceneWarning
from plenoptic.scene.shapes.targets.target import Target

if TYPE_CHECKING:
    from plenoptic.scene.scene import Scene

_HEADER = ["frame", "point", "X_mm", "Y_mm", "Z_mm", "k", "l", "u_px", "v_px", "blur_px"]


@result
class CalibrationPoints:
    """Points of calibration targets on the sensor, a row for each point and microlens that shows it.

    Parameters
    ----------
    frame : (n,) array of int
        Number of the target.
    point : (n,) array of int
        Row of its `points`.
    world : (n, 3) array
        The point in mm.
    index : (n, 2) array of int
        Lattice indices of the microlens.
    pixel : (n, 2) array
        Row and column of the chief ray, whole numbers at the centres of pixels.
    blur : (n,) array
        Radius of its image in pixels, by Gaussian optics, behind a wholly lit microlens.

    Examples
    --------
    See `calibration_points`, which makes them.
    """

    frame: NDArray[np.int64]
    point: NDArray[np.int64]
    world: Floats
    index: NDArray[np.int64]
    pixel: Floats
    blur: Floats

    def __len__(self) -> int:
        return len(self.frame)

    def __repr__(self) -> str:
        return f"CalibrationPoints({len(self)} rows, {len(np.unique(self.frame))} targets)"

    def to_csv(self) -> str:
        """A table with a heading; u is the column and v the row."""
        v, u = self.pixel.T
        return csv_text(_HEADER, (self.frame, self.point, *self.world.T, *self.index.T, u, v, self.blur))

    @classmethod
    def from_csv(cls, text: str) -> CalibrationPoints:
        """Read the text that `to_csv` wrote; a FileError for another text."""
        check_kind(text, "text", str, "what to_csv returns")
        lines = text.splitlines()
        try:
            if lines[:1] != [",".join(_HEADER)]:
                raise ValueError(f"the heading is {''.join(lines[:1])[:80]!r}")
            table = np.loadtxt(lines[1:], delimiter=",", ndmin=2).reshape(-1, len(_HEADER))
        except ValueError as error:
            raise FileError(f"the calibration points cannot be read: {error}") from None
        whole = table.astype(np.int64)
        return cls(whole[:, 0], whole[:, 1], table[:, 2:5], whole[:, 5:7], table[:, [8, 7]], table[:, 9])


def targets_of(targets: Target | Sequence[Target]) -> tuple[Target, ...]:
    """One target or several, as a tuple; an error if something else is among them."""
    listed = (targets,) if isinstance(targets, Target) else tuple(targets)
    for target in listed:
        check_kind(target, "targets", Target, "pl.targets.checkerboard(9, 6, square=2.0)")
    return listed


def calibration_points(
    camera: PlenopticCamera, targets: Target | Sequence[Target], *, scene: Scene | None = None
) -> CalibrationPoints:
    """Project the points of targets onto the sensor, into the image of every microlens that shows them.

    Parameters
    ----------
    camera : PlenopticCamera
        Camera with microlenses.
    targets : Target or sequence of Target
        Targets in the world, one for each frame.
    scene : Scene, optional
        Scene that may hide points; None: nothing does.

    Returns
    -------
    CalibrationPoints

    Notes
    -----
    Pixels are those of chief rays, traced; see `project`. The radius of the blur is half a microlens's opening times
    1 - b (1/f - 1/s), with its focal length f, b from array to sensor, and s from the main lens's image of
    the point to the array, all paraxial.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.camera.example_camera(shape=(128, 128))
    >>> board = pl.targets.checkerboard(3, 3, square=1.0).translated(z=-404.0)
    >>> pl.package.calibration_points(camera, board)
    CalibrationPoints(128 rows, 1 targets)
    """
    check_kind(camera, "camera", PlenopticCamera, "pl.PlenopticCamera(...)")
    array = camera.microlenses
    if array is None:
        raise InvalidValueError("the camera has no microlenses; use pl.project(camera, target.points)")
    listed, built = targets_of(targets), with_true_distances(camera)
    lens_shift = 0.0 if camera.lens_placement is None else camera.lens_placement.shift[2]
    parts = []
    for frame, target in enumerate(listed):
        projection = project(camera, target.points, scene=scene, rays=1 << 8)
        projection = projection.selected(projection.visible & np.isfinite(projection.pixel).all(axis=1))
        assert projection.index is not None and projection.type is not None
        in_camera = target.points if camera.pose is None else camera.pose.to_camera(target.points)
        behind = np.array([image_plane(camera.lens, z, camera.wavelength) for z in in_camera[:, 2] - lens_shift])
        distance = (built.stop_to_microlenses - behind)[projection.point]
        power = 1.0 / np.array(array.focal_lengths)[projection.type]
        with np.errstate(divide="ignore"):
            spread = np.abs(1.0 - built.microlenses_to_sensor * (power - 1.0 / distance))
        blur = 0.5 * opening_width(array) * spread / camera.sensor.pixel_pitch
        frames, world = np.full(len(projection), frame), target.points[projection.point]
        parts.append((frames, projection.point, world, projection.index, projection.pixel, blur))
    if not parts:
        raise InvalidValueError("targets is empty; give one target or more")
    if not any(len(part[0]) for part in parts):
        warn("the camera sees none of the targets' points; move them into view", UnseenSceneWarning)
    return CalibrationPoints(*(np.concatenate(part) for part in zip(*parts, strict=True)))
