"""Exposure times of the sensor's rows."""

from __future__ import annotations

from plenoptic.core.motions.motion import Motion
from plenoptic.core.values import check_kind, finite, positive, set_field, value


@value
class Shutter:
    """Duration of the exposure. Motion meanwhile blurs, and skews the image where rows begin one after the other.

    Parameters
    ----------
    duration : float
        Seconds from opening to closing, for each row.
    row_time : float, optional
        Seconds by which each row opens later than the one above it; negative where the bottom one is first. 0 is a
        global shutter.
    motion : Motion, optional
        How the camera moves in the world from its `pose`, by the time in s from the middle of the exposure: that of the
        middle of the sensor. `Sequence` gives it. None: it stands still.

    Raises
    ------
    InvalidValueError
        A duration that is not above 0, or a number that is not finite.

    Notes
    -----
    Ground truth is that of the middle of the exposure. Images are means over the time: their unit does not change.

    Examples
    --------
    A box falls past a camera whose rows are read one after the other:

    >>> import dataclasses, plenoptic as pl
    >>> camera = pl.PlenopticCamera(lens=pl.load_lens("double-gauss-100mm-f2"),
    ...     sensor=pl.Sensor(shape=(16, 16), pixel_pitch=0.5), stop_to_microlenses=130.0,
    ...     shutter=pl.sequences.Shutter(duration=0.002, row_time=0.001))
    >>> fall = pl.Motion.screw((0, 1), axis=(0, -1, 0), advance=400.0)
    >>> scene = pl.Scene([pl.box(8).translated(0, 10, -404)], background=1.0)
    >>> frame = pl.Sequence(scene, camera, [0.025], motions={"Mesh 0": fall})[0]
    >>> shot = pl.render(frame.scene, frame.camera, samples=16, progress=False)
    """

    duration: float
    row_time: float = 0.0
    motion: Motion | None = None

    def __post_init__(self) -> None:
        set_field(self, "duration", positive(self.duration, "duration", "s"))
        set_field(self, "row_time", finite(self.row_time, "row_time"))
        if self.motion is not None:
            check_kind(self.motion, "motion", Motion, "pl.Motion.screw((-1, 1), axis=(1, 0, 0), advance=5)")
