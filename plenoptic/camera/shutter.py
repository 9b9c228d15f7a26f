"""Exposure times of the rows of the sensor."""

from __future__ import annotations

from plenoptic.core.motions.motion import Motion
from plenoptic.core.values import check_kind, checked_field, finite, positive, value


@value
class Shutter:
    """Exposure time, for motion blur and the distortion of a rolling shutter.

    Parameters
    ----------
    duration : float
        Exposure time of each row in s.
    row_time : float, optional
        Delay in s between the opening of a row and of the row above it; negative if the bottom row opens first. 0 is a
        global shutter.
    motion : Motion, optional
        Motion of the camera in the world from its `pose`, by the time in s from the middle of the exposure of the
        sensor's centre. `Sequence` sets it. None: the camera is at rest.

    Raises
    ------
    InvalidValueError
        If the duration is not above 0, or a number is not finite.

    Notes
    -----
    Ground truth refers to the middle of the exposure. Images are means over time: their unit does not change.

    Examples
    --------
    A box falls past a camera whose rows are read one after the other:

    >>> import dataclasses, plenoptic as pl
    >>> camera = dataclasses.replace(pl.camera.example_camera(pl.CameraKind.CONVENTIONAL, shape=(16, 16)),
    ...     shutter=pl.sequences.Shutter(duration=0.002, row_time=0.001))
    >>> fall = pl.Motion.screw((0, 1), axis=(0, -1, 0), advance=400.0)
    >>> scene = pl.Scene([pl.box(8).translated(0, 10, -404)], background=1.0)
    >>> frame = pl.Sequence(scene, camera, [0.025], motions={"Mesh 0": fall})[0]
    >>> shot = pl.render(frame.scene, frame.camera, samples=16, progress=False)
    """

    duration: float = checked_field(positive, unit="s")
    row_time: float = checked_field(finite, default=0.0)
    motion: Motion | None = None

    def __post_init__(self) -> None:
        if self.motion is not None:
            check_kind(self.motion, "motion", Motion, "pl.Motion.screw((-1, 1), axis=(1, 0, 0), advance=5)")
