"""Cameras without one of their parts or properties, each for one stage of a render."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.elements import Element
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.modify import coated
from plenoptic.optics.lens.placement import Placement
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.microlens.dust import BlemishSite
from plenoptic.optics.microlens.lattice import Lattice
from plenoptic.optics.microlens.models import MicrolensModel
from plenoptic.optics.stops.stop_registry import circle_around
from plenoptic.optics.surfaces.surface import Surface


def _with_array(camera: PlenopticCamera, **changes: Any) -> PlenopticCamera:
    assert camera.microlenses is not None
    return dataclasses.replace(camera, microlenses=dataclasses.replace(camera.microlenses, **changes))


def without_microlenses(camera: PlenopticCamera) -> PlenopticCamera:
    """The bare sensor in its place, in the main lens's light."""
    return dataclasses.replace(
        camera,
        microlenses=None,
        microlenses_placement=None,
        microlenses_to_sensor=0.0,
        stop_to_microlenses=camera.z_sensor,
        diffraction=camera.diffraction if camera.diffraction is not None and camera.diffraction.iris else None,
        blemishes=tuple(part for part in camera.blemishes if part.site is not BlemishSite.ARRAY),
    )


def with_one_type(camera: PlenopticCamera) -> PlenopticCamera:
    """All microlenses with the focal length of the central one."""
    assert camera.microlenses is not None
    return _with_array(camera, focal_lengths=(camera.microlenses.focal_length,), pattern=None, types=None)


def with_thin_microlenses(camera: PlenopticCamera) -> PlenopticCamera:
    """Ideal thin microlenses of the same focal lengths."""
    return _with_array(camera, model=MicrolensModel.THIN, coating=None)


def without_imperfections(camera: PlenopticCamera) -> PlenopticCamera:
    """Lenses on their lattice, all alike; centres that are listed must stay."""
    assert camera.microlenses is not None
    if camera.microlenses.lattice is Lattice.FREE:
        raise InvalidValueError("the centres of the microlenses are listed; without the list there is no array")
    return _with_array(camera, imperfections=None)


def _with_rotation(placement: Placement | None, other: Placement | None) -> Placement:
    """A placement with the rotation of another one, None being no rotation."""
    shift = np.zeros(3) if placement is None else np.asarray(placement.shift)
    return Placement(shift=shift, rotation=np.eye(3) if other is None else np.asarray(other.rotation))


def with_parallel_sensor(camera: PlenopticCamera) -> PlenopticCamera:
    """The sensor turned as the array is, or as the lens is if there is no array."""
    ahead = camera.lens_placement if camera.microlenses is None else camera.microlenses_placement
    return dataclasses.replace(camera, sensor_placement=_with_rotation(camera.sensor_placement, ahead))


def with_upright_array(camera: PlenopticCamera) -> PlenopticCamera:
    """The array turned as the lens is."""
    placement = _with_rotation(camera.microlenses_placement, camera.lens_placement)
    return dataclasses.replace(camera, microlenses_placement=placement)


def with_upright_pixels(camera: PlenopticCamera) -> PlenopticCamera:
    """All parts without rotation; shifts stay."""
    array = None if camera.microlenses is None else _with_rotation(camera.microlenses_placement, None)
    lens, sensor = (_with_rotation(part, None) for part in (camera.lens_placement, camera.sensor_placement))
    return dataclasses.replace(camera, lens_placement=lens, microlenses_placement=array, sensor_placement=sensor)


def with_thin_lens(camera: PlenopticCamera) -> PlenopticCamera:
    """A thin lens of the same focal length."""
    if camera.lens.model in (LensModel.THIN, LensModel.NONE):
        raise InvalidValueError("rays must pass at least the stops or one ideal plane")
    return dataclasses.replace(camera, lens=camera.lens.with_model(LensModel.THIN))


def _with_elements(camera: PlenopticCamera, elements: list[Element]) -> PlenopticCamera:
    lens: LensStack = dataclasses.replace(camera.lens, elements=elements)
    return dataclasses.replace(camera, lens=lens)


def without_aspheres(camera: PlenopticCamera) -> PlenopticCamera:
    """Conics and aspheres replaced by the osculating spheres of their vertices."""
    return _with_elements(camera, [e.osculating if isinstance(e, Surface) else e for e in camera.lens.elements])


def without_placements(camera: PlenopticCamera) -> PlenopticCamera:
    """All elements of the lens centred."""
    return _with_elements(camera, [dataclasses.replace(e, placement=None) for e in camera.lens.elements])


def without_coatings(camera: PlenopticCamera) -> PlenopticCamera:
    """Lens and microlenses without coatings and, thereby, without losses."""
    camera = camera if camera.microlenses is None else _with_array(camera, coating=None)
    return dataclasses.replace(camera, lens=coated(camera.lens, None))


def with_round_stops(camera: PlenopticCamera) -> PlenopticCamera:
    """Circles through the corners of the stops."""
    elements: list[Element] = [e if isinstance(e, Surface) else circle_around(e) for e in camera.lens.elements]
    return _with_elements(camera, elements)
