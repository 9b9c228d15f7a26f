"""Ghosts of points by forward tracing: through the unfolded stack of each pair of reflecting surfaces."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from plenoptic.camera.ghosts.ghost_camera import ghost_lens, path_records
from plenoptic.camera.psf.psf_results import Spot, add_spots, trace_spots
from plenoptic.camera.psf.sensor_hits import ForwardRecord, in_lens_axes, radiometric_record, ray_tasks
from plenoptic.core.values import Floats
from plenoptic.optics.lens.ghosts.ghost_settings import Ghosts
from plenoptic.optics.lens.ghosts.unfolded import reflecting_lens
from plenoptic.optics.lens.lens_record import LensRecord
from plenoptic.optics.lens.pupil.entrance_pupil import entrance

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera


def ghost_records(camera: PlenopticCamera, ghosts: Ghosts) -> list[ForwardRecord]:
    """Records of a camera with the unfolded stack of each pair in place of its lens, without diffraction.

    Stacks begin at the first vertex of the lens, in its axes. Rays are aimed at the rim of the first element.
    """
    vertices, array = camera.lens.vertices, len(camera.lens.elements)
    first_element = entrance(reflecting_lens(camera.lens), camera.wavelength)
    record = radiometric_record(camera)._replace(ideal=False, entrance=first_element)
    paths = ghost_lens(camera, ghosts).paths((camera.wavelength,))
    compiled, records = path_records(paths, camera.wavelength, array, reverse=False), []
    for path, (lens, detour) in zip(paths, compiled, strict=True):
        front, rear = (float(path.stack.vertices[k] - vertices[k]) for k in (0, -1))
        if detour is not None:
            detour = detour._replace(z=detour.z - front, lens=_shift(detour.lens, -front))
        records.append(record._replace(lens=_shift(lens, -front), unfolded=rear - front, detour=detour))
    return records


def _shift(lens: LensRecord, along: float) -> LensRecord:
    rows = lens.rows.copy()
    rows["z"] += along
    return lens._replace(rows=rows)


def ghost_spots(
    camera: PlenopticCamera, ghosts: Ghosts, world: Floats, rays: tuple[int, int], seed: np.uint64, threads: int
) -> dict[int, Spot]:
    """Images of the ghosts of each point; `rays` are the replicates, and the rays of each that all pairs share."""
    records, (replicates, rays_per_replicate) = ghost_records(camera, ghosts), rays
    spots: dict[int, Spot] = {}
    for k, record in enumerate(records):
        each = -(-rays_per_replicate // len(records))
        tasks = ray_tasks(record, in_lens_axes(record, world), replicates, each)
        for number, spot in trace_spots(record, tasks, each, ~seed - np.uint64(k), threads):
            spots[number] = add_spots(spots[number], spot) if number in spots else spot
    return spots
