"""Kernels that trace rays through a lens, element by element."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.kernels.ray_blocks import BLOCK, CAUSES, RAY, STATUS, WEIGHT, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import device, kernel
from plenoptic.optics.coatings.kernels.losses import DEPTH, ROWS, START, absorb, add_depth, fill_distances, weaken
from plenoptic.optics.element_record import ASPHERE, CIRCLE, CONIC, FREEFORM, IDEAL, SPHERE
from plenoptic.optics.lens.kernels.aspheric_refraction import refract_asphere, refract_conic
from plenoptic.optics.lens.kernels.conditioning_probes import (
    INCIDENT_ROWS,
    init_incident,
    record_asphere,
    record_conic,
    record_plane,
    store_incident,
)
from plenoptic.optics.lens.kernels.frames import into_frame, out_of_frame
from plenoptic.optics.lens.kernels.freeform import record_freeform
from plenoptic.optics.lens.kernels.ideal import refract_ideal, to_plane
from plenoptic.optics.lens.kernels.mirror import reflect
from plenoptic.optics.lens.kernels.paths import add_path, begin_path, store_start
from plenoptic.optics.lens.kernels.spherical_refraction import refract_sphere
from plenoptic.optics.lens.kernels.stops import clip_circle, clip_shape
from plenoptic.optics.lens.lens_record import MOVED


@device
def _enter(ray, z_first):
    """Move rays to the point closest to the lens origin, then measure z from the first vertex."""
    for i in range(BLOCK):
        x, y, z = ray[X + i], ray[Y + i], ray[Z + i]
        l, m, n = ray[L + i], ray[M + i], ray[N + i]
        e = -(x * l + y * m + z * n)
        ray[X + i] = x + e * l
        ray[Y + i] = y + e * m
        ray[Z + i] = (z + e * n) - z_first


@device
def _leave(ray, z_last):
    for i in range(BLOCK):
        ray[Z + i] += z_last
        ray[WEIGHT + i] = ray[WEIGHT + i] if ray[STATUS + i] == 0.0 else 0.0


@device
def _fill_index_ratios(index_ratios, by_wavelength, waves, first):
    """Fill the index ratio of each ray of a block from `by_wavelength`, which holds one for each wavelength."""
    for i in range(BLOCK):
        index_ratios[i] = by_wavelength[waves[first + i]]


@device
def _record_element(probes, incident, ray, lens, k, index_ratios):
    """Record the conditioning of the rays behind element k."""
    row = lens.rows[k]
    origin_distance = abs(row.z) if k == 0 or k == lens.rows.size - 1 else 0.0
    kz = 1.0 if lens.conic is None else 1.0 + lens.conic[k]
    if row.kind == SPHERE or row.kind == CONIC:
        record_conic(probes[k], incident, ray, row, kz, index_ratios, origin_distance)
    elif row.kind != ASPHERE and row.kind != FREEFORM:
        record_plane(probes[k], incident, ray, row.kind == IDEAL, origin_distance)
    elif lens.aspheric is not None:
        if row.kind == ASPHERE:
            record_asphere(probes[k], incident, ray, row, (kz, lens.aspheric[k]), index_ratios, origin_distance)
        elif lens.freeform is not None:
            record_freeform(probes, incident, ray, lens, k, index_ratios, origin_distance)


@device
def trace_block(ray, lens, waves, first, index_ratios, probes, path):
    """Trace one block through all elements of a `LensRecord`, in the order of travel.

    With `waves`, each ray has its own wavelength: waves[first + i] is the column of `lens.index_ratios` for ray i of
    the block. `index_ratios` (BLOCK,) is then a buffer. With `probes` (elements, PROBE_ROWS, BLOCK), the conditioning
    is recorded. With `path`, optical path lengths are computed. With `lens.losses`, weights lose reflected and absorbed
    light.
    """
    if lens.losses is not None:
        losses = np.empty((ROWS, BLOCK))
        losses[DEPTH] = 0.0
    if path is not None:
        begin_path(path, ray)
    if probes is not None:
        incident = np.empty((INCIDENT_ROWS, BLOCK))
        init_incident(incident, ray)
    rows, s = lens.rows, lens.direction
    _enter(ray, rows[0].z)
    for k in range(rows.size):
        if k > 0:
            gap = rows[k].z - rows[k - 1].z
            for i in range(BLOCK):
                ray[Z + i] -= gap
        if waves is not None:
            _fill_index_ratios(index_ratios, lens.index_ratios[k], waves, first)
        if lens.frames is not None:  # noqa: SIM102 - nested for compile-time pruning
            if lens.frames[k, MOVED] != 0.0:
                into_frame(ray, lens.frames[k])
        if lens.mirrors is not None:
            # A mirror is always traced in the direction from the scene, also when the lens is traced in reverse.
            s = 1.0 if lens.mirrors[k, MOVED] != 0.0 else lens.direction
            if s != lens.direction:
                out_of_frame(ray, lens.mirrors[k])
        if probes is not None:
            store_incident(incident, probes[k], ray)
        if path is not None:
            store_start(path.start, ray)
        if lens.losses is not None:  # noqa: SIM102 - nested for compile-time pruning
            if lens.losses.attenuation is not None and lens.losses.absorbing[k] and rows[k].kind != SPHERE:
                store_start(losses[START:], ray)
        row, code = rows[k], CAUSES * (rows[k].surface_index + 1.0)
        if row.kind == SPHERE:
            c, mu = row.curvature, row.index_ratio
            limits = row.semi_diameter2, row.max_depth
            if lens.losses is None:
                refract_sphere(ray, c, mu, index_ratios, limits, s, code, None)
            else:
                refract_sphere(ray, c, mu, index_ratios, limits, s, code, losses)
        elif row.kind == IDEAL:
            refract_ideal(ray, row.curvature, row.index_ratio, index_ratios, row.max_depth)
        elif row.kind != CONIC and row.kind != ASPHERE and row.kind != FREEFORM:
            to_plane(ray)
            clip_circle(ray, row.semi_diameter2, code)
            if row.kind != CIRCLE:
                clip_shape(ray, lens, k, code)
        elif lens.conic is not None:
            if row.kind == CONIC:
                refract_conic(ray, row, lens.conic[k], index_ratios, s, code)
            elif lens.aspheric is not None:
                shape = (row.curvature, 1.0 + lens.conic[k]), lens.aspheric[k]
                steps = None if probes is None else probes[k]
                if row.kind == ASPHERE:
                    refract_asphere(ray, row, shape, None, index_ratios, s, code, steps)
                elif lens.freeform is not None:
                    refract_asphere(ray, row, shape, lens.freeform[k], index_ratios, s, code, steps)
        if path is not None:
            add_path(path, ray, k)
        if lens.losses is not None:  # noqa: SIM102 - nested for compile-time pruning
            if lens.losses.attenuation is not None and lens.losses.absorbing[k]:
                if row.kind != SPHERE:
                    fill_distances(ray, losses)
                add_depth(losses, lens.losses.attenuation[k], waves, first)
        if lens.mirrors is not None:  # noqa: SIM102 - nested for compile-time pruning
            if lens.mirrors[k, MOVED] != 0.0:
                reflect(ray, lens, k)
        if lens.losses is not None:
            weaken(ray, lens, k, waves, first, index_ratios, losses)
        if probes is not None:
            _record_element(probes, incident, ray, lens, k, index_ratios)
        if lens.mirrors is not None:  # noqa: SIM102 - nested for compile-time pruning
            if lens.mirrors[k, MOVED] != 0.0 and lens.direction > 0.0:
                out_of_frame(ray, lens.mirrors[k])
        if lens.frames is not None:  # noqa: SIM102 - nested for compile-time pruning
            if lens.frames[k, MOVED] != 0.0:
                out_of_frame(ray, lens.frames[k])
    if lens.losses is not None:  # noqa: SIM102 - nested for compile-time pruning
        if lens.losses.attenuation is not None:
            absorb(ray, losses)
    _leave(ray, rows[rows.size - 1].z)


@kernel
def fill_through_lens(blocks, lens, waves):
    """Trace a bundle, shape (n_blocks * RAY,), in place.

    `waves` (rays,) is the column of `lens.index_ratios` of each ray; None if all rays have one wavelength.
    """
    index_ratios = None if waves is None else np.empty(BLOCK)
    for b in range(blocks.size // RAY):
        trace_block(blocks[b * RAY : (b + 1) * RAY], lens, waves, b * BLOCK, index_ratios, None, None)


@kernel
def fill_conditions(blocks, probes, lens, waves):
    """Trace a bundle as `fill_through_lens` does, and record its conditioning.

    `probes` (n_blocks, elements, PROBE_ROWS, BLOCK) has the elements in the order of travel; see `conditioning_probes`.
    """
    index_ratios = None if waves is None else np.empty(BLOCK)
    for b in range(blocks.size // RAY):
        trace_block(blocks[b * RAY : (b + 1) * RAY], lens, waves, b * BLOCK, index_ratios, probes[b], None)


@device
def take_rays(ray, given, first, last):
    """Copy rays of `RayArrays` into a block."""
    origin, direction = given.origin[3 * first : 3 * last], given.direction[3 * first : 3 * last]
    weight, status, lost_at = given.weight[first:last], given.status[first:last], given.lost_at[first:last]
    for i in range(last - first):
        ray[X + i] = origin[3 * i]
        ray[Y + i] = origin[3 * i + 1]
        ray[Z + i] = origin[3 * i + 2]
        ray[L + i] = direction[3 * i]
        ray[M + i] = direction[3 * i + 1]
        ray[N + i] = direction[3 * i + 2]
        ray[WEIGHT + i] = weight[i]
        ray[STATUS + i] = 0.0 if status[i] == 0 else status[i] + CAUSES * (lost_at[i] + 1.0)


@device
def give_rays(out, ray, first, last):
    """Copy a block into `RayArrays`; lost rays become NaN."""
    origin, direction = out.origin[3 * first : 3 * last], out.direction[3 * first : 3 * last]
    weight, status, lost_at = out.weight[first:last], out.status[first:last], out.lost_at[first:last]
    for i in range(last - first):
        code = np.uint32(ray[STATUS + i])
        void = 0.0 if code == 0 else math.nan
        origin[3 * i] = ray[X + i] + void
        origin[3 * i + 1] = ray[Y + i] + void
        origin[3 * i + 2] = ray[Z + i] + void
        direction[3 * i] = ray[L + i] + void
        direction[3 * i + 1] = ray[M + i] + void
        direction[3 * i + 2] = ray[N + i] + void
        weight[i] = ray[WEIGHT + i]
        status[i] = code % CAUSES
        lost_at[i] = code // CAUSES - 1


@kernel
def fill_traced_rows(out, given, lens, first, last):
    """Trace rays `first` ... `last` - 1 of `RayArrays` into `out`. Lost rays become NaN, with weight 0 and a status."""
    ray = np.zeros(RAY)
    for start in range(first, last, BLOCK):
        end = min(start + BLOCK, last)
        take_rays(ray, given, start, end)
        trace_block(ray, lens, None, 0, None, None, None)
        give_rays(out, ray, start, end)


@kernel
def fill_paths(out, lengths, given, lens, path, first, last):
    """Trace as `fill_traced_rows`, with each ray's optical path in mm from its origin to the last element; nan if lost.

    Each concurrent call needs its own `PathWorkspace` as `path`.
    """
    ray = np.zeros(RAY)
    for start in range(first, last, BLOCK):
        end = min(start + BLOCK, last)
        take_rays(ray, given, start, end)
        trace_block(ray, lens, None, 0, None, None, path)
        give_rays(out, ray, start, end)
        for i in range(end - start):
            lengths[start + i] = path.length[i] if ray[STATUS + i] == 0.0 else math.nan
