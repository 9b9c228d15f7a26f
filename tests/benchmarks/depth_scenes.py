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


VIEW_CAMERAS = {
    "tessar": ("tessar-102mm-f4.5", 5.0, 0.077, 0.0055, -530.0),
    "double Gauss f/1.4": ("double-gauss-105mm-f1.4", 12.0, 0.1, 0.0055, -600.0),
    "biotar": ("biotar-100mm-f1.4", 10.0, 0.1, 0.0055, -700.0),
    "double Gauss f/2": ("double-gauss-100mm-f2", 6.0, 0.1, 0.0055, -500.0),
    "triplet": ("cooke-triplet-50mm-f5", 4.5, 0.08, 0.005, -400.0),
    "Petzval": ("petzval-51mm-f1.4", 8.0, 0.08, 0.005, -500.0),
    "retrofocus": ("retrofocus-100mm-f1.9", 8.0, 0.1, 0.0055, -600.0),
    "telephoto": ("telephoto-100mm-f2.8", 8.0, 0.1, 0.0055, -1500.0),
}
"""Plenoptic 1.0 cameras: lens, semi-diameter of the iris, pitch, pixel and plane in focus, mm."""


def view_camera(name, side=500):
    """A plenoptic 1.0 camera of the table, with side x side pixels."""
    lens, iris, pitch, pixel, z = VIEW_CAMERAS[name]
    kind, sensor = pl.CameraKind.PLENOPTIC_1, pl.Sensor((side, side), pixel)
    design = pl.design_camera(
        pl.load_lens(lens), sensor=sensor, kind=kind, z=z, pitch=pitch, semi_diameter=iris, lattice=pl.Lattice.SQUARE
    )
    return design.camera


def small_camera():
    """A double Gauss scaled to 30 mm f/2, with microlenses of 20 um before pixels of 1.4 um, focused at -290 mm."""
    lens = pl.load_lens("double-gauss-100mm-f2")
    scale = 30.0 / pl.paraxial.cardinal_points(lens).efl
    lengths = ("radius", "thickness", "semi_diameter")
    elements = [
        dataclasses.replace(e, **{name: scale * getattr(e, name) for name in lengths if hasattr(e, name)})
        for e in lens.elements
    ]
    lens = dataclasses.replace(lens, elements=elements, specification=None)
    kind, sensor = pl.CameraKind.PLENOPTIC_1, pl.Sensor((600, 600), 0.0014)
    return pl.design_camera(lens, sensor=sensor, kind=kind, z=-290.0, pitch=0.02, lattice=pl.Lattice.SQUARE).camera


def resolved_card(camera, z, seed):
    """Noise that glows, of waves of five microlenses and more, on a plane larger than the field."""
    field = 1.6 * camera.sensor.size[0]
    side = abs(field / pl.paraxial.magnification(camera.lens, z))
    picture = reference.noise(seed, _TEXELS, shortest=5 * min(camera.microlenses.pitches) / field, power=0.5)
    return reference.glowing(picture, (-side / 2, -side / 2, z), (side, 0, 0), (0, side, 0))


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
