"""A compiled scene and camera: input of tiles and of replayed paths."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from plenoptic.camera.cache import PreparedCamera, prepared_camera
from plenoptic.camera.camera_record import CameraRecord
from plenoptic.camera.sampling.diffraction_kernel import batch_step
from plenoptic.camera.sampling.sampling_records import Batch, batch_record
from plenoptic.rendering.plan.plan import plan_stages
from plenoptic.rendering.plan.shutter import OpenShutter, open_shutter
from plenoptic.rendering.plan.stages import Plan, Stage, Subject
from plenoptic.rendering.settings import RenderSettings, Sampler

if TYPE_CHECKING:
    from plenoptic.scene.geometry.accel import Intersector
    from plenoptic.scene.scene_record import SceneRecord


class RenderContext(NamedTuple):
    """Camera and scene as records, the sampling of paths, and the render settings."""

    prepared: PreparedCamera
    scene: SceneRecord | None
    """None for a white image."""
    intersector: Intersector | None
    """None without triangles."""
    plan: Plan
    settings: RenderSettings
    replicates: int
    seed: np.uint64
    shutter: OpenShutter | None
    """None if nothing moves during the exposure."""

    @property
    def camera(self) -> CameraRecord:
        """The camera as a record."""
        return self.prepared.record

    @property
    def together(self) -> int:
        """Number of samples at whose multiples batches must end, so that the bits do not depend on the batches."""
        return self.replicates if self.camera.diffraction_kernel is None else batch_step(self.replicates)

    @property
    def channels(self) -> int:
        """Channels of the image: the sensor's, or the scene's if the camera has one wavelength."""
        if self.camera.colour is not None:
            return int(self.camera.colour.weights.shape[1])
        return 1 if self.scene is None else self.scene.channels


def render_context(subject: Subject, seed: int) -> RenderContext:
    """Plan a render and compile its scene and camera."""
    prepared = subject.prepared
    record, intersector = (None, None) if prepared is None else (prepared.record, prepared.intersector)
    camera, plan = prepared_camera(subject.camera), plan_stages(record, subject)
    if subject.ghosts is not None:
        from plenoptic.camera.ghosts.ghost_camera import ghost_camera  # few images have ghosts

        camera = ghost_camera(camera, subject.ghosts, subject.camera)
    shutter = open_shutter(subject.camera, record) if plan.runs(Stage.SHUTTER) else None
    settings, replicates = subject.settings, subject.replicates
    return RenderContext(camera, record, intersector, plan, settings, replicates, np.uint64(seed), shutter)


def batch_of(context: RenderContext, first: int, samples: int) -> Batch:
    """Batch of samples first ... first + samples - 1: a single sample, or `first` is a multiple of the replicates."""
    if context.settings.sampler is Sampler.RANDOM:
        return batch_record(context.seed, first, samples, samples, first, 0)
    index, stream = divmod(first, context.replicates)
    return batch_record(context.seed, first, samples, min(context.replicates, samples), stream, index)
