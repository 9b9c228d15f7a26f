"""How well conditioned the paths of a camera are at each element of its lens."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.paths import CameraPaths
from plenoptic.camera.record import CameraRecord
from plenoptic.camera.sampling.pixel_regions import fed_pixels, pixel_centres
from plenoptic.camera.sampling.record import batch_record
from plenoptic.core.values import Floats, whole
from plenoptic.optics.lens.analysis.conditioning import Conditioning, conditioning_of
from plenoptic.optics.lens.analysis.conditioning_rows import noted

_PER_PIXEL = 4
"""Paths of a pixel where there are pixels enough: more of these say more than more paths of each."""


def camera_conditioning(
    record: CameraRecord, region: tuple[int, int, int, int] | None = None, *, seed: int = 0, rays: int = 1024
) -> Conditioning:
    """What `conditioning` says of paths as they are rendered: from the sensor through the array and the lens.

    Pixels are drawn all over the region, one from each of many equal rectangles. Their paths are the first ones of the
    first replicate of `render` with that seed, with their own wavelengths where the sensor sees colours. Paths that end
    at the array are counted without an element.

    Parameters
    ----------
    record : CameraRecord
        From `camera_record`.
    region : (int, int, int, int), optional
        First and end row, first and end column; the whole sensor if it is left out.
    seed : int, optional
        From 0 to 2^64 - 1.
    rays : int, optional
        Paths, about.

    Returns
    -------
    Conditioning
        Of no rays where light reaches none of the pixels.

    Examples
    --------
    >>> import plenoptic as pl
    >>> from plenoptic.camera.conditioning import camera_conditioning
    >>> from plenoptic.camera.record import camera_record
    >>> camera = pl.PlenopticCamera(lens=pl.load_lens("double-gauss-100mm-f2"),
    ...     microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)),
    ...     sensor=pl.Sensor(shape=(512, 512), pixel_pitch=0.01),
    ...     stop_to_microlenses=123.3, microlenses_to_sensor=1.7)
    >>> found = camera_conditioning(camera_record(camera))
    >>> found.elements.tolist()
    [10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0]
    >>> bool(found.incidence[found.reached > 0].max() < 2)
    True
    """
    wanted, seed = whole(rays, "rays", at_least=1), whole(seed, "seed", at_least=0)
    area = (0, record.sensor.rows, 0, record.sensor.columns) if region is None else region
    number = _spread(record, area, max(wanted // _PER_PIXEL, 1), seed)
    blocks, waves, n = _paths(record, number, wanted, np.uint64(seed))
    lens = record.lens if waves is None or record.dispersed is None else record.dispersed
    return conditioning_of(noted(lens, blocks, n, waves))


def _spread(record: CameraRecord, area: tuple[int, int, int, int], most: int, seed: int) -> NDArray[np.int64]:
    """Numbers on the sensor of pixels, at most one from each of about `most` equal rectangles."""
    height, width = area[1] - area[0], area[3] - area[2]
    down = min(max(round(math.sqrt(most * height / width)), 1), height, most)
    across = min(max(most // down, 1), width)
    u = np.random.default_rng(seed).random((2, down, across))
    row = area[0] + ((np.arange(down)[:, None] + u[0]) * height / down).astype(np.int64)
    column = area[2] + ((np.arange(across) + u[1]) * width / across).astype(np.int64)
    number = np.minimum(row, area[1] - 1) * record.sensor.columns + np.minimum(column, area[3] - 1)
    return np.unique(number)


def _paths(
    camera: CameraRecord, number: NDArray[np.int64], wanted: int, seed: np.uint64
) -> tuple[Floats, NDArray[np.int64] | None, int]:
    """Rays on their way to the lens, in blocks, the numbers of their wavelengths, and how many they are."""
    places = zip(*(at.tolist() for at in np.divmod(number, camera.sensor.columns)), strict=True)
    pixels = np.concatenate([pixel_centres(camera, (row, row + 1), (column, column + 1)) for row, column in places])
    fed = fed_pixels(camera, pixels, number)
    if not fed.place.size:
        return np.empty(0), None, 0
    samples = max(wanted // fed.place.size, 1)
    n = fed.place.size * samples
    ways = CameraPaths(camera, fed, batch_record(seed, 0, samples, 1, 0, 0), n)
    blocks = ways.started(0, n)
    ways.fill_through_array(blocks)
    return blocks, ways.waves, n
