"""The ray that stands for a pixel in ground truth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.record import CameraTables, fill_through_array, lanes_for
from plenoptic.camera.sampling.pixel_regions import feeding_regions


class MainRays(NamedTuple):
    """One ray a pixel."""

    before: NDArray[np.float64]
    """Blocks of rays between array and lens, in the lens's axes, on their way to the scene."""
    blocks: NDArray[np.float64]
    """The same rays behind the lens; those of pixels without light are lost."""
    cells: NDArray[np.float64]
    """(n, 3): centre of the cell of each pixel's microlens, local, and its row in the list of lenses or -1; nan where
    the pixel has none."""


def main_rays(tables: CameraTables, pixels: NDArray[np.float64]) -> MainRays:
    """Rays through the lens, one for each pixel centre (n, 2).

    A pixel's ray goes from its centre through the lit centroid of the microlens that gives it most light, found
    with a fixed set of probes and so without noise; see `representative_ray`. A pixel without light has a lost ray.
    """
    from plenoptic.core.kernels.ray_blocks import BLOCK, RAY
    from plenoptic.optics.lens.kernels.trace import fill_traced
    from plenoptic.truth.kernels import representative_ray

    n = len(pixels)
    regions = feeding_regions(tables, pixels, 0.0)
    aims = np.empty((n * representative_ray.PROBES, representative_ray.AIM))
    probes = np.empty(-(-len(aims) // BLOCK) * RAY)
    probe_lanes, lanes = lanes_for(tables, probes.size // 8), lanes_for(tables, -(-n // BLOCK) * BLOCK)
    representative_ray.fill_probes(probes, probe_lanes, aims, pixels, *regions)
    fill_through_array(probes, probe_lanes, tables)
    fill_traced(probes, tables.lens, None)
    rays, cells = np.empty(-(-n // BLOCK) * RAY), np.empty((n, 3))
    representative_ray.fill_main_aims(rays, lanes, cells, probes, aims, pixels, *regions)
    fill_through_array(rays, lanes, tables)
    before = rays.copy()
    fill_traced(rays, tables.lens, None)
    return MainRays(before, rays, cells)
