"""Rays through one microlens each: the kernels between sensor and main lens.

On entry a block of rays (see `trace`) holds, for each ray, the point on the array's rear principal plane
at which it is aimed (X, Y), that point minus the point on the sensor (L, M), the centre of the microlens
(Z, N) and the area that the sample stands for (WEIGHT). On exit it holds rays as `trace` wants them,
travelling towards the scene, and WEIGHT is the projected solid angle that the sample stands for.
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
from plenoptic.optics.lens.kernels.frames import out_of_frame
from plenoptic.optics.lens.kernels.sphere import refract_sphere

LANE = 8
"""Numbers that a path keeps of its microlens where lenses differ or have openings of their own (see below)."""

POWER, CENTRE_X, CENTRE_Y, CELL_X, CELL_Y, CLIP, TRANSMISSION, NUMBER = range(LANE)
"""1 / focal length in 1/mm; centre of the opening; that of the cell; 1 for paths that must pass inside the opening, -1
for those that must pass beside it, 0 for those that need not; what part of the light passes; row of the list of lenses,
or -1."""


@device
def distance_to_sensor(ray, i, distance, lean):
    """From the array's rear principal plane to the sensor, where path i starts: a plane, maybe a tilted one."""
    if lean is None:
        return distance
    return distance + lean[0] * (ray[X + i] - ray[L + i]) + lean[1] * (ray[Y + i] - ray[M + i])


@device
def _weigh(ray, distance, lean):
    """Projected solid angle at the sensor of a piece of the array's plane: area cos cos / length^2."""
    if lean is None:
        d2 = distance * distance
        for i in range(BLOCK):
            r2 = ray[L + i] * ray[L + i] + ray[M + i] * ray[M + i] + d2
            ray[WEIGHT + i] *= d2 / (r2 * r2)
    else:
        scale = 1.0 / math.sqrt(1.0 + lean[0] * lean[0] + lean[1] * lean[1])
        for i in range(BLOCK):
            l, m, h = ray[L + i], ray[M + i], distance_to_sensor(ray, i, distance, lean)
            r2 = l * l + m * m + h * h
            ray[WEIGHT + i] *= h * scale * max(h + lean[0] * l + lean[1] * m, 0.0) / (r2 * r2)


@kernel
def fill_pixel_response(blocks, distance, lean, frame, well_depth, index, inverse_pupil, exponent):
    """Multiply the weights of aimed samples by the pixel's response to their direction; see `AngularResponse.at`.

    `frame` is the rotation, row by row, and the shift from the sensor's axes to the local ones, None where the sensor
    is centred and parallel to the array.
    """
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        for i in range(BLOCK):
            u, v, w = ray[L + i], ray[M + i], distance_to_sensor(ray, i, distance, lean)
            x, y = ray[X + i] - u, ray[Y + i] - v
            if frame is not None:
                # The way towards the lens is -w along the local axis, where the sensor's points lie at +w.
                px, py, pz = x - frame[9], y - frame[10], w - frame[11]
                x = frame[0] * px + frame[3] * py + frame[6] * pz
                y = frame[1] * px + frame[4] * py + frame[7] * pz
                u, v, w = (
                    frame[0] * u + frame[3] * v - frame[6] * w,
                    frame[1] * u + frame[4] * v - frame[7] * w,
                    -(frame[2] * u + frame[5] * v - frame[8] * w),
                )
            cos2 = w * w / (u * u + v * v + w * w)
            chief_x, chief_y = -x * inverse_pupil, -y * inverse_pupil
            chief_cos2 = 1.0 / (1.0 + chief_x * chief_x + chief_y * chief_y)
            bend = math.sqrt(cos2 / (index * index - 1.0 + cos2)) / w
            chief_bend = math.sqrt(chief_cos2 / (index * index - 1.0 + chief_cos2))
            open_x = max(1.0 - well_depth * abs(u * bend - chief_x * chief_bend), 0.0)
            open_y = max(1.0 - well_depth * abs(v * bend - chief_y * chief_bend), 0.0)
            ray[WEIGHT + i] *= open_x * open_y * math.sqrt(cos2) ** exponent


@kernel
def fill_straight(blocks, distance, lean, z_plane):
    """No microlenses: rays from the sensor straight through points of a plane at z_plane."""
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        _weigh(ray, distance, lean)
        for i in range(BLOCK):
            h = distance_to_sensor(ray, i, distance, lean)
            u, v = ray[L + i] / h, ray[M + i] / h
            n = 1.0 / math.sqrt(1.0 + u * u + v * v)
            ray[Z + i] = z_plane
            ray[L + i] = u * n
            ray[M + i] = v * n
            ray[N + i] = -n


@kernel
def fill_openings(blocks, lanes, radius2, edges):
    """Keep the paths that are aimed inside their microlens's opening, or beside it; dim those of dark lenses.

    An opening is a circle of squared radius `radius2` and the inside of `edges` (k, 3), about the lens's centre.
    """
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        for i in range(BLOCK):
            lane = lanes[b * BLOCK + i]
            x, y = ray[X + i] - lane[CENTRE_X], ray[Y + i] - lane[CENTRE_Y]
            ray[WEIGHT + i] *= lane[TRANSMISSION]
            if lane[CLIP] != 0.0 and _is_open(x, y, radius2, edges) != (lane[CLIP] > 0.0):
                ray[STATUS + i] = OUTSIDE_MICROLENS if ray[STATUS + i] == 0.0 else ray[STATUS + i]


@kernel
def fill_walls(blocks, lanes, cell, cells):
    """Lose the paths that start on the sensor outside the cell, seen along the axis, of their microlens.

    `cell` are the edges of a cell about its centre, `cells` those of each listed lens, or None.
    """
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        for i in range(BLOCK):
            lane = lanes[b * BLOCK + i]
            x, y = ray[X + i] - ray[L + i] - lane[CELL_X], ray[Y + i] - ray[M + i] - lane[CELL_Y]
            own = cell if cells is None else cells[int(lane[NUMBER])]
            if ray[STATUS + i] == 0.0 and not _is_open(x, y, math.inf, own):
                ray[STATUS + i] = OUTSIDE_MICROLENS


@device
def _is_open(x, y, radius2, edges):
    inside = x * x + y * y <= radius2
    for k in range(edges.shape[0]):
        inside = inside and edges[k, 0] * x + edges[k, 1] * y <= edges[k, 2]
    return inside


@kernel
def fill_thin(blocks, distance, lean, power, lanes, z_plane):
    """Ideal thin lenses: slopes change by height over focal length (power = 1/f, or that of each lane)."""
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        _weigh(ray, distance, lean)
        for i in range(BLOCK):
            bend = power if lanes is None else lanes[b * BLOCK + i, POWER]
            h = distance_to_sensor(ray, i, distance, lean)
            u = ray[L + i] / h - (ray[X + i] - ray[Z + i]) * bend
            v = ray[M + i] / h - (ray[Y + i] - ray[N + i]) * bend
            n = 1.0 / math.sqrt(1.0 + u * u + v * v)
            ray[Z + i] = z_plane
            ray[L + i] = u * n
            ray[M + i] = v * n
            ray[N + i] = -n


@kernel
def fill_pinholes(blocks, distance, lean, z_plane):
    """Pinholes: rays from the sensor straight through the centres of the cells in which they were aimed."""
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        _weigh(ray, distance, lean)
        for i in range(BLOCK):
            h = distance_to_sensor(ray, i, distance, lean)
            # The point aimed at less what leads there from the sensor is the point on the sensor.
            u = (ray[Z + i] - (ray[X + i] - ray[L + i])) / h
            v = (ray[N + i] - (ray[Y + i] - ray[M + i])) / h
            n = 1.0 / math.sqrt(1.0 + u * u + v * v)
            ray[X + i] = ray[Z + i]
            ray[Y + i] = ray[N + i]
            ray[Z + i] = z_plane
            ray[L + i] = u * n
            ray[M + i] = v * n
            ray[N + i] = -n


@device
def refract_flat_block(ray, c, mu, s):
    """Through a plane with the normals of a sphere of curvature c, taken at the same distance from the axis."""
    bend = 1.0 - mu * mu
    for i in range(BLOCK):
        l, m, n = ray[L + i], ray[M + i], ray[N + i]
        t = -ray[Z + i] / n
        x = ray[X + i] + t * l
        y = ray[Y + i] + t * m
        up = 1.0 - c * c * (x * x + y * y)
        nx, ny, nz = -c * x, -c * y, math.sqrt(max(up, 0.0))
        cos_i = s * (nx * l + ny * m + nz * n)
        cos2 = 1.0 - mu * mu * (1.0 - cos_i * cos_i)
        cos_t = math.sqrt(max(cos2, 0.0))
        a = s * (bend / (cos_t + mu * cos_i))
        ray[X + i] = x
        ray[Y + i] = y
        ray[Z + i] = 0.0
        ray[L + i] = mu * l + a * nx
        ray[M + i] = mu * m + a * ny
        ray[N + i] = mu * n + a * nz
        lost = 0.0 if cos2 >= 0.0 else TOTAL_REFLECTION
        lost = lost if up >= 0.0 and cos_i > 0.0 else MISSED
        was = ray[STATUS + i]
        ray[STATUS + i] = was if was != 0.0 else lost


@device
def _keep_inside(ray, cell, cells, edges, radius2, lanes, b, centre):
    """Status of rays that meet the curved surface outside their own cell or opening.

    x, y are from the optical axis, `centre` holds the axes. `cell` are the edges of a cell, or `cells` those of each
    listed lens; `edges` and `radius2` end the openings.
    """
    if lanes is None:
        for k in range(cell.shape[0]):
            nx, ny, apothem = cell[k, 0], cell[k, 1], cell[k, 2]
            for i in range(BLOCK):
                inside = nx * ray[X + i] + ny * ray[Y + i] <= apothem
                was = ray[STATUS + i]
                ray[STATUS + i] = was if was != 0.0 or inside else OUTSIDE_MICROLENS
    else:
        for i in range(BLOCK):
            lane = lanes[b * BLOCK + i]
            x = ray[X + i] + centre[i] - lane[CENTRE_X]
            y = ray[Y + i] + centre[BLOCK + i] - lane[CENTRE_Y]
            inside = lane[CLIP] == 0.0 or _is_open(x, y, radius2, edges) == (lane[CLIP] > 0.0)
            x, y = x + lane[CENTRE_X] - lane[CELL_X], y + lane[CENTRE_Y] - lane[CELL_Y]
            own = cell if cells is None else cells[int(lane[NUMBER])]
            inside = inside and _is_open(x, y, math.inf, own)
            was = ray[STATUS + i]
            ray[STATUS + i] = was if was != 0.0 or inside else OUTSIDE_MICROLENS


@device
def refract_lanes_block(ray, lanes, b, flat, sign, ratio, index_scale):
    """Through the curved sides of lenses that differ: curvature sign * power * index_scale, ray by ray."""
    bend = 1.0 - ratio * ratio
    for i in range(BLOCK):
        c = sign * lanes[b * BLOCK + i, POWER] * index_scale
        x, y, z = ray[X + i], ray[Y + i], ray[Z + i]
        l, m, n = ray[L + i], ray[M + i], ray[N + i]
        if flat:
            t = -z / n
            x, y, z = x + t * l, y + t * m, 0.0
            up = 1.0 - c * c * (x * x + y * y)
            nx, ny, nz = -c * x, -c * y, math.sqrt(max(up, 0.0))
            q = -(nx * l + ny * m + nz * n)
            q2 = up if q > 0.0 else -1.0
        else:
            # As in `sphere.refract_sphere`, towards the scene.
            e = -(x * l + y * m + z * n)
            x, y, z = x + e * l, y + e * m, z + e * n
            f = c * (x * x + y * y + z * z) - 2.0 * z
            g = n - c * (x * l + y * m + z * n)
            q2 = g * g - c * f
            q = math.sqrt(max(q2, 0.0))
            t = f / (g - q) if g <= 0.0 else (g + q) / c
            x, y, z = x + t * l, y + t * m, z + t * n
            nx, ny, nz = -c * x, -c * y, 1.0 - c * z
            q2 = q2 if nz > 0.0 else -1.0
        cos2 = 1.0 - ratio * ratio * (1.0 - q * q)
        a = -(bend / (math.sqrt(max(cos2, 0.0)) + ratio * q))
        ray[X + i] = x
        ray[Y + i] = y
        ray[Z + i] = z
        ray[L + i] = ratio * l + a * nx
        ray[M + i] = ratio * m + a * ny
        ray[N + i] = ratio * n + a * nz
        lost = 0.0 if cos2 >= 0.0 else TOTAL_REFLECTION
        lost = lost if q2 > 0.0 else MISSED
        was = ray[STATUS + i]
        ray[STATUS + i] = was if was != 0.0 else lost


@device
def _refract_curved(ray, power, lanes, b, flat, sign, ratio, index_scale):
    """Through the curved side, or through the plane that stands for it."""
    if lanes is not None:
        refract_lanes_block(ray, lanes, b, flat, sign, ratio, index_scale)
    elif flat:
        refract_flat_block(ray, sign * power * index_scale, ratio, -1.0)
    else:
        refract_sphere(ray, sign * power * index_scale, ratio, None, math.inf, math.inf, -1.0, 0.0)


@kernel
def fill_plano_convex(
    blocks,
    distance,
    lean,
    z_array,
    curved_first,
    flat,
    power,
    lanes,
    thickness,
    index,
    cell,
    cells,
    edges,
    radius2,
):
    """Plano-convex lenses: a plane and a sphere of radius (index - 1) / power.

    `curved_first`: the curved side faces the sensor, so that light travelling in reverse meets it first. `flat`: the
    sphere gives its normals only. `z_array` is the front principal plane; for `cell` to `radius2` see `_keep_inside`.
    """
    centre = np.empty(2 * BLOCK)
    scale = 1.0 / (index - 1.0)
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        _weigh(ray, distance, lean)
        # Heights from the lens's own axis, z from the first vertex in the order of travel.
        for i in range(BLOCK):
            h = distance_to_sensor(ray, i, distance, lean)
            cx, cy = ray[Z + i], ray[N + i]
            centre[i] = cx
            centre[BLOCK + i] = cy
            u, v = ray[L + i], ray[M + i]
            n = 1.0 / math.sqrt(u * u + v * v + h * h)
            ray[X + i] = ray[X + i] - u - cx
            ray[Y + i] = ray[Y + i] - v - cy
            ray[Z + i] = h if curved_first else h - thickness / index
            ray[L + i] = u * n
            ray[M + i] = v * n
            ray[N + i] = -h * n
        if curved_first:
            _refract_curved(ray, power, lanes, b, flat, -1.0, 1.0 / index, scale)
            _keep_inside(ray, cell, cells, edges, radius2, lanes, b, centre)
        else:
            refract_sphere(ray, 0.0, 1.0 / index, None, math.inf, math.inf, -1.0, 0.0)
        for i in range(BLOCK):
            ray[Z + i] += thickness
        if curved_first:
            refract_sphere(ray, 0.0, index, None, math.inf, math.inf, -1.0, 0.0)
        else:
            _refract_curved(ray, power, lanes, b, flat, 1.0, index, scale)
            _keep_inside(ray, cell, cells, edges, radius2, lanes, b, centre)
        # Vertex met last: the front vertex, from which the front principal plane lies 0 or thickness/index.
        z_front = z_array - (thickness / index if curved_first else 0.0)
        for i in range(BLOCK):
            ray[X + i] += centre[i]
            ray[Y + i] += centre[BLOCK + i]
            ray[Z + i] += z_front
            if lanes is not None:
                ray[WEIGHT + i] *= lanes[b * BLOCK + i, TRANSMISSION]


@kernel
def fill_in_lens_axes(blocks, frame):
    """Rays from the array's axes to the lens's: `frame` is the rotation row by row and the shift."""
    for b in range(blocks.size // RAY):
        out_of_frame(blocks[b * RAY : (b + 1) * RAY], frame)
