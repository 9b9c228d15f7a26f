"""Scenes and cameras for depth: textured planes at known virtual depths before cameras of one and of three types."""

import dataclasses
import math

import numpy as np
import reference

import plenoptic as pl
from plenoptic.camera.gaussian import lateral_magnification, object_plane

SEEN_BY_THREE = (-345.0, -404.0, -470.0)
"""Planes in focus of three types of microlenses, mm."""
_TEXELS = 512


def focused(**changes):
    """The reference camera, changed."""
    return reference.built((512, 512), **changes)


def three_types():
    """As in examples/multi_focus.py."""
    behind = [pl.paraxial.image_position(reference.camera().lens, z) - 123.3 for z in SEEN_BY_THREE]
    return focused(focal_lengths=tuple(1 / (1 / 1.7 - 1 / s) for s in behind))


def turned():
    """A smaller pitch, turned by 13 degrees and out of place."""
    c, s = math.cos(math.radians(13.0)), math.sin(math.radians(13.0))
    placement = pl.optics.Placement(rotation=[[c, -s, 0], [s, c, 0], [0, 0, 1]], shift=(0.02, 0.03, 0.0))
    camera = focused(focal_lengths=(1.4,), pitch=0.15, b=1.2)
    return dataclasses.replace(camera, microlenses_placement=placement)


def plane(camera, v, seed, *, contrast=0.2, tilt=0.0, right=False, colours=1):
    """1/f noise that glows, of texels as large as pixels, on a plane whose image lies v b behind the array.

    `contrast` is the standard deviation, of a mean of 0.5; `tilt` is in degrees; `right` leaves its left half out.
    """
    z = object_plane(camera.lens, camera.stop_to_microlenses + v * camera.microlenses_to_sensor, camera.wavelength)
    scale = abs(v * camera.sensor.pixel_pitch / lateral_magnification(camera.lens, z, camera.wavelength))
    side, slope = scale * _TEXELS, math.tan(math.radians(tilt))
    common = reference.noise(seed, _TEXELS)
    own = [0.5 * (common + reference.noise(seed + 100 * k, _TEXELS)) for k in range(colours)]
    picture = np.stack(own if colours > 1 else [common], -1)
    left = 0.3 * scale if right else -0.5 * side
    corner = (left, -0.5 * side, z - 0.5 * slope * side)
    return reference.glowing(picture, corner, (side, 0.0, slope * side), (0.0, side, 0.0), contrast=contrast)


def near_centres(camera, shot, part=7.0 / 22.0):
    """Pixels of a shot within a part of the pitch of the centre of a micro image, a pitch from its border."""
    centres = pl.microlens_centres(camera, pl.CentreMethod.CHIEF_RAY).pixel - np.array(shot.region)[[0, 2]]
    pitch = min(camera.microlenses.pitches) / camera.sensor.pixel_pitch
    rows, columns = shot.image.shape[:2]
    amid = ((centres > pitch) & (centres < np.array([rows, columns]) - 1 - pitch)).all(axis=1)
    found, reach = np.zeros((rows, columns), dtype=bool), math.ceil(pitch * part)
    for centre in centres[amid]:
        first = np.maximum(np.rint(centre).astype(int) - reach, 0)
        end = np.minimum(first + 2 * reach + 1, (rows, columns))
        y, x = np.mgrid[first[0] : end[0], first[1] : end[1]]
        found[y, x] |= np.hypot(y - centre[0], x - centre[1]) <= part * pitch
    return found
