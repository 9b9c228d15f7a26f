"""Plano-convex microlenses, exact or flat with the normals of a sphere: kernels for light that travels forwards."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.kernels.ray_blocks import (
    BLOCK,
    MISSED,
    OUTSIDE_MICROLENS,
    RAY,
    STATUS,
    TOTAL_REFLECTION,
    WEIGHT,
    L,
    M,
    N,
    X,
    Y,
    Z,
)
from plenoptic.core.numba.jit import device, kernel
from plenoptic.optics.lens.kernels.paths import add_path
from plenoptic.optics.lens.kernels.spherical_refraction import COS2, DISTANCE, UNLIMITED, refract_sphere
from plenoptic.optics.lens.kernels.trace import give_rays, take_rays
from plenoptic.optics.microlens.kernels.cell_lookup import (
    AXIS_X,
    AXIS_Y,
    LENS_ROWS,
    POWER,
    find_cells,
    find_lenses,
    intersect_sphere,
)
from plenoptic.optics.microlens.kernels.path_length import add_height, start_path, store_lenses
from plenoptic.optics.microlens.kernels.plano_convex import refract_flat_block
from plenoptic.optics.microlens.kernels.plate_losses import (
    LOSS_ROWS,
    absorb_in_plate,
    add_distance_to_plane,
    store_distance_to_plane,
    weaken_at_side,
)
from plenoptic.optics.microlens.kernels.to_sensor import reach_sensor, to_plane


@device
def _shift(ray, lens_rows, sign):
    for i in range(BLOCK):
        ray[X + i] += sign * lens_rows[AXIS_X + i]
        ray[Y + i] += sign * lens_rows[AXIS_Y + i]


@device
def _keep_inside(ray, edges):
    """Lose rays outside of the cell that was tried last; x, y are from its centre."""
    for k in range(edges.shape[0]):
        nx, ny, apothem = edges[k, 0], edges[k, 1], edges[k, 2]
        # A ray on the edge belongs to either cell.
        limit = apothem * (1.0 + 1e-9)
        for i in range(BLOCK):
            inside = nx * ray[X + i] + ny * ray[Y + i] <= limit
            was = ray[STATUS + i]
            ray[STATUS + i] = was if was != 0.0 or inside else OUTSIDE_MICROLENS


@device
def _weigh_tilt(ray, c, after):
    """Correct the etendue at a plane that refracts as a sphere of curvature c would.

    Refraction preserves the projected solid angle on a surface with these normals. On the plane it changes by the ratio
    of cosines to the axis and to the normal: multiply by it after refraction, divide before.
    """
    for i in range(BLOCK):
        x, y = ray[X + i], ray[Y + i]
        up = math.sqrt(max(1.0 - c * c * (x * x + y * y), 0.0))
        cos = up * ray[N + i] - c * (x * ray[L + i] + y * ray[M + i])
        fraction = ray[N + i] / cos
        ray[WEIGHT + i] *= fraction if after else 1.0 / fraction


@device
def _refract_each(ray, lens_rows, bow, mu, flat, losses):
    """Refract rays at spheres of curvature `bow` times each lens's power, or at `flat` planes with their normals.

    Rays start from the plane of the vertices, x, y from the optical axis of their lens.
    `losses` as of `refract_sphere`.
    """
    factor = 1.0 - mu * mu
    for i in range(BLOCK):
        c = bow * lens_rows[POWER + i]
        x, y, l, m, n = ray[X + i], ray[Y + i], ray[L + i], ray[M + i], ray[N + i]
        if flat:
            z, up = 0.0, 1.0 - c * c * (x * x + y * y)
            nx, ny, nz = -c * x, -c * y, math.sqrt(max(up, 0.0))
            q = nx * l + ny * m + nz * n
            hit = up >= 0.0 and q > 0.0
        else:
            x, y, z, distance, q2 = intersect_sphere(x, y, l, m, n, c)
            q = math.sqrt(max(q2, 0.0))
            nx, ny, nz = -c * x, -c * y, 1.0 - c * z
            hit = q2 > 0.0 and nz > 0.0
        cos2 = 1.0 - mu * mu * (1.0 - q * q)
        if losses is not None and not flat:
            losses[COS2, i] = min(q * q, cos2)
            losses[DISTANCE, i] = distance
        cos_t = math.sqrt(max(cos2, 0.0))
        a = factor / (cos_t + mu * q)
        ray[X + i], ray[Y + i], ray[Z + i] = x, y, z
        ray[L + i] = mu * l + a * nx
        ray[M + i] = mu * m + a * ny
        ray[N + i] = mu * n + a * nz
        if flat:
            # See `_weigh_tilt`: the cosine to the normal is q before and cos_t after.
            ray[WEIGHT + i] *= (ray[N + i] / cos_t) / (n / q)
        lost = 0.0 if cos2 >= 0.0 else TOTAL_REFLECTION
        lost = lost if hit else MISSED
        was = ray[STATUS + i]
        ray[STATUS + i] = was if was != 0.0 else lost


@device
def _refract_curved_side(ray, lens_rows, c, mu, flat, array, losses):
    """Refract rays at the curved side of equal lenses with vertices in z = 0, in the cell of their intersection."""
    if flat:
        find_cells(ray, lens_rows, 0.0, array.lattice)
    else:
        find_cells(ray, lens_rows, c, array.lattice)
    _shift(ray, lens_rows, -1.0)
    if flat:
        _weigh_tilt(ray, c, False)
        refract_flat_block(ray, c, mu, None, 1.0)
        _weigh_tilt(ray, c, True)
    else:
        refract_sphere(ray, c, mu, None, UNLIMITED, 1.0, 0.0, losses)
        _keep_inside(ray, array.cell)
    _shift(ray, lens_rows, 1.0)


@device
def _refract_curved_sides(ray, lens_rows, bow, mu, plate, array, losses):
    """Refract rays at the curved sides of lenses that differ."""
    find_lenses(ray, lens_rows, 0.0 if plate.flat else bow, plate.towards_scene, array)
    _shift(ray, lens_rows, -1.0)
    _refract_each(ray, lens_rows, bow, mu, plate.flat, losses)
    _shift(ray, lens_rows, 1.0)


@device
def refract_plate(ray, lens_rows, z_front, plate, array, differs, path):
    """Refract rays behind the lens by the plate; z is then measured from the vertex of its last side.

    `z_front` is the vertex of the first side. `differs` is the array if its lenses differ, otherwise None. With `path`,
    a `PathWorkspace`, optical path lengths from there are computed.
    """
    thickness, power, curved_first = plate.thickness, array.lattice.powers[0], plate.towards_scene
    # All rays have the camera's wavelength.
    index = plate.refractive_index if plate.indices is None else plate.indices[0]
    bow, mu = (1.0 if curved_first else -1.0) / (plate.refractive_index - 1.0), 1.0 / index if curved_first else index
    losses = None if plate.losses is None else np.empty((LOSS_ROWS, BLOCK))
    if path is not None:
        start_path(path, ray, z_front)
    to_plane(ray, z_front)
    if not curved_first:
        if path is not None:
            add_path(path, ray, 0)
        refract_sphere(ray, 0.0, 1.0 / index, None, UNLIMITED, 1.0, 0.0, losses)
        if plate.losses is not None:
            weaken_at_side(ray, plate.losses, None, 0, losses)
            store_distance_to_plane(ray, thickness, losses)
        if path is not None:
            start_path(path, ray, thickness)
        to_plane(ray, thickness)
    if differs is None:
        _refract_curved_side(ray, lens_rows, bow * power, mu, plate.flat, array, losses)
    else:
        _refract_curved_sides(ray, lens_rows, bow, mu, plate, array, losses)
    if plate.losses is not None:
        weaken_at_side(ray, plate.losses, None, 0, losses)
    if path is not None:
        add_path(path, ray, 0 if curved_first else 1)
        if plate.flat:
            add_height(path, ray, lens_rows, bow, None if differs is not None else array.lattice.powers, curved_first)
    if curved_first:
        if path is not None:
            start_path(path, ray, thickness)
        for i in range(BLOCK):
            ray[Z + i] -= thickness
        refract_sphere(ray, 0.0, index, None, UNLIMITED, 1.0, 0.0, losses)
        if plate.losses is not None:
            weaken_at_side(ray, plate.losses, None, 0, losses)
        if path is not None:
            add_path(path, ray, 1)
    if plate.losses is not None:  # noqa: SIM102 - nested for compile-time pruning
        if plate.losses.attenuation is not None:
            if not curved_first:
                add_distance_to_plane(losses)
            absorb_in_plate(ray, plate.losses, None, 0, losses)


@kernel
def fill_plano_convex_forward(blocks, z_front, sensor, plate, array, differs):
    """Trace rays behind the lens to the sensor.

    `z_front` is the vertex of the first side; the distance of the `SensorPlane` is from the last one. `differs` is the
    array if its lenses differ, otherwise None.
    """
    lens_rows = np.empty(LENS_ROWS * BLOCK)
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        refract_plate(ray, lens_rows, z_front, plate, array, differs, None)
        reach_sensor(ray, lens_rows, sensor, array)


@kernel
def fill_plate_paths(out, traced, rays, array, differs, path, first, last):
    """Refract rays `first` to `last` of `RayArrays` by plates with the first vertex at z = 0; compute their paths.

    `traced` is a `TracedPaths`, `path` a `PathWorkspace` for this call alone; `differs` as for
    `fill_plano_convex_forward`.
    """
    ray, lens_rows = np.zeros(RAY), np.zeros(LENS_ROWS * BLOCK)
    for start in range(first, last, BLOCK):
        end = min(start + BLOCK, last)
        take_rays(ray, rays, start, end)
        path.length[:] = 0.0
        refract_plate(ray, lens_rows, 0.0, array.model, array, differs, path)
        for i in range(BLOCK):
            ray[Z + i] += array.model.thickness
        give_rays(out, ray, start, end)
        for i in range(end - start):
            traced.lengths[start + i] = path.length[i] if ray[STATUS + i] == 0.0 else math.nan
        store_lenses(traced.lenses, lens_rows, start, end)
