"""Fraction of a pixel's light that comes from the object hit by its representative ray."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.camera_rays import CameraRays
from plenoptic.camera.camera_record import CameraRecord
from plenoptic.camera.sampling.aperture_regions import illuminated_pixels
from plenoptic.camera.sampling.sampling_records import batch_record
from plenoptic.core.values import Floats

if TYPE_CHECKING:
    from plenoptic.scene.geometry.accel import Intersector
    from plenoptic.scene.geometry.geometry_records import Hits
    from plenoptic.scene.scene_record import SceneRecord

_SAMPLES, _MANY_SAMPLES = 64, 4096
"""Paths of a pixel; and of pixels of which fewer than _MIN_ARRIVED paths arrive, as behind a small stop."""
_MIN_ARRIVED = 16
_CHUNK = 1 << 13
"""Paths that are traced together."""


def object_shares(
    camera: CameraRecord, scene: SceneRecord, intersector: Intersector, pixels: Floats, objects: NDArray[np.integer]
) -> Floats:
    """Fractions (n,) of the light of pixels (n, 2) that come from objects (n,) in a scene of uniform radiance.

    Estimated with the same sampling points for every pixel. nan if none of their paths arrives.
    """
    object_light, light, arrived = _sums(camera, scene, intersector, pixels, objects, _SAMPLES)
    sparse = np.flatnonzero(arrived < _MIN_ARRIVED)
    if sparse.size:
        object_light[sparse], light[sparse], _ = _sums(
            camera, scene, intersector, pixels[sparse], objects[sparse], _MANY_SAMPLES
        )
    with np.errstate(invalid="ignore"):
        return object_light / light


def _sums(
    camera: CameraRecord,
    scene: SceneRecord,
    intersector: Intersector,
    pixels: Floats,
    objects: NDArray[np.integer],
    samples: int,
) -> tuple[Floats, Floats, Floats]:
    """Sums of the weights of paths that hit the objects, and of all that arrive; number of paths that arrive."""
    from plenoptic.core.kernels.bundles import fill_world_rays
    from plenoptic.core.kernels.ray_blocks import BLOCK, WEIGHT
    from plenoptic.scene.materials.alpha_mask import no_hits

    camera = camera._replace(colour=None, dispersed=None)
    # One stream of random numbers for all pixels, so that a pixel's result does not depend on others.
    illuminated = illuminated_pixels(camera, np.ascontiguousarray(pixels), np.zeros(len(pixels), dtype=np.int64))
    camera_rays = CameraRays(camera, illuminated, batch_record(np.uint64(0), 0, samples, 1, 0, 0), _CHUNK)
    sums = np.zeros((3, len(pixels)))
    rays, ray_indices = np.empty((_CHUNK, 6)), np.empty(_CHUNK, dtype=np.int64)
    for start in range(0, len(illuminated.place) * samples, _CHUNK):
        n = min(_CHUNK, len(illuminated.place) * samples - start)
        bundle = camera_rays.sample(start, n)
        camera_rays.fill_through_array(bundle)
        camera_rays.fill_through_lens(bundle)
        camera_rays.fill_iris_deflections(bundle, start, n)
        n_hits = fill_world_rays(rays, ray_indices, bundle, n, camera.rotation, camera.position)
        hits = no_hits(scene, n_hits)
        intersector.fill_closest(hits, rays[:n_hits])
        pixel = illuminated.place[(start + ray_indices[:n_hits]) // samples]
        fractions = _object_fractions(scene, intersector, rays[:n_hits], hits, objects[pixel])
        weight = bundle.reshape(-1, 8, BLOCK)[:, WEIGHT // BLOCK].reshape(-1)[ray_indices[:n_hits]]
        for total, terms in zip(sums, (weight * fractions, weight, np.ones(n_hits)), strict=True):
            total += np.bincount(pixel, weights=terms, minlength=len(pixels))
    return sums[0], sums[1], sums[2]


def _object_fractions(
    scene: SceneRecord, intersector: Intersector, rays: Floats, hits: Hits, objects: NDArray[np.integer]
) -> Floats:
    """Fractions (n,) of the light of rays (n, 6) that come from objects (n,), each through the layers before it."""
    from plenoptic.scene.materials.alpha_mask import follow_layers

    assert scene.triangle_mesh is not None
    if scene.alpha is None:
        return np.asarray(((hits.triangle >= 0) & (scene.triangle_mesh[hits.triangle] == objects)).astype(np.float64))
    fractions = np.zeros(len(rays))
    for which, triangle, fraction in follow_layers(scene, intersector, rays, hits):
        fractions[which] += fraction * (scene.triangle_mesh[triangle] == objects[which])
    return fractions
