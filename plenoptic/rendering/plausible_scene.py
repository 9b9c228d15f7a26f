"""Warning of scenes of another scale than their camera, of glass that is inside out, and of sheets that miss all."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.gaussian import object_plane
from plenoptic.core.warn import warn
from plenoptic.errors import ImplausibleSceneWarning
from plenoptic.optics.lens.models import LensModel
from plenoptic.scene.geometry.instance import Instances
from plenoptic.scene.lights.sheet import Sheet
from plenoptic.scene.materials.dielectric import Dielectric
from plenoptic.scene.scene import Scene

_LARGEST = 20.0
"""Largest size of the smallest mesh over the distance of the plane in focus."""


def warn_if_scene_implausible(scene: Scene, camera: PlenopticCamera) -> None:
    """Issue one warning that names everything that is hardly meant; none for other scenes."""
    if values := "; ".join([*_scale(scene, camera), *_glass(scene, camera), *_sheets(scene)]):
        warn(f"this scene is hardly what was meant: {values}", ImplausibleSceneWarning)


def _scale(scene: Scene, camera: PlenopticCamera) -> Iterator[str]:
    z = object_plane(camera.lens, camera.stop_to_microlenses, camera.wavelength)
    smallest = min((float(np.ptp(part.bounds, axis=0).max()) for part in scene.meshes), default=0.0)
    if camera.lens.model is not LensModel.NONE and smallest > _LARGEST * abs(z):
        yield (
            f"its smallest mesh is {smallest:.3g} mm large, and the camera focuses {abs(z):.3g} mm away; if it is of a "
            'file, give the unit of its numbers: pl.Scene.load(path, unit="mm")'
        )


def _glass(scene: Scene, camera: PlenopticCamera) -> Iterator[str]:
    meshes = [part.mesh if isinstance(part, Instances) else part for part in scene.meshes]
    glass = [k for k, mesh in enumerate(meshes) if isinstance(mesh.material, Dielectric)]
    if any(scene.medium is not None or meshes[k].material.row().fills for k in glass):
        from plenoptic.scene.body_nesting import wrong_bodies

        shutter, rows = camera.shutter, camera.sensor.shape[0]
        half = 0.0 if shutter is None else 0.5 * (shutter.duration + abs(shutter.row_time) * (rows - 1))
        yield from wrong_bodies(scene, (-half, half) if half else (0.0,))
    for k in glass:
        if not meshes[k].is_inside_out:
            continue
        low, high = scene.meshes[k].bounds
        enclosing = (scene.meshes[j].bounds for j in glass if j != k)  # a bubble in glass is none of its own
        if not any((outer[0] <= low).all() and (high <= outer[1]).all() for outer in enclosing):
            yield f"the faces of the glass {scene.object_names[k]} wind inwards; turn them: faces[:, ::-1]"


def _sheets(scene: Scene) -> Iterator[str]:
    scatters = scene.medium is not None and np.any(scene.medium.scattering)
    boxes = [part.bounds for part in (*scene.meshes, *(() if scene.points is None else (scene.points,)))]
    for number, light in enumerate(scene.lights):
        if isinstance(light, Sheet) and not scatters and not any(light.reaches(box) for box in boxes):
            yield f"the light of Sheet {number} passes all meshes and particles; move it, or turn its normal"
