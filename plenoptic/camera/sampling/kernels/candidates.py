"""Microlenses that may illuminate a group of pixels: the kernels.

The opening of each microlens near a group is clipped with bounds on the exit pupil, mapped back through the microlens
from the group. The map is affine in the thin-lens limit; margins cover thick and tilted microlenses. The result is a
convex polygon.
"""

from __future__ import annotations

import math

import numpy as np

from plenoptic.camera.sampling.kernels.well_bounds import clip_to_wells
from plenoptic.core.kernels.polygons import cut
from plenoptic.core.numba.jit import device, kernel
from plenoptic.optics.microlens.kernels.cell_lookup import in_extent
from plenoptic.optics.microlens.kernels.lens_table import bins_around

_MOST_CORNERS = 64


@device
def _store(candidates, corners, counts, polygon, n, centres, disconnected):
    """Append a candidate, if there is room, and count it and its corners; `centres` are those of cell and axis."""
    at, end = counts
    if at < candidates.rows.size and end + n <= corners.shape[1]:
        candidate = candidates.rows[at]
        (candidate.cell_x, candidate.cell_y), (candidate.axis_x, candidate.axis_y) = centres
        candidate.first_corner, candidate.corners, candidate.disconnected = end, n, 1 if disconnected else 0
        candidate.first_transfer, candidate.transfers, candidate.complete, candidate.slack = 0, 0, 0, math.inf
        for q in range(n):
            corners[0, end + q], corners[1, end + q] = polygon[0, q], polygon[1, q]
        set_box(candidate, polygon, n)
    counts[0], counts[1] = at + 1, end + n


@device
def set_box(candidate, polygon, n):
    """Set the bounding box of a candidate's polygon."""
    left, right, low, high = math.inf, -math.inf, math.inf, -math.inf
    for q in range(n):
        left, right = min(left, polygon[0, q]), max(right, polygon[0, q])
        low, high = min(low, polygon[1, q]), max(high, polygon[1, q])
    candidate.x, candidate.y = 0.5 * (left + right), 0.5 * (low + high)
    candidate.half_x, candidate.half_y = 0.5 * (right - left), 0.5 * (high - low)


@device
def crossing(point, start, lens, per_h, pinhole, plane):
    """Intersection with the outline plane of a ray from a sensor point through a point of an ideal microlens.

    `lens` is the optical axis x, y and the power, 1 / per_h the distance to the sensor. `plane` holds the distance to
    the plane of the outlines or, with a frame to the lens's axes, its position in these.
    """
    mx, my = point
    sx, sy = start
    ox, oy, power = lens
    if pinhole:
        u, v = (ox - sx) * per_h, (oy - sy) * per_h
        mx, my = ox, oy
    else:
        u, v = (mx - sx) * per_h - (mx - ox) * power, (my - sy) * per_h - (my - oy) * power
    if plane.frame is None:
        return mx + plane.distance * u, my + plane.distance * v
    frame = plane.frame
    z = frame[6] * mx + frame[7] * my + frame[11]
    t = (plane.distance - z) / (frame[6] * u + frame[7] * v - frame[8])
    return (
        frame[0] * mx + frame[1] * my + frame[9] + t * (frame[0] * u + frame[1] * v - frame[2]),
        frame[3] * mx + frame[4] * my + frame[10] + t * (frame[3] * u + frame[4] * v - frame[5]),
    )


@device
def polar(x, y, frame):
    """Polar coordinates about the lens's axis: radius, cosine and sine of the azimuth; `frame` leads to its axes."""
    fx, fy = x, y
    if frame is not None:
        fx = frame[0] * x + frame[1] * y + frame[9]
        fy = frame[3] * x + frame[4] * y + frame[10]
    rho = math.hypot(fx, fy)
    return rho, (fx / rho, fy / rho) if rho > 0.0 else (1.0, 0.0)


@device
def _cell_derivatives(centre, at, start, lens, per_h, pinhole, plane, radius):
    """Jacobian of the crossing `at` with respect to the point in the cell, row by row."""
    if plane.frame is None:
        height_factor = 0.0 if pinhole else 1.0 + plane.distance * (per_h - lens[2])
        return height_factor, 0.0, 0.0, height_factor
    ax, ay = crossing((centre[0] + radius, centre[1]), start, lens, per_h, pinhole, plane)
    bx, by = crossing((centre[0], centre[1] + radius), start, lens, per_h, pinhole, plane)
    return (ax - at[0]) / radius, (bx - at[0]) / radius, (ay - at[1]) / radius, (by - at[1]) / radius


@device
def _cut_opening(polygon, opening, at, derivatives, extent, azimuth, normals, support):
    """Clip an opening with the outline of the pupil; return its number of corners.

    A ray through the point d of the opening crosses the outline's plane at q + J d, at most `spread` from q; `extent`
    is the spread and a margin. `azimuth` is the cosine and sine of the cell's azimuth, the direction of the outline's
    first axis. The outline's sides have `normals`, and `support` is their distance from the axis.
    """
    qx, qy = at
    jxx, jxy, jyx, jyy = derivatives
    cos, sin = azimuth
    spread, margin = extent
    tx, ty = cos * qx + sin * qy, cos * qy - sin * qx
    n = -1
    for k in range(normals.shape[0]):
        limit = support[k] + margin - (normals[k, 0] * tx + normals[k, 1] * ty)
        if limit >= spread:
            continue
        if limit < -spread:
            return 0
        if n < 0:
            n = opening.shape[0]
            for q in range(n):
                polygon[0, q], polygon[1, q] = opening[q, 0], opening[q, 1]
        # The side's normal, turned back.
        ux, uy = cos * normals[k, 0] - sin * normals[k, 1], sin * normals[k, 0] + cos * normals[k, 1]
        n = cut(polygon, 0, n, jxx * ux + jyx * uy, jxy * ux + jyy * uy, limit)
        if n == 0:
            return 0
    if n < 0:
        n = opening.shape[0]
        for q in range(n):
            polygon[0, q], polygon[1, q] = opening[q, 0], opening[q, 1]
    return n


@device
def _is_behind_wall(x, y, walls, margin):
    """True if a pixel at (x, y) from a cell's centre lies wholly behind one of its walls (k, 3)."""
    behind = False
    for k in range(walls.shape[0]):
        behind = behind or walls[k, 0] * x + walls[k, 1] * y > walls[k, 2] + margin
    return behind


@kernel
def fill_cells(candidates, corners, counts, pixels, pixel_margin, sensor, array, pupil):
    """Fill the candidates of groups with centres `pixels` (n, 2); `counts` (2,) gets their number and that of corners.

    Points of a group are at most `pixel_margin` from its centre. Rows beyond the capacity of `candidates` and `corners`
    are counted but not written. The sensor is a `SensorPlane`.
    """
    first = candidates.first
    # Members that may be absent are read one by one, so that their branches are pruned.
    details = candidates.details
    tilt = sensor.tilt
    frame = pupil.plane.frame
    pattern = array.lattice.pattern
    array_extent = array.lattice.extent
    listed = array.lens_table
    walls = array.walls
    origin, basis, inverse = array.lattice.origin, array.lattice.basis, array.lattice.inverse
    powers, radius, plane, pinhole = array.lattice.powers, array.opening.radius, pupil.plane, pupil.pinhole
    normals, support, reach, step = pupil.normals, pupil.support, pupil.reach, pupil.step
    disconnected = pupil.disconnected
    polygon = np.empty((3, _MOST_CORNERS))
    largest_reach = 0.0
    for i in range(reach.size):
        largest_reach = max(largest_reach, reach[i])
    counts[:] = 0
    for p in range(pixels.shape[0]):
        first[p] = counts[0]
        sx, sy = pixels[p, 0], pixels[p, 1]
        h = sensor.distance
        far = plane.distance
        steep = 1.0
        if tilt is not None:
            h = sensor.distance + tilt[0] * sx + tilt[1] * sy
            steep = 1.0 + abs(tilt[0]) + abs(tilt[1])
        if frame is not None:
            far = frame[11] - plane.distance
            steep *= 1.25
        per_h = 1.0 / h
        ratio = far * per_h
        strongest = 0.0
        if not pinhole:
            for i in range(powers.size):
                strongest = max(strongest, abs(1.0 + far * (per_h - powers[i])))
        margin = pupil.margin + steep * ratio * pixel_margin
        search = steep * (largest_reach + strongest * radius + margin) / (1.0 + ratio)
        if listed is not None:
            # An axis off its cell's centre displaces the light.
            search += listed.offset * (1.0 + (1.0 + ratio + strongest) / (1.0 + ratio))
        # Cell whose central ray crosses the outline plane on the lens's axis.
        mid_x, mid_y = sx * ratio / (1.0 + ratio), sy * ratio / (1.0 + ratio)
        if frame is not None:
            for _ in range(3):
                qx, qy = crossing((mid_x, mid_y), (sx, sy), (mid_x, mid_y, 0.0), per_h, pinhole, plane)
                mid_x, mid_y = mid_x - qx / (1.0 + ratio), mid_y - qy / (1.0 + ratio)
        if walls is not None:
            # Only the lenses in whose cells the pixel lies.
            mid_x, mid_y, search = sx, sy, radius + pixel_margin
        if listed is None:
            mx, my = mid_x - origin[0], mid_y - origin[1]
            mid_i, mid_j = mx * inverse[0, 0] + my * inverse[1, 0], mx * inverse[0, 1] + my * inverse[1, 1]
            span_i = search * math.hypot(inverse[0, 0], inverse[1, 0])
            span_j = search * math.hypot(inverse[0, 1], inverse[1, 1])
            low_i, high_i = math.ceil(mid_i - span_i), math.floor(mid_i + span_i)
            low_j, high_j = math.ceil(mid_j - span_j), math.floor(mid_j + span_j)
        else:
            low_i, high_i, low_j, high_j = bins_around(mid_x, mid_y, search, listed.bins)
        for i in range(low_i, high_i + 1):
            for j in range(low_j, high_j + 1):
                low_k, high_k = 0, 1
                if listed is not None:
                    b = i * listed.bins.columns + j
                    low_k, high_k = listed.bins.first[b], listed.bins.first[b + 1]
                for k in range(low_k, high_k):
                    power, row = powers[0], 0
                    if array_extent is not None:  # noqa: SIM102 - nested for compile-time pruning
                        if listed is None and not in_extent(i, j, array_extent):
                            continue
                    if listed is None:
                        cx = origin[0] + i * basis[0, 0] + j * basis[1, 0]
                        cy = origin[1] + i * basis[0, 1] + j * basis[1, 1]
                        ox, oy = cx, cy
                        if pattern is not None:
                            power = powers[pattern[i % pattern.shape[0], j % pattern.shape[1]]]
                    else:
                        row = listed.bins.members[k]
                        lens = listed.lenses[row]
                        power = lens.power
                        cx, cy, ox, oy = lens.cell_x, lens.cell_y, lens.axis_x, lens.axis_y
                    at = crossing((cx, cy), (sx, sy), (ox, oy, power), per_h, pinhole, plane)
                    if walls is not None:  # noqa: SIM102 - nested for compile-time pruning
                        if _is_behind_wall(sx - cx, sy - cy, walls, pixel_margin):
                            continue
                    rho, azimuth = polar(cx, cy, frame)
                    interval = int(rho / step)
                    if interval >= reach.size:
                        continue
                    n_branches = array.opening.corners.shape[0] if listed is None else listed.corners.shape[1]
                    for branch in range(n_branches):
                        if branch == 1:
                            # Light through a clear gap around the opening is not refracted.
                            power = 0.0
                            at = crossing((cx, cy), (sx, sy), (ox, oy, power), per_h, pinhole, plane)
                        derivatives = _cell_derivatives(
                            (cx, cy), at, (sx, sy), (ox, oy, power), per_h, pinhole, plane, radius
                        )
                        jxx, jxy, jyx, jyy = derivatives
                        spread = radius * abs(jxx)
                        if frame is not None:
                            spread = 1.1 * radius * math.sqrt(jxx * jxx + jxy * jxy + jyx * jyx + jyy * jyy)
                        limit = reach[interval] + spread + margin
                        if at[0] * at[0] + at[1] * at[1] > limit * limit:
                            continue
                        if listed is None:
                            opening = array.opening.corners[branch]
                        else:
                            opening = listed.corners[row, branch, : listed.counts[row, branch]]
                        extent = spread, margin
                        n = _cut_opening(polygon, opening, at, derivatives, extent, azimuth, normals, support[interval])
                        if n < 3:
                            continue
                        if details is not None and counts[0] < candidates.rows.size:
                            detail = details[counts[0]]
                            if listed is None:
                                detail.centre_x, detail.centre_y = cx, cy
                                detail.cell_x, detail.cell_y = cx, cy
                                detail.transmission, detail.row = 1.0, -1
                                detail.axis_x, detail.axis_y = ox, oy
                            else:
                                details[counts[0]] = listed.lenses[row]
                            detail.power = power
                            detail.clip = array.opening.clip if branch == 0 else -1.0
                        _store(candidates, corners, counts, polygon, n, ((cx, cy), (ox, oy)), disconnected[interval])
    first[pixels.shape[0]] = counts[0]


@kernel
def fill_pupil(candidates, corners, counts, pixels, pupil, wells):
    """Fill the candidates without microlenses: the bounds on the exit pupil, seen from each group.

    `wells` are the `WellsRecord` whose light bounds them further, the distance from the sensor and the half side of a
    group; None for other pixels.
    """
    first = candidates.first
    outlines, reach, disconnected, step = pupil.corners, pupil.reach, pupil.disconnected, pupil.step
    sides = outlines.shape[1]
    polygon = np.empty((3, sides if wells is None else sides + 8))
    counts[:] = 0
    for p in range(pixels.shape[0]):
        first[p] = counts[0]
        sx, sy = pixels[p, 0], pixels[p, 1]
        rho, (cos, sin) = polar(sx, sy, None)
        interval = min(int(rho / step), reach.size - 1)
        if reach[interval] <= 0.0:
            continue
        for k in range(sides):
            polygon[0, k] = cos * outlines[interval, k, 0] - sin * outlines[interval, k, 1]
            polygon[1, k] = sin * outlines[interval, k, 0] + cos * outlines[interval, k, 1]
        n = sides
        if wells is not None:
            n = clip_to_wells(polygon, sides, (sx, sy), wells)
            if n < 3:
                continue
        _store(candidates, corners, counts, polygon, n, ((0.0, 0.0), (0.0, 0.0)), disconnected[interval])
    first[pixels.shape[0]] = counts[0]
