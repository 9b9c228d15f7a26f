"""The ray that stands for a pixel in ground truth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.regions import feeding_regions
from plenoptic.camera.tables import CameraTables, fill_through_array


def main_rays(tables: CameraTables, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rays that left the lens, as blocks, one for each pixel centre (n, 2).

    A pixel's ray goes from its centre through the lit centroid of the microlens that gives it most light, found
    with a fixed set of probes and so without noise; see `_truth`. A pixel without light has a lost ray.
    """
    from plenoptic.camera import _truth
    from plenoptic.optics._blocks import BLOCK, RAY
    from plenoptic.optics._trace import fill_traced

    n = len(pixels)
    triangles, first = feeding_regions(tables, pixels, 0.0)
    aims = np.empty((n * _truth.PROBES, 4))
    probes = np.empty(-(-len(aims) // BLOCK) * RAY)
    _truth.fill_probes(probes, aims, pixels, triangles, first)
    fill_through_array(probes, tables)
    fill_traced(probes, *tables.lens)
    rays = np.empty(-(-n // BLOCK) * RAY)
    _truth.fill_main_aims(rays, probes, aims, pixels, triangles, first)
    fill_through_array(rays, tables)
    fill_traced(rays, *tables.lens)
    return rays
