"""Condition numbers of a camera's rays at each element of its lens."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.camera_rays import CameraRays
from plenoptic.camera.camera_record import CameraRecord
from plenoptic.camera.sampling.aperture_regions import illuminated_pixels, pixel_centres
from plenoptic.camera.sampling.sampling_records import batch_record
from plenoptic.optics.lens.analysis.conditioning import Conditioning, conditioning_of, probe_rays

_PER_PIXEL = 4
"""Paths of a pixel if there are enough pixels: more pixels are more representative than more paths of each."""


def camera_conditioning(
    camera: CameraRecord, area: tuple[int, int, int, int], *, seed: int = 0, rays: int = 1024
) -> Conditioning:
    """Conditioning (see `conditioning`) of about `rays` camera rays as they are rendered, from sensor to scene.

    Pixels are drawn from the area (first and end row, first and end column), one from each of many equal rectangles.
    Their paths are the first ones of the first replicate of `render` with that seed, at their own wavelengths if the
    camera has a sensitivity. Paths that end at the array are counted without an element.
    """
    number = _stratified_pixels(camera, area, max(rays // _PER_PIXEL, 1), seed)
    places = zip(*(at.tolist() for at in np.divmod(number, camera.sensor.columns)), strict=True)
    pixels = np.concatenate([pixel_centres(camera, (row, row + 1), (column, column + 1)) for row, column in places])
    illuminated = illuminated_pixels(camera._replace(deflection=None), pixels, number)
    samples = max(rays // max(illuminated.place.size, 1), 1)
    n = illuminated.place.size * samples
    camera_rays = CameraRays(camera, illuminated, batch_record(np.uint64(seed), 0, samples, 1, 0, 0), n)
    blocks = camera_rays.sample(0, n)
    camera_rays.fill_through_array(blocks)
    return conditioning_of(probe_rays(camera_rays.lens, blocks, n, camera_rays.waves))


def _stratified_pixels(
    camera: CameraRecord, area: tuple[int, int, int, int], most: int, seed: int
) -> NDArray[np.int64]:
    """Numbers on the sensor of pixels, one from each of at most `most` equal rectangles (stratified sampling)."""
    height, width = area[1] - area[0], area[3] - area[2]
    down = min(max(round(math.sqrt(most * height / width)), 1), height, most)
    across = min(max(most // down, 1), width)
    u = np.random.default_rng(seed).random((2, down, across))
    row = area[0] + ((np.arange(down)[:, None] + u[0]) * height / down).astype(np.int64)
    column = area[2] + ((np.arange(across) + u[1]) * width / across).astype(np.int64)
    return np.unique(np.minimum(row, area[1] - 1) * camera.sensor.columns + np.minimum(column, area[3] - 1))
