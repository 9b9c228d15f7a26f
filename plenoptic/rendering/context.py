"""A scene before a camera, compiled: what tiles, and paths that are traced again, begin with."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.record import CameraRecord, camera_record
from plenoptic.rendering.plan.plan import plan_stages
from plenoptic.rendering.plan.stages import Plan
from plenoptic.rendering.settings import RenderSettings
from plenoptic.truth.channels import Truth

if TYPE_CHECKING:
    from plenoptic.scene.compile import SceneRecord
    from plenoptic.scene.geometry.accel import Intersector
    from plenoptic.scene.scene import Scene


class Sampling(NamedTuple):
    """How paths are sampled, and what they may do."""

    replicates: int
    seed: np.uint64
    plan: Plan
    settings: RenderSettings


class RenderContext(NamedTuple):
    """Camera and scene as records."""

    camera: CameraRecord
    scene: SceneRecord | None
    """None: a white image."""
    intersector: Intersector | None
    """None where there are no triangles to meet."""
    sampling: Sampling

    @property
    def channels(self) -> int:
        """Channels of the image: the sensor's, or those of the scene where the camera sees one wavelength."""
        if self.camera.colour is not None:
            return int(self.camera.colour.weights.shape[1])
        return 1 if self.scene is None else self.scene.channels


def render_context(
    scene: Scene | None,
    camera: PlenopticCamera,
    settings: RenderSettings,
    *,
    samples: int,
    replicates: int,
    seed: int,
    truth: Truth,
) -> RenderContext:
    """Plan a render and compile what it needs."""
    record = intersector = None
    if scene is not None:
        from plenoptic.scene.cache import prepared_scene

        prepared = prepared_scene(scene)
        record, intersector = prepared.record, prepared.intersector
    plan = plan_stages(record, camera, settings, samples=samples, replicates=replicates, truth=truth)
    return RenderContext(
        camera_record(camera), record, intersector, Sampling(replicates, np.uint64(seed), plan, settings)
    )
