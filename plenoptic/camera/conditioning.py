"""Conditioning of a camera's paths at each element of its lens."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.paths import CameraPaths
from plenoptic.camera.record import CameraRecord
from plenoptic.camera.sampling.pixel_regions import fed_pixels, pixel_centres
from plenoptic.camera.sampling.record import batch_record
from plenoptic.optics.lens.analysis.conditioning import Conditioning, conditioning_of
from plenoptic.optics.lens.analysis.conditioning_rows import noted

_PER_PIXEL = 4
"""Paths of a pixel where there are pixels enough: more of these say more than more paths of each."""


def camera_conditioning(
    camera: CameraRecord, area: tuple[int, int, int, int], *, seed: int = 0, rays: int = 1024
) -> Conditioning:
    """Return the `conditioning` of about `rays` paths as they are rendered: from the sensor through array and lens.

    Pixels are drawn all over the area (first and end row, first and end column), one from each of many equal
    rectangles. Their paths are the first ones of the first replicate of `render` with that seed, with their own
    wavelengths where the sensor sees colours. Paths that end at the array are counted without an element.
    """
    number = _spread(camera, area, max(rays // _PER_PIXEL, 1), seed)
    places = zip(*(at.tolist() for at in np.divmod(number, camera.sensor.columns)), strict=True)
    pixels = np.concatenate([pixel_centres(camera, (row, row + 1), (column, column + 1)) for row, column in places])
    fed = fed_pixels(camera._replace(bend=None), pixels, number)
    samples = max(rays // max(fed.place.size, 1), 1)
    n = fed.place.size * samples
    camera_paths = CameraPaths(camera, fed, batch_record(np.uint64(seed), 0, samples, 1, 0, 0), n)
    blocks = camera_paths.started(0, n)
    camera_paths.fill_through_array(blocks)
    return conditioning_of(noted(camera_paths.lens, blocks, n, camera_paths.waves))


def _spread(camera: CameraRecord, area: tuple[int, int, int, int], most: int, seed: int) -> NDArray[np.int64]:
    """Numbers on the sensor of pixels, at most one from each of about `most` equal rectangles."""
    height, width = area[1] - area[0], area[3] - area[2]
    down = min(max(round(math.sqrt(most * height / width)), 1), height, most)
    across = min(max(most // down, 1), width)
    u = np.random.default_rng(seed).random((2, down, across))
    row = area[0] + ((np.arange(down)[:, None] + u[0]) * height / down).astype(np.int64)
    column = area[2] + ((np.arange(across) + u[1]) * width / across).astype(np.int64)
    return np.unique(np.minimum(row, area[1] - 1) * camera.sensor.columns + np.minimum(column, area[3] - 1))
