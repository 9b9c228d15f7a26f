"""Ground truth along arbitrary rays through the array, such as those of a sub-aperture view."""

from __future__ import annotations

import numpy as np

from plenoptic.camera.assembly import array_axes
from plenoptic.camera.cache import prepared_camera
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.camera_record import CameraRecord
from plenoptic.camera.checks import check_scene_and_camera
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.scene.scene import Scene
from plenoptic.truth.channels import GroundTruth, Truth
from plenoptic.truth.ground_truth import compute_truth, truth_record
from plenoptic.truth.representative_rays import RepresentativeRays
from plenoptic.truth.truth_arrays import available_truth, valid_truth

_PIXEL_CHANNELS = Truth.MICROLENS | Truth.OBJECT_SHARE | Truth.CHORD_DISPARITY
"""Channels that are defined for pixels only."""


def truth_along(
    scene: Scene, camera: PlenopticCamera, on_sensor: Floats, on_array: Floats, *, truth: Truth
) -> GroundTruth:
    """Compute the ground truth along rays from the sensor that pass the array undeviated.

    Points are (rows, columns, 2): x and y on the sensor and on the array, each in its own axes, mm; nan for no ray.
    """
    from plenoptic.scene.cache import prepared_scene

    check_scene_and_camera(scene, camera)
    prepared, record = prepared_scene(scene), prepared_camera(camera).record
    meshes = prepared.record.geometry is not None
    requested = available_truth(valid_truth(truth), meshes=meshes, microlenses=True) & ~_PIXEL_CHANNELS
    truth_parameters = truth_record(camera, record, requested)
    if truth_parameters is None:
        raise InvalidValueError(
            f"nothing of {truth!r} can be found along rays of a view: they have no microlens, and the scene has "
            f"{'' if meshes else 'no '}meshes"
        )
    shape = on_sensor.shape[:2]
    rays = _straight_rays(camera, record, on_sensor.reshape(-1, 2), on_array.reshape(-1, 2))
    intersector = prepared.intersector if meshes else None
    arrays = compute_truth(record, prepared.record, intersector, truth_parameters, rays.starts, rays)
    return GroundTruth(**{name: array.reshape(*shape, *array.shape[1:]) for name, array in arrays.items()})


def _straight_rays(
    camera: PlenopticCamera, record: CameraRecord, on_sensor: Floats, on_array: Floats
) -> RepresentativeRays:
    """Trace undeviated rays from sensor points through array points, as representative rays."""
    from plenoptic.core.kernels.ray_blocks import BLOCK
    from plenoptic.optics.lens.kernels.trace import fill_traced

    axes, n = array_axes(camera), len(on_sensor)
    is_valid = np.isfinite(on_sensor).all(axis=1) & np.isfinite(on_array).all(axis=1)
    starts = axes.parts.sensor_to_local.points(np.column_stack([on_sensor, np.zeros(n)]))
    aims = axes.local(on_array)
    directions = np.column_stack([aims - starts[:, :2], -starts[:, 2]])
    fields = np.zeros((-(-n // BLOCK) * BLOCK, 8))
    fields[:n, :3] = axes.in_lens(aims)
    turned = axes.parts.local_to_lens.directions(directions)
    fields[:n, 3:6] = turned / np.linalg.norm(turned, axis=1, keepdims=True)
    fields[:n, 6] = 1.0
    fields[:n][~is_valid] = fields[n:] = 0.0
    fields[:, 7] = 1.0
    fields[:n, 7] = ~is_valid
    before = np.ascontiguousarray(fields.reshape(-1, BLOCK, 8).swapaxes(1, 2)).reshape(-1)
    blocks = before.copy()
    fill_traced(blocks, record.lens, None)
    cells = np.full((n, 3), np.nan)
    return RepresentativeRays(np.ascontiguousarray(starts[:, :2]), before, blocks, aims, cells, np.zeros(n, dtype=bool))
