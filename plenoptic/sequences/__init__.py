"""Sequences of frames: cameras and objects that move, lights that change, and where points go from frame to frame."""

from plenoptic.camera.shutter import Shutter
from plenoptic.core.motions.motion import Motion
from plenoptic.sequences.point_motion import MotionTruth, motion_truth
from plenoptic.sequences.sequence import Frame, Sequence

__all__ = ["Frame", "Motion", "MotionTruth", "Sequence", "Shutter", "motion_truth"]
