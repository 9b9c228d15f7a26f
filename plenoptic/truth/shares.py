"""Shares of a pixel's light that come from the object which its representative ray hits."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.paths import CameraPaths
from plenoptic.camera.record import CameraRecord
from plenoptic.camera.sampling.pixel_regions import fed_pixels
from plenoptic.camera.sampling.record import batch_record
from plenoptic.core.values import Floats

if TYPE_CHECKING:
    from plenoptic.scene.compile import SceneRecord
    from plenoptic.scene.geometry.accel import Intersector

_SAMPLES, _MORE_SAMPLES = 64, 4096
"""Paths of a pixel, and of those of which fewer than _ENOUGH arrive: behind a small stop."""
_ENOUGH = 16
_TOGETHER = 1 << 13
"""Paths at a time."""


def object_shares(
    camera: CameraRecord, scene: SceneRecord, intersector: Intersector, pixels: Floats, objects: NDArray[np.integer]
) -> Floats:
    """(n,): share of objects (n,) in the light that reaches pixels (n, 2) in a scene of even brightness.

    Found by the same points for every pixel. nan where none of them arrives.
    """
    object_light, light, arrived = _sums(camera, scene, intersector, pixels, objects, _SAMPLES)
    few = np.flatnonzero(arrived < _ENOUGH)
    if few.size:
        object_light[few], light[few], _ = _sums(camera, scene, intersector, pixels[few], objects[few], _MORE_SAMPLES)
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
    """Weights of the paths that meet the objects, and of all that arrive; how many arrive."""
    from plenoptic.core.kernels.bundles import fill_world_rays
    from plenoptic.core.kernels.ray_blocks import BLOCK, WEIGHT
    from plenoptic.scene.materials.alpha_mask import no_hits, skip_transparent

    camera = camera._replace(colour=None, dispersed=None)
    # One stream of random numbers for all pixels, so that those beside a pixel do not matter.
    fed = fed_pixels(camera, np.ascontiguousarray(pixels), np.zeros(len(pixels), dtype=np.int64))
    paths = CameraPaths(camera, fed, batch_record(np.uint64(0), 0, samples, 1, 0, 0), _TOGETHER)
    sums = np.zeros((3, len(pixels)))
    rays, lanes = np.empty((_TOGETHER, 6)), np.empty(_TOGETHER, dtype=np.int64)
    for start in range(0, len(fed.place) * samples, _TOGETHER):
        n = min(_TOGETHER, len(fed.place) * samples - start)
        bundle = paths.started(start, n)
        paths.fill_through_array(bundle)
        paths.fill_through_lens(bundle)
        paths.fill_bent_at_iris(bundle, start, n)
        sent = fill_world_rays(rays, lanes, bundle, n, camera.rotation, camera.position)
        hits = no_hits(scene, sent)
        intersector.fill_closest(hits, rays[:sent])
        if scene.alpha is not None:
            skip_transparent(scene, intersector, rays[:sent], hits)
        pixel = fed.place[(start + lanes[:sent]) // samples]
        assert scene.triangle_mesh is not None
        mine = (hits.triangle >= 0) & (scene.triangle_mesh[hits.triangle] == objects[pixel])
        weight = bundle.reshape(-1, 8, BLOCK)[:, WEIGHT // BLOCK].reshape(-1)[lanes[:sent]]
        for total, part in zip(sums, (weight * mine, weight, np.ones(sent)), strict=True):
            total += np.bincount(pixel, weights=part, minlength=len(pixels))
    return sums[0], sums[1], sums[2]
