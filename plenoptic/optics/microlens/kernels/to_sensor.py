"""Rays from the main lens through the microlenses onto the sensor: the kernels for light that travels forwards.

On entry blocks hold rays as `trace` leaves them, in the axes in which the array is traced. On exit X, Y is where a ray
meets the sensor, in the sensor's own axes, Z, N is the lattice index of the microlens that it passed (FREE: number and
0), and L, M are the slopes with which it arrives, in the array's axes.

WEIGHT is etendue, area times projected solid angle. With slopes u, v per length of z and the angle a to the axis, it is
dx dy du dv cos^4 a, whichever axis is taken for z. Free space and true refraction keep it. Ideal thin elements keep
dx dy du dv about their own axis instead, since they only shear the slopes by the height: there the weight is multiplied
by cos^4 after over cos^4 before. It then is the etendue at the sensor, which is what a pixel measures, and which does
not depend on how the sensor is tilted.
"""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.jit import device, kernel
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
from plenoptic.optics.lens.kernels.frames import into_frame
from plenoptic.optics.lens.kernels.sphere import refract_sphere
from plenoptic.optics.microlens.kernels.cell_lookup import (
    AXIS_X,
    AXIS_Y,
    BEND,
    FIRST,
    PLACE,
    SECOND,
    find_cells,
    find_lenses,
    own_lens,
)
from plenoptic.optics.microlens.kernels.to_lens import refract_flat_block


@device
def _to_plane(ray, z):
    """Move rays along themselves to a plane and measure z from there."""
    for i in range(BLOCK):
        t = (z - ray[Z + i]) / ray[N + i]
        ray[X + i] += t * ray[L + i]
        ray[Y + i] += t * ray[M + i]
        ray[Z + i] = 0.0


@device
def _shift(ray, place, sign):
    for i in range(BLOCK):
        ray[X + i] += sign * place[AXIS_X + i]
        ray[Y + i] += sign * place[AXIS_Y + i]


@device
def _keep_inside(ray, edges):
    """Rays that were found in no cell are lost; x, y are from the centre of the last cell that was tried."""
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
    """Etendue at a plane that refracts as a sphere of curvature c would.

    Refraction keeps the projected solid angle on the surface whose normal it has; on the plane it changes by the
    cosine to the axis over that to the normal, after, over the same before.
    """
    for i in range(BLOCK):
        x, y = ray[X + i], ray[Y + i]
        up = math.sqrt(max(1.0 - c * c * (x * x + y * y), 0.0))
        cos = up * ray[N + i] - c * (x * ray[L + i] + y * ray[M + i])
        share = ray[N + i] / cos
        ray[WEIGHT + i] *= share if after else 1.0 / share


@device
def _refract_each(ray, place, bow, mu, flat):
    """Through spheres of curvature `bow` times the power of each ray's lens, or `flat` planes with their normals.

    Rays start from the plane of the vertices, x, y from the optical axis of their lens.
    """
    bend = 1.0 - mu * mu
    for i in range(BLOCK):
        c = bow * place[BEND + i]
        x, y, l, m, n = ray[X + i], ray[Y + i], ray[L + i], ray[M + i], ray[N + i]
        if flat:
            z, up = 0.0, 1.0 - c * c * (x * x + y * y)
            nx, ny, nz = -c * x, -c * y, math.sqrt(max(up, 0.0))
            q = nx * l + ny * m + nz * n
            met = up >= 0.0 and q > 0.0
        else:
            # As in `sphere.refract_sphere`.
            e = -(x * l + y * m)
            x, y, z = x + e * l, y + e * m, e * n
            f = c * (x * x + y * y + z * z) - 2.0 * z
            g = n - c * (x * l + y * m + z * n)
            q2 = g * g - c * f
            q = math.sqrt(max(q2, 0.0))
            t = f / (g + q) if g >= 0.0 else (g - q) / c
            x, y, z = x + t * l, y + t * m, z + t * n
            nx, ny, nz = -c * x, -c * y, 1.0 - c * z
            met = q2 > 0.0 and nz > 0.0
        cos2 = 1.0 - mu * mu * (1.0 - q * q)
        cos_t = math.sqrt(max(cos2, 0.0))
        a = bend / (cos_t + mu * q)
        ray[X + i], ray[Y + i], ray[Z + i] = x, y, z
        ray[L + i] = mu * l + a * nx
        ray[M + i] = mu * m + a * ny
        ray[N + i] = mu * n + a * nz
        if flat:
            # See `_weigh_tilt`: the cosine to the normal is q before and cos_t after.
            ray[WEIGHT + i] *= (ray[N + i] / cos_t) / (n / q)
        lost = 0.0 if cos2 >= 0.0 else TOTAL_REFLECTION
        lost = lost if met else MISSED
        was = ray[STATUS + i]
        ray[STATUS + i] = was if was != 0.0 else lost


@device
def _refract_curved(ray, place, c, mu, flat, origin, basis, inverse, edges):
    """Through the curved side of equal lenses, whose vertices lie in z = 0, in the cell where each ray meets it."""
    if flat:
        find_cells(ray, place, 0.0, origin, basis, inverse)
    else:
        find_cells(ray, place, c, origin, basis, inverse)
    _shift(ray, place, -1.0)
    if flat:
        _weigh_tilt(ray, c, False)
        refract_flat_block(ray, c, mu, 1.0)
        _weigh_tilt(ray, c, True)
    else:
        refract_sphere(ray, c, mu, None, math.inf, math.inf, 1.0, 0.0)
        _keep_inside(ray, edges)
    _shift(ray, place, 1.0)


@device
def _refract_curved_each(ray, place, bow, mu, towards_scene, flat, clear, edges, radius2, cells, lenses, lattice):
    """The same for lenses that differ."""
    find_lenses(ray, place, 0.0 if flat else bow, towards_scene, clear, edges, radius2, cells, lenses, lattice)
    _shift(ray, place, -1.0)
    _refract_each(ray, place, bow, mu, flat)
    _shift(ray, place, 1.0)


@device
def _land(ray, z, lean, sensor, place, walls):
    """Move rays to the sensor; keep the indices of their microlenses. What is lost carries nothing.

    The sensor is the plane z + lean . (x, y); `sensor` (2, 3) leads from x, y, 1 there to its own axes. With `walls`,
    the lattice (see `cell_lookup`), rays are lost that land behind the cell of another microlens.
    """
    for i in range(BLOCK):
        n = ray[N + i]
        u, v = ray[L + i] / n, ray[M + i] / n
        x, y, t = ray[X + i], ray[Y + i], z - ray[Z + i]
        if lean is not None:
            towards = 1.0 - lean[0] * u - lean[1] * v
            t = (t + lean[0] * x + lean[1] * y) / towards
            ray[STATUS + i] = ray[STATUS + i] if ray[STATUS + i] != 0.0 or towards > 0.0 else MISSED
        x, y = x + t * u, y + t * v
        if walls is not None:  # noqa: SIM102 - alone, so that it is pruned
            if ray[STATUS + i] == 0.0:
                first, second, _, _, _, _ = own_lens(x, y, *walls)
                own = first == place[FIRST + i] and second == place[SECOND + i]
                ray[STATUS + i] = 0.0 if own else OUTSIDE_MICROLENS
        if sensor is not None:
            x, y = (
                sensor[0, 0] * x + sensor[0, 1] * y + sensor[0, 2],
                sensor[1, 0] * x + sensor[1, 1] * y + sensor[1, 2],
            )
        ray[X + i] = x
        ray[Y + i] = y
        ray[L + i] = u
        ray[M + i] = v
        ray[Z + i] = place[FIRST + i]
        ray[N + i] = place[SECOND + i]
        ray[WEIGHT + i] = ray[WEIGHT + i] if ray[STATUS + i] == 0.0 else 0.0


@kernel
def fill_aims(aims, blocks, distance, lean, placed):
    """Rays that have landed, in the form in which the renderer aims samples between sensor and array (see `to_lens`).

    `aims` gets the points where their lines cross the array's rear principal plane, those points minus the points on
    the sensor, and the weights. `placed` (2, 3) leads from x, y, 1 on the sensor to the local axes, None where they are
    the same; there the sensor lies `distance` + lean . (x, y) behind that plane.
    """
    for b in range(blocks.size // RAY):
        ray, aim = blocks[b * RAY : (b + 1) * RAY], aims[b * RAY : (b + 1) * RAY]
        for i in range(BLOCK):
            x, y = ray[X + i], ray[Y + i]
            if placed is not None:
                x, y = (
                    placed[0, 0] * x + placed[0, 1] * y + placed[0, 2],
                    placed[1, 0] * x + placed[1, 1] * y + placed[1, 2],
                )
            h = distance if lean is None else distance + lean[0] * x + lean[1] * y
            aim[L + i] = -h * ray[L + i]
            aim[M + i] = -h * ray[M + i]
            aim[X + i] = x + aim[L + i]
            aim[Y + i] = y + aim[M + i]
            aim[WEIGHT + i] = ray[WEIGHT + i]


@kernel
def fill_weights(blocks, aims):
    """The weights of aims back to their rays."""
    for b in range(blocks.size // RAY):
        for i in range(WEIGHT, WEIGHT + BLOCK):
            blocks[b * RAY + i] = aims[b * RAY + i]


@kernel
def fill_ideal_weights(blocks):
    """Behind an ideal main lens, in its axes: dx dy du dv, which it keeps, becomes etendue."""
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        for i in range(BLOCK):
            cos2 = ray[N + i] * ray[N + i]
            ray[WEIGHT + i] *= cos2 * cos2


@kernel
def fill_in_array_axes(blocks, frame):
    """Rays from the lens's axes to the array's, from which `frame` leads: the rotation row by row and the shift."""
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        into_frame(ray, frame)
        for i in range(BLOCK):
            ray[STATUS + i] = ray[STATUS + i] if ray[STATUS + i] != 0.0 or ray[N + i] > 0.0 else MISSED


@kernel
def fill_straight_forward(blocks, z_sensor, lean, sensor):
    """No microlenses."""
    place = np.zeros(PLACE * BLOCK)
    for b in range(blocks.size // RAY):
        _land(blocks[b * RAY : (b + 1) * RAY], z_sensor, lean, sensor, place, None)


@kernel
def fill_thin_forward(
    blocks,
    z_array,
    distance,
    lean,
    sensor,
    power,
    origin,
    basis,
    inverse,
    clear,
    edges,
    radius2,
    cells,
    lenses,
    lattice,
    walls,
):
    """Ideal thin lenses: slopes change by height over focal length (power = 1/f).

    Equal lenses fill the cells of the lattice `origin`, `basis`; those that differ are found in `lattice`, which is
    None otherwise, and is `walls` too where walls stand between the cells. For the arguments from `clear` on see
    `cell_lookup.find_lenses`.
    """
    place = np.empty(PLACE * BLOCK)
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        _to_plane(ray, z_array)
        if lattice is None:
            find_cells(ray, place, 0.0, origin, basis, inverse)
        else:
            find_lenses(ray, place, 0.0, True, clear, edges, radius2, cells, lenses, lattice)
        for i in range(BLOCK):
            bend = power if lattice is None else place[BEND + i]
            before = ray[N + i]
            u = ray[L + i] / before - (ray[X + i] - place[AXIS_X + i]) * bend
            v = ray[M + i] / before - (ray[Y + i] - place[AXIS_Y + i]) * bend
            after = 1.0 / math.sqrt(1.0 + u * u + v * v)
            share = (after * after) / (before * before)
            ray[WEIGHT + i] *= share * share
            ray[L + i] = u * after
            ray[M + i] = v * after
            ray[N + i] = after
        _land(ray, distance, lean, sensor, place, walls)


@kernel
def fill_plano_convex_forward(
    blocks,
    z_front,
    distance,
    lean,
    sensor,
    curved_first,
    flat,
    thickness,
    index,
    cell,
    power,
    origin,
    basis,
    inverse,
    clear,
    edges,
    radius2,
    cells,
    lenses,
    lattice,
    walls,
):
    """Plano-convex lenses: a plane and a sphere of radius (index - 1) / power, or a plane with its normals (`flat`).

    `curved_first`: the curved side faces the scene. `z_front` is the vertex that light meets first and `distance` that
    from the last one to the sensor; `cell` the edges of the cell of equal lenses. For the others see
    `fill_thin_forward`.
    """
    place = np.empty(PLACE * BLOCK)
    bow, mu = (1.0 if curved_first else -1.0) / (index - 1.0), 1.0 / index if curved_first else index
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        _to_plane(ray, z_front)
        if not curved_first:
            refract_sphere(ray, 0.0, 1.0 / index, None, math.inf, math.inf, 1.0, 0.0)
            _to_plane(ray, thickness)
        if lattice is None:
            _refract_curved(ray, place, bow * power, mu, flat, origin, basis, inverse, cell)
        else:
            _refract_curved_each(ray, place, bow, mu, curved_first, flat, clear, edges, radius2, cells, lenses, lattice)
        if curved_first:
            for i in range(BLOCK):
                ray[Z + i] -= thickness
            refract_sphere(ray, 0.0, index, None, math.inf, math.inf, 1.0, 0.0)
        _land(ray, distance, lean, sensor, place, walls)
