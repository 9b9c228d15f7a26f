"""Aimed samples on their way from the sensor through the microlenses towards the main lens: kernels.

An aimed sample in a block of rays (see `trace`) has its aim point on the array's rear principal plane in X, Y. L, M is
the offset of that point from the point on the sensor, Z, N the optical axis of the microlens, and WEIGHT the area that
the sample represents. The kernels of the models turn it into a ray as `trace` expects it, towards the scene, whose
WEIGHT is the projected solid angle represented by the sample.

The sensor is a `SensorPlane`. `lenslets` are rows of `MICROLENS`, one for each path, if lenses differ or have their own
openings, otherwise None.
"""

from __future__ import annotations

import math

from plenoptic.core.kernels.ray_blocks import BLOCK, OUTSIDE_MICROLENS, RAY, STATUS, WEIGHT, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import device, kernel
from plenoptic.optics.lens.kernels.frames import out_of_frame
from plenoptic.optics.sensor.dual_pixels import INDEX2


@device
def distance_to_sensor(ray, i, distance, tilt):
    """Distance from the array's rear principal plane to the sensor, which may be tilted, at the start of path i."""
    if tilt is None:
        return distance
    return distance + tilt[0] * (ray[X + i] - ray[L + i]) + tilt[1] * (ray[Y + i] - ray[M + i])


@device
def weigh(ray, distance, tilt):
    """Projected solid angle at the sensor of an area of the array's plane: area cos cos / length^2."""
    if tilt is None:
        d2 = distance * distance
        for i in range(BLOCK):
            r2 = ray[L + i] * ray[L + i] + ray[M + i] * ray[M + i] + d2
            ray[WEIGHT + i] *= d2 / (r2 * r2)
    else:
        scale = 1.0 / math.sqrt(1.0 + tilt[0] * tilt[0] + tilt[1] * tilt[1])
        for i in range(BLOCK):
            l, m, h = ray[L + i], ray[M + i], distance_to_sensor(ray, i, distance, tilt)
            r2 = l * l + m * m + h * h
            ray[WEIGHT + i] *= h * scale * max(h + tilt[0] * l + tilt[1] * m, 0.0) / (r2 * r2)


@device
def at_wavelength(values, waves, path):
    """Value of a path: values[0] at the camera's wavelength (`waves` None), or that at the path's wavelength."""
    if waves is None:
        return values[0]
    return values[waves[path] + 1]


@device
def launch(ray, i, slopes, z):
    """Start ray i towards the scene from a plane, with slopes per length of -z."""
    u, v = slopes
    n = 1.0 / math.sqrt(1.0 + u * u + v * v)
    ray[Z + i] = z
    ray[L + i] = u * n
    ray[M + i] = v * n
    ray[N + i] = -n


@device
def is_open(x, y, radius2, edges):
    """True if a point lies in the circle of squared radius `radius2` and inside all `edges` (k, 3)."""
    inside = x * x + y * y <= radius2
    for k in range(edges.shape[0]):
        inside = inside and edges[k, 0] * x + edges[k, 1] * y <= edges[k, 2]
    return inside


@device
def in_sensor_axes(ray, i, sensor, frame):
    """Point on the sensor at which path i starts, and its direction (u, v, -w) towards the lens, in the sensor's axes.

    `frame` leads from the sensor's axes to the local ones; None if these are the same.
    """
    u, v, w = ray[L + i], ray[M + i], distance_to_sensor(ray, i, sensor.distance, sensor.tilt)
    x, y = ray[X + i] - u, ray[Y + i] - v
    if frame is not None:
        # The direction towards the lens is -w along the local axis, where points of the sensor are at +w.
        px, py, pz = x - frame[9], y - frame[10], w - frame[11]
        x = frame[0] * px + frame[3] * py + frame[6] * pz
        y = frame[1] * px + frame[4] * py + frame[7] * pz
        u, v, w = (
            frame[0] * u + frame[3] * v - frame[6] * w,
            frame[1] * u + frame[4] * v - frame[7] * w,
            -(frame[2] * u + frame[5] * v - frame[8] * w),
        )
    return (x, y), (u, v, w)


@kernel
def fill_pixel_response(blocks, sensor, response):
    """Multiply the weights of aimed samples by the pixel's response to their direction; see `AngularResponse.at`."""
    index, well_depth, inverse_pupil = response.refractive_index, response.well_depth, response.inverse_pupil
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        for i in range(BLOCK):
            (x, y), (u, v, w) = in_sensor_axes(ray, i, sensor, response.frame)
            cos2 = w * w / (u * u + v * v + w * w)
            chief_x, chief_y = -x * inverse_pupil, -y * inverse_pupil
            chief_cos2 = 1.0 / (1.0 + chief_x * chief_x + chief_y * chief_y)
            scale = math.sqrt(cos2 / (index * index - 1.0 + cos2)) / w
            chief_scale = math.sqrt(chief_cos2 / (index * index - 1.0 + chief_cos2))
            open_x = max(1.0 - well_depth * abs(u * scale - chief_x * chief_scale), 0.0)
            open_y = max(1.0 - well_depth * abs(v * scale - chief_y * chief_scale), 0.0)
            ray[WEIGHT + i] *= open_x * open_y * math.sqrt(cos2) ** response.exponent


@device
def _is_in_wells(place, wells):
    inside = False
    for k in range(wells.shape[0]):
        inside = inside or wells[k, 0] <= place < wells[k, 1]
    return inside


@device
def slope_in_stack(slope, other):
    """Slope between on-chip lens and wells; see `DualPixels`."""
    return slope / math.sqrt(INDEX2 + (INDEX2 - 1.0) * (slope * slope + other * other))


@device
def _table_response(angle, table):
    """`np.interp` in a table (n, 2), which would allocate arrays for each ray."""
    if angle <= table[0, 0]:
        return table[0, 1]
    low, high = 0, table.shape[0] - 1
    if angle >= table[high, 0]:
        return table[high, 1]
    while high - low > 1:
        middle = (low + high) // 2
        if table[middle, 0] <= angle:
            low = middle
        else:
            high = middle
    slope = (table[high, 1] - table[low, 1]) / (table[high, 0] - table[low, 0])
    return slope * (angle - table[low, 0]) + table[low, 1]


@kernel
def fill_well_response(blocks, sensor, wells):
    """Multiply the weights of aimed samples by the response of the wells that are read; see `DualPixels`."""
    depth, inverse_pupil = wells.depth, wells.inverse_pupil
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        for i in range(BLOCK):
            (x, y), (u, v, w) = in_sensor_axes(ray, i, sensor, wells.frame)
            slope_x, slope_y = u / w, v / w
            chief_x, chief_y = -x * inverse_pupil, -y * inverse_pupil
            if wells.table is not None:
                angle = math.atan(slope_x) - math.atan(chief_x)
                ray[WEIGHT + i] *= _table_response(angle, wells.table)
            else:
                across = depth * (slope_in_stack(slope_x, slope_y) - slope_in_stack(chief_x, chief_y))
                down = -depth * (slope_in_stack(slope_y, slope_x) - slope_in_stack(chief_y, chief_x))
                if not (_is_in_wells(across, wells.columns) and _is_in_wells(down, wells.rows)):
                    ray[WEIGHT + i] = 0.0


@kernel
def fill_weights(blocks, sensor):
    """Weigh aimed samples without tracing rays."""
    for b in range(blocks.size // RAY):
        weigh(blocks[b * RAY : (b + 1) * RAY], sensor.distance, sensor.tilt)


@kernel
def fill_straight(blocks, sensor, z_plane):
    """Trace rays from the sensor straight through points of a plane at z_plane, without microlenses."""
    distance = sensor.distance
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        weigh(ray, distance, sensor.tilt)
        for i in range(BLOCK):
            h = distance_to_sensor(ray, i, distance, sensor.tilt)
            launch(ray, i, (ray[L + i] / h, ray[M + i] / h), z_plane)


@kernel
def fill_openings(blocks, lenslets, opening):
    """Lose paths that are aimed outside of their opening, or outside of the gap; attenuate paths of dark lenses."""
    radius2, edges = opening.radius2, opening.edges
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        for i in range(BLOCK):
            lens = lenslets[b * BLOCK + i]
            x, y = ray[X + i] - lens.centre_x, ray[Y + i] - lens.centre_y
            ray[WEIGHT + i] *= lens.transmission
            if lens.clip != 0.0 and is_open(x, y, radius2, edges) != (lens.clip > 0.0):
                ray[STATUS + i] = OUTSIDE_MICROLENS if ray[STATUS + i] == 0.0 else ray[STATUS + i]


@kernel
def fill_walls(blocks, lenslets, cell, cells):
    """Lose paths that start on the sensor outside of the cell of their microlens, projected along the axis.

    `cell` are the edges of a cell about its centre, `cells` those of each lens of the table, or None.
    """
    for b in range(blocks.size // RAY):
        ray = blocks[b * RAY : (b + 1) * RAY]
        for i in range(BLOCK):
            lens = lenslets[b * BLOCK + i]
            x, y = ray[X + i] - ray[L + i] - lens.cell_x, ray[Y + i] - ray[M + i] - lens.cell_y
            edges = cell if cells is None else cells[lens.row]
            if ray[STATUS + i] == 0.0 and not is_open(x, y, math.inf, edges):
                ray[STATUS + i] = OUTSIDE_MICROLENS


@kernel
def fill_in_lens_axes(blocks, frame):
    """Transform rays from the array's axes to the lens's: `frame` is the rotation row by row and the shift."""
    for b in range(blocks.size // RAY):
        out_of_frame(blocks[b * RAY : (b + 1) * RAY], frame)
