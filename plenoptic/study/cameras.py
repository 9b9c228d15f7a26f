"""Cameras of the bundled cases: the reference camera, a smooth one, and one with every part that there is."""

from __future__ import annotations

import dataclasses
import math

from plenoptic.camera.camera import CameraPart, PlenopticCamera
from plenoptic.camera.design.example import example_camera
from plenoptic.core.color.sensitivities import colour_camera
from plenoptic.optics.lens.files.library import load_lens
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.microlens.aperture import ApertureShape, MicrolensAperture, Walls
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.dust import Blemishes, BlemishSite
from plenoptic.optics.microlens.imperfections import MicrolensImperfections
from plenoptic.optics.microlens.lattice import Lattice
from plenoptic.optics.microlens.models import MicrolensModel
from plenoptic.optics.sensor.angular_response import AngularResponse
from plenoptic.optics.sensor.sensor import Sensor
from plenoptic.optics.stops.polygon import PolygonStop
from plenoptic.optics.surfaces.surface import Surface

_SIDE = 128
"""Pixels: the time for the bounds on the pupils of tilted parts grows with the sensor."""


def smooth_camera() -> PlenopticCamera:
    """The reference camera wide open, 20 x 20 pixels behind one square microlens between walls: nothing clips light."""
    array = MicrolensArray(pitch=0.217, focal_lengths=(2.0,), lattice=Lattice.SQUARE, walls=Walls.OPAQUE)
    sensor = Sensor(shape=(20, 20), pixel_pitch=0.010)
    wide_open = load_lens("double-gauss-100mm-f2")
    return dataclasses.replace(example_camera(), lens=wide_open, microlenses=array, sensor=sensor)


def furnished_camera() -> PlenopticCamera:
    """The reference camera with every part that a camera can have, 128 x 128 pixels, posed."""
    plain = example_camera()
    assert plain.microlenses is not None
    array = dataclasses.replace(
        plain.microlenses,
        focal_lengths=(1.9, 2.0, 2.1),
        model=MicrolensModel.SPHERICAL,
        aperture=MicrolensAperture(ApertureShape.CIRCLE, 0.85),
        imperfections=MicrolensImperfections(pitch_jitter=0.001),
        walls=Walls.OPAQUE,
    )
    sensor = Sensor(
        (_SIDE, _SIDE),
        pixel_pitch=plain.sensor.pixel_pitch,
        angular_response=AngularResponse(well_depth=0.5, pupil_distance=130.0),
    )
    half_size = (0.5 * sensor.size[0], 0.5 * sensor.size[1])
    camera = dataclasses.replace(
        plain,
        lens=_lens_with_defects(plain.lens),
        microlenses=array,
        sensor=sensor,
        sensitivity=colour_camera(),
        blemishes=(Blemishes.scattered(BlemishSite.SENSOR, half_size=half_size, dust_per_mm2=4.0),),
    )
    tilt = math.radians(0.2)
    camera = camera.moved(CameraPart.SENSOR, tilt=(tilt, 0.0, tilt)).moved(
        CameraPart.MICROLENSES, tilt=(0.0, tilt, 0.0)
    )
    camera = camera.moved(CameraPart.LENS, shift=(0.05, 0.0, 0.0))
    return camera.posed(position=(30.0, 20.0, 10.0), look_at=(-200.0, 0.0, -400.0))


def _lens_with_defects(lens: LensStack) -> LensStack:
    """The lens with a slight asphere, a decentred element and an iris of blades."""
    first, *following = lens.elements
    assert isinstance(first, Surface)
    aspheric = dataclasses.replace(lens, elements=[dataclasses.replace(first, aspheric=(0.0, 1e-9)), *following])
    return aspheric.with_stop(PolygonStop(blades=6, semi_diameter=5.0)).moved(3, shift=(0.02, 0.0, 0.0))
