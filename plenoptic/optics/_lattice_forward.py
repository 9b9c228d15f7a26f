"""Rays from the main lens through the microlenses onto the sensor: the kernels for light that travels forwards.

On entry blocks hold rays as `_trace` leaves them. On exit X, Y is where a ray meets the sensor, Z, N is the centre of
the microlens that it passed, and L, M are the slopes with which it arrives.

WEIGHT is etendue, area times projected solid angle. With slopes u, v per length of z and the angle a to the axis, it is
dx dy du dv cos^4 a. Free space and true refraction keep it. Ideal thin elements keep dx dy du dv instead, since they
only shear the slopes by the height: there the weight is multiplied by cos^4 after over cos^4 before. It then is the
etendue at the sensor, which is what a pixel measures.
"""

from __future__ import annotations

import math

import numpy as np

from plenoptic._jit import device, kernel
from plenoptic.optics._blocks import BLOCK, OUTSIDE_MICROLENS, RAY, STATUS, WEIGHT, L, M, N, X, Y, Z
from plenoptic.optics._lattice import refract_flat_block
from plenoptic.optics._trace import refract_block

_TRIES = 6
"""Cells in which a ray is looked for; all but rays along the surface are found in the first or second."""


@device
def nearest_centre(x, y, basis, inverse):
    """The lattice point nearest to (x, y): one corner of the mesh that holds the point."""
    i0 = math.floor(x * inverse[0, 0] + y * inverse[1, 0])
    j0 = math.floor(x * inverse[0, 1] + y * inverse[1, 1])
    best, best_x, best_y = math.inf, 0.0, 0.0
    for step in range(4):
        i, j = i0 + (step & 1), j0 + (step >> 1)
        cx = i * basis[0, 0] + j * basis[1, 0]
        cy = i * basis[0, 1] + j * basis[1, 1]
        far = (x - cx) * (x - cx) + (y - cy) * (y - cy)
        if far < best:
            best, best_x, best_y = far, cx, cy
    return best_x, best_y


@device
def _meets_sphere(x, y, l, m, n, c):
    """Where a ray from (x, y, 0) meets a sphere of curvature c whose vertex is the origin; see `_trace`."""
    e = -(x * l + y * m)
    px, py, pz = x + e * l, y + e * m, e * n
    f = c * (px * px + py * py + pz * pz) - 2.0 * pz
    g = n - c * (px * l + py * m + pz * n)
    t = f / (g + math.sqrt(max(g * g - c * f, 0.0)))
    return px + t * l, py + t * m


@device
def _to_plane(ray, z):
    """Move rays along themselves to a plane and measure z from there."""
    for i in range(BLOCK):
        t = (z - ray[Z + i]) / ray[N + i]
        ray[X + i] += t * ray[L + i]
        ray[Y + i] += t * ray[M + i]
        ray[Z + i] = 0.0


@device
def _find_cells(ray, centres, c, basis, inverse):
    """Centres of the cells in which rays from the plane z = 0 meet the spheres of curvature c.

    The spheres of neighbouring cells meet at the edge between them, so that their caps are one surface, which a ray
    less steep than the surface meets once. A ray that meets the sphere of one cell beyond its edge meets that of the
    next cell there, or passes on over it.
    """
    for i in range(BLOCK):
        cx = cy = 0.0
        if ray[STATUS + i] == 0.0:
            x, y = ray[X + i], ray[Y + i]
            l, m, n = ray[L + i], ray[M + i], ray[N + i]
            cx, cy = nearest_centre(x, y, basis, inverse)
            if c != 0.0:
                for _ in range(_TRIES):
                    hit_x, hit_y = _meets_sphere(x - cx, y - cy, l, m, n, c)
                    next_x, next_y = nearest_centre(cx + hit_x, cy + hit_y, basis, inverse)
                    if next_x == cx and next_y == cy:
                        break
                    cx, cy = next_x, next_y
        centres[i] = cx
        centres[BLOCK + i] = cy


@device
def _shift(ray, centres, sign):
    for i in range(BLOCK):
        ray[X + i] += sign * centres[i]
        ray[Y + i] += sign * centres[BLOCK + i]


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
def _refract_curved(ray, centres, c, mu, flat, basis, inverse, edges):
    """Through the curved side, whose vertices lie in z = 0, in the cell where each ray meets it."""
    _to_plane(ray, 0.0)
    _find_cells(ray, centres, 0.0 if flat else c, basis, inverse)
    _shift(ray, centres, -1.0)
    if flat:
        _weigh_tilt(ray, c, False)
        refract_flat_block(ray, c, mu, 1.0)
        _weigh_tilt(ray, c, True)
    else:
        refract_block(ray, c, mu, math.inf, math.inf, 1.0, 0.0)
        _keep_inside(ray, edges)
    _shift(ray, centres, 1.0)


@device
def _land(ray, z, centres):
    """Move rays to the sensor at z; keep the centres of their microlenses. What is lost carries nothing."""
    for i in range(BLOCK):
        n = ray[N + i]
        u, v = ray[L + i] / n, ray[M + i] / n
        ray[X + i] += (z - ray[Z + i]) * u
        ray[Y + i] += (z - ray[Z + i]) * v
        ray[L + i] = u
        ray[M + i] = v
        ray[Z + i] = centres[i]
        ray[N + i] = centres[BLOCK + i]
        ray[WEIGHT + i] = ray[WEIGHT + i] if ray[STATUS + i] == 0.0 else 0.0


@kernel
def fill_ideal_weights(blocks):
    """Behind an ideal main lens: dx dy du dv, which it keeps, becomes etendue."""
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        for i in range(BLOCK):
            cos2 = ray[N + i] * ray[N + i]
            ray[WEIGHT + i] *= cos2 * cos2


@kernel
def fill_straight_forward(blocks, z_sensor):
    """No microlenses."""
    centres = np.zeros(2 * BLOCK)
    for b in range(blocks.size // RAY):
        _land(blocks[b * RAY : (b + 1) * RAY], z_sensor, centres)


@kernel
def fill_thin_forward(blocks, z_array, distance, power, basis, inverse):
    """Ideal thin lenses: slopes change by height over focal length (power = 1/f)."""
    centres = np.empty(2 * BLOCK)
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        _to_plane(ray, z_array)
        _find_cells(ray, centres, 0.0, basis, inverse)
        for i in range(BLOCK):
            before = ray[N + i]
            u = ray[L + i] / before - (ray[X + i] - centres[i]) * power
            v = ray[M + i] / before - (ray[Y + i] - centres[BLOCK + i]) * power
            after = 1.0 / math.sqrt(1.0 + u * u + v * v)
            share = (after * after) / (before * before)
            ray[WEIGHT + i] *= share * share
            ray[L + i] = u * after
            ray[M + i] = v * after
            ray[N + i] = after
        _land(ray, distance, centres)


@kernel
def fill_plano_convex_forward(
    blocks, z_front, curved_first, flat, curvature, thickness, index, z_sensor, basis, inverse, edges
):
    """Plano-convex lenses: a plane and a sphere of the given (signed) curvature, or a plane with its normals (`flat`).

    `curved_first`: the curved side faces the scene. `z_front` is the vertex that light meets first and `z_sensor` the
    distance from there to the sensor; `edges` the cell's edge normals and distances from its centre.
    """
    centres = np.empty(2 * BLOCK)
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        _to_plane(ray, z_front)
        if curved_first:
            _refract_curved(ray, centres, curvature, 1.0 / index, flat, basis, inverse, edges)
        else:
            refract_block(ray, 0.0, 1.0 / index, math.inf, math.inf, 1.0, 0.0)
        for i in range(BLOCK):
            ray[Z + i] -= thickness
        if curved_first:
            refract_block(ray, 0.0, index, math.inf, math.inf, 1.0, 0.0)
        else:
            _refract_curved(ray, centres, curvature, index, flat, basis, inverse, edges)
        _land(ray, z_sensor - thickness, centres)
