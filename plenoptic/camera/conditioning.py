"""How well conditioned the paths of a camera are at each element of its lens."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.record import CameraTables, fill_before_array, fill_through_array, lanes_for
from plenoptic.camera.sampling.pixel_regions import feeding_regions, pixel_centres
from plenoptic.core.values import whole
from plenoptic.optics.lens.analysis.conditioning import Conditioning, conditioning_of
from plenoptic.optics.lens.analysis.conditioning_rows import noted

_PER_PIXEL = 4
"""Paths of a pixel where there are pixels enough: more of these say more than more paths of each."""


def camera_conditioning(
    tables: CameraTables, region: tuple[int, int, int, int] | None = None, *, seed: int = 0, rays: int = 1024
) -> Conditioning:
    """What `conditioning` says of paths as they are rendered: from the sensor through the array and the lens.

    Pixels are drawn all over the region, one from each of many equal rectangles. Their paths are the first ones of the
    first replicate of `render` with that seed, with their own wavelengths where the sensor sees colours. Paths that end
    at the array are counted without an element.

    Parameters
    ----------
    tables : CameraTables
        From `camera_tables`.
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
    >>> from plenoptic.camera.record import camera_tables
    >>> camera = pl.PlenopticCamera(lens=pl.load_lens("double-gauss-100mm-f2"),
    ...     microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)),
    ...     sensor=pl.Sensor(shape=(512, 512), pixel_pitch=0.01),
    ...     stop_to_microlenses=123.3, microlenses_to_sensor=1.7)
    >>> found = camera_conditioning(camera_tables(camera))
    >>> found.elements.tolist()
    [10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0]
    >>> bool(found.incidence[found.reached > 0].max() < 2)
    True
    """
    wanted, seed = whole(rays, "rays", at_least=1), whole(seed, "seed", at_least=0)
    area = (0, tables.rows, 0, tables.columns) if region is None else region
    number = _spread(tables, area, max(wanted // _PER_PIXEL, 1), seed)
    blocks, waves, n = _paths(tables, number, wanted, np.uint64(seed))
    lens = tables.lens if waves is None or tables.dispersed is None else tables.dispersed
    return conditioning_of(noted(lens, blocks, n, waves))


def _spread(tables: CameraTables, area: tuple[int, int, int, int], most: int, seed: int) -> NDArray[np.int64]:
    """Numbers on the sensor of pixels, at most one from each of about `most` equal rectangles."""
    height, width = area[1] - area[0], area[3] - area[2]
    down = min(max(round(math.sqrt(most * height / width)), 1), height, most)
    across = min(max(most // down, 1), width)
    u = np.random.default_rng(seed).random((2, down, across))
    row = area[0] + ((np.arange(down)[:, None] + u[0]) * height / down).astype(np.int64)
    column = area[2] + ((np.arange(across) + u[1]) * width / across).astype(np.int64)
    number = np.minimum(row, area[1] - 1) * tables.columns + np.minimum(column, area[3] - 1)
    return np.unique(number)


def _paths(
    tables: CameraTables, number: NDArray[np.int64], wanted: int, seed: np.uint64
) -> tuple[NDArray[np.float64], NDArray[np.int64] | None, int]:
    """Rays on their way to the lens, in blocks, the numbers of their wavelengths, and how many they are."""
    from plenoptic.camera.sampling.kernels import paths as sample_kernels
    from plenoptic.core.kernels import sobol
    from plenoptic.core.kernels.ray_blocks import BLOCK, RAY

    places = zip(*(at.tolist() for at in np.divmod(number, tables.columns)), strict=True)
    pixels = np.concatenate([pixel_centres(tables, (row, row + 1), (column, column + 1)) for row, column in places])
    triangles, first, details = feeding_regions(tables, pixels, 0.5 * math.sqrt(2) * tables.pitch)
    lit = np.flatnonzero(np.diff(first))
    if not lit.size:
        return np.empty(0), None, 0
    samples = max(wanted // lit.size, 1)
    n, number = lit.size * samples, number[lit]
    blocks = np.empty(-(-n // BLOCK) * RAY)
    lanes = lanes_for(tables, blocks.size // 8)
    net = np.empty((sobol.DIMENSIONS, samples), dtype=np.uint32)
    sobol.fill_net(net, 0)
    sample_kernels.fill_camera_samples(
        blocks,
        lanes,
        0,
        n,
        samples,
        1,
        0,
        seed,
        net,
        np.ascontiguousarray(pixels[lit]),
        number,
        tables.pixel_edges,
        tables.pixel_skew,
        triangles,
        details,
        np.append(first[lit], first[-1]),
    )
    fill_before_array(blocks, tables)
    fill_through_array(blocks, lanes, tables)
    colour, waves = tables.colour, None
    if colour is not None and tables.dispersed is not None:
        waves = np.empty(blocks.size // 8, dtype=np.int64)
        guide = np.zeros(1, dtype=np.int64)
        sample_kernels.fill_waves(waves, 0, n, samples, 1, 0, 0, seed, number, colour.cdf, guide)
    return blocks, waves, n
