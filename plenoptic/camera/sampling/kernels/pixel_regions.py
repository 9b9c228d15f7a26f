"""The part of the microlens plane from which light can reach a pixel, as triangles: the kernels.

For each pixel and each microlens that may feed it, the microlens's opening is cut with the outline of the
exit pupil as seen through the lens from the pixel (an affine map in the thin-lens limit, which is where
margins for thick and tilted microlenses come in). What is left is a convex polygon, kept as a fan of triangles.
"""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.jit import device, kernel
from plenoptic.core.kernels.polygons import cut

TRIANGLE = 9
"""Numbers of a triangle: corner x, y; two edges x, y; area up to and with this triangle; optical axis of its lens."""

_MOST_CORNERS = 64


@device
def _store_fan(triangles, used, x, y, n, shift_x, shift_y, cx, cy, area):
    """Append a polygon as a fan of triangles; returns the triangles used and the area so far."""
    for k in range(1, n - 1):
        ax, ay = x[k] - x[0], y[k] - y[0]
        bx, by = x[k + 1] - x[0], y[k + 1] - y[0]
        twice = ax * by - ay * bx
        if twice <= 0.0:
            continue
        area += 0.5 * twice
        if used < triangles.shape[0]:
            row = triangles[used]
            row[0], row[1] = x[0] + shift_x, y[0] + shift_y
            row[2], row[3], row[4], row[5] = ax, ay, bx, by
            row[6] = area
            row[7], row[8] = cx, cy
        used += 1
    return used, area


@device
def crossing(mx, my, sx, sy, ox, oy, per_h, power, pinhole, gap, frame):
    """Where a ray from (sx, sy) of the sensor through (mx, my) of an ideal microlens crosses the plane of the outlines.

    (ox, oy) is the lens's optical axis and 1 / per_h the distance to the sensor. `gap` is the distance to the plane of
    the outlines or, with a `frame` that leads to the lens's axes, the place of that plane there.
    """
    if pinhole:
        u, v = (ox - sx) * per_h, (oy - sy) * per_h
        mx, my = ox, oy
    else:
        u, v = (mx - sx) * per_h - (mx - ox) * power, (my - sy) * per_h - (my - oy) * power
    if frame is None:
        return mx + gap * u, my + gap * v
    z = frame[6] * mx + frame[7] * my + frame[11]
    t = (gap - z) / (frame[6] * u + frame[7] * v - frame[8])
    return (
        frame[0] * mx + frame[1] * my + frame[9] + t * (frame[0] * u + frame[1] * v - frame[2]),
        frame[3] * mx + frame[4] * my + frame[10] + t * (frame[3] * u + frame[4] * v - frame[5]),
    )


@device
def _slopes(cx, cy, qx, qy, sx, sy, ox, oy, per_h, power, pinhole, gap, frame, radius):
    """How the crossing (qx, qy) of a ray through (cx, cy) moves with that point: a matrix, row by row."""
    if frame is None:
        bend = 0.0 if pinhole else 1.0 + gap * (per_h - power)
        return bend, 0.0, 0.0, bend
    ax, ay = crossing(cx + radius, cy, sx, sy, ox, oy, per_h, power, pinhole, gap, frame)
    bx, by = crossing(cx, cy + radius, sx, sy, ox, oy, per_h, power, pinhole, gap, frame)
    return (ax - qx) / radius, (bx - qx) / radius, (ay - qy) / radius, (by - qy) / radius


@device
def _cut_opening(
    x, y, xs, ys, corners, count, qx, qy, jxx, jxy, jyx, jyy, spread, margin, axis, interval, normals, support
):
    """Cut an opening with the outline of the pupil that belongs to an interval of the field; returns its corners.

    A ray through d of the opening crosses the outline's plane at q + J d, no farther than `spread` from q. `axis` is
    the cosine and sine of the azimuth of the cell, in whose direction the outlines have their first axis.
    """
    cos, sin = axis
    tx, ty = cos * qx + sin * qy, cos * qy - sin * qx
    n = -1
    for k in range(normals.shape[0]):
        room = support[interval, k] + margin - (normals[k, 0] * tx + normals[k, 1] * ty)
        if room >= spread:
            continue
        if room < -spread:
            return 0
        if n < 0:
            n = count
            for q in range(count):
                x[q], y[q] = corners[q, 0], corners[q, 1]
        # The side's normal, turned back.
        ux, uy = cos * normals[k, 0] - sin * normals[k, 1], sin * normals[k, 0] + cos * normals[k, 1]
        n = cut(x, y, n, jxx * ux + jyx * uy, jxy * ux + jyy * uy, room, xs, ys)
        if n == 0:
            return 0
    if n < 0:
        n = count
        for q in range(count):
            x[q], y[q] = corners[q, 0], corners[q, 1]
    return n


@device
def _is_behind(x, y, walls, margin):
    """Whether a pixel at (x, y) from a cell's centre lies wholly behind one of the walls (k, 3) about it."""
    behind = False
    for k in range(walls.shape[0]):
        behind = behind or walls[k, 0] * x + walls[k, 1] * y > walls[k, 2] + margin
    return behind


@kernel
def fill_cell_regions(
    triangles,
    details,
    first,
    pixels,
    pixel_margin,
    distance,
    lean,
    gap,
    frame,
    pinhole,
    origin,
    basis,
    inverse,
    corners,
    powers,
    pattern,
    clip,
    bins,
    bin_first,
    members,
    lenses,
    listed_corners,
    listed_counts,
    radius,
    walls,
    slack,
    normals,
    support,
    reach,
    step,
):
    """Regions of the pixels whose centres are `pixels` (n, 2); returns the number of triangles they need.

    Lenses lie on a lattice (`origin`, `basis`) with common `corners` (parts, k, 2) of their openings, or are listed:
    `lenses` (n, LANE + 2) rows of details and optical axes, found through `bins`. A second part of an opening is
    what lies beside it, where that is clear. `radius` is how far corners reach, `walls` the edges of the largest cell
    where walls stand behind the cells, `slack` how far a real microlens strays on the plane of the outlines. Pixels no
    light reaches get no triangle. Where the room in `triangles` is too small nothing beyond it is written. For the
    other arguments see `CameraTables` and `crossing`.
    """
    x, y = np.empty(_MOST_CORNERS), np.empty(_MOST_CORNERS)
    xs, ys = np.empty(_MOST_CORNERS), np.empty(_MOST_CORNERS)
    largest = 0.0
    for i in range(reach.size):
        largest = max(largest, reach[i])
    used = 0
    for p in range(pixels.shape[0]):
        first[p] = used
        sx, sy = pixels[p, 0], pixels[p, 1]
        h = distance
        far = gap
        steep = 1.0
        if lean is not None:
            h = distance + lean[0] * sx + lean[1] * sy
            steep = 1.0 + abs(lean[0]) + abs(lean[1])
        if frame is not None:
            far = frame[11] - gap
            steep *= 1.25
        per_h = 1.0 / h
        ratio = far * per_h
        strongest = 0.0
        if not pinhole:
            for i in range(powers.size):
                strongest = max(strongest, abs(1.0 + far * (per_h - powers[i])))
        margin = slack + steep * ratio * pixel_margin
        search = steep * (largest + strongest * radius + margin) / (1.0 + ratio)
        if bins is not None:
            # An axis beside its cell's centre takes the light with it.
            search += bins[5] * (1.0 + (1.0 + ratio + strongest) / (1.0 + ratio))
        # Where the ray through the centre of a cell would go along the lens's axis.
        mid_x, mid_y = sx * ratio / (1.0 + ratio), sy * ratio / (1.0 + ratio)
        if frame is not None:
            for _ in range(3):
                qx, qy = crossing(mid_x, mid_y, sx, sy, mid_x, mid_y, per_h, 0.0, pinhole, gap, frame)
                mid_x, mid_y = mid_x - qx / (1.0 + ratio), mid_y - qy / (1.0 + ratio)
        if walls is not None:
            # Only the lenses in whose cells the pixel lies.
            mid_x, mid_y, search = sx, sy, radius + pixel_margin
        if bins is None:
            mx, my = mid_x - origin[0], mid_y - origin[1]
            mid_i, mid_j = mx * inverse[0, 0] + my * inverse[1, 0], mx * inverse[0, 1] + my * inverse[1, 1]
            span_i = search * math.hypot(inverse[0, 0], inverse[1, 0])
            span_j = search * math.hypot(inverse[0, 1], inverse[1, 1])
            low_i, high_i = math.ceil(mid_i - span_i), math.floor(mid_i + span_i)
            low_j, high_j = math.ceil(mid_j - span_j), math.floor(mid_j + span_j)
        else:
            low_i = max(math.floor((mid_x - search - bins[0]) / bins[2]), 0)
            low_j = max(math.floor((mid_y - search - bins[1]) / bins[2]), 0)
            high_i = min(math.floor((mid_x + search - bins[0]) / bins[2]), int(bins[3]) - 1)
            high_j = min(math.floor((mid_y + search - bins[1]) / bins[2]), int(bins[4]) - 1)
        area = 0.0
        for i in range(low_i, high_i + 1):
            for j in range(low_j, high_j + 1):
                low_k, high_k = 0, 1
                if bins is not None:
                    low_k, high_k = bin_first[i * int(bins[4]) + j], bin_first[i * int(bins[4]) + j + 1]
                for k in range(low_k, high_k):
                    power, lens = powers[0], 0
                    if bins is None:
                        cx = origin[0] + i * basis[0, 0] + j * basis[1, 0]
                        cy = origin[1] + i * basis[0, 1] + j * basis[1, 1]
                        ox, oy = cx, cy
                        if pattern is not None:
                            power = powers[pattern[i % pattern.shape[0], j % pattern.shape[1]]]
                    else:
                        lens = members[k]
                        power = lenses[lens, 0]
                        cx, cy = lenses[lens, 3], lenses[lens, 4]
                        ox, oy = lenses[lens, 8], lenses[lens, 9]
                    qx, qy = crossing(cx, cy, sx, sy, ox, oy, per_h, power, pinhole, gap, frame)
                    if walls is not None:  # noqa: SIM102 - alone, so that it is pruned
                        if _is_behind(sx - cx, sy - cy, walls, pixel_margin):
                            continue
                    fx, fy = cx, cy
                    if frame is not None:
                        fx = frame[0] * cx + frame[1] * cy + frame[9]
                        fy = frame[3] * cx + frame[4] * cy + frame[10]
                    rho = math.hypot(fx, fy)
                    interval = int(rho / step)
                    if interval >= reach.size:
                        continue
                    axis = (fx / rho, fy / rho) if rho > 0.0 else (1.0, 0.0)
                    parts = corners.shape[0] if bins is None else listed_corners.shape[1]
                    for part in range(parts):
                        if part == 1:
                            # Beside the opening, where that is clear, light is not bent.
                            power = 0.0
                            qx, qy = crossing(cx, cy, sx, sy, ox, oy, per_h, power, pinhole, gap, frame)
                        jxx, jxy, jyx, jyy = _slopes(
                            cx, cy, qx, qy, sx, sy, ox, oy, per_h, power, pinhole, gap, frame, radius
                        )
                        spread = radius * abs(jxx)
                        if frame is not None:
                            spread = 1.1 * radius * math.sqrt(jxx * jxx + jxy * jxy + jyx * jyx + jyy * jyy)
                        limit = reach[interval] + spread + margin
                        if qx * qx + qy * qy > limit * limit:
                            continue
                        if bins is None:
                            opening, count = corners[part], corners.shape[1]
                        else:
                            opening, count = listed_corners[lens, part], listed_counts[lens, part]
                        n = _cut_opening(
                            x,
                            y,
                            xs,
                            ys,
                            opening,
                            count,
                            qx,
                            qy,
                            jxx,
                            jxy,
                            jyx,
                            jyy,
                            spread,
                            margin,
                            axis,
                            interval,
                            normals,
                            support,
                        )
                        if n < 3:
                            continue
                        start = used
                        used, area = _store_fan(triangles, used, x, y, n, cx, cy, ox, oy, area)
                        if details is not None:
                            for t in range(start, min(used, details.shape[0])):
                                row = details[t]
                                if bins is None:
                                    row[1], row[2], row[3], row[4], row[6], row[7] = cx, cy, cx, cy, 1.0, -1.0
                                else:
                                    row[:] = lenses[lens, : details.shape[1]]
                                row[0] = power
                                row[5] = clip if part == 0 else -1.0
    first[pixels.shape[0]] = used
    return used


@kernel
def fill_pupil_regions(triangles, first, pixels, corners, reach, step):
    """Without microlenses: the outline of the pupil itself, seen from each pixel."""
    sides = corners.shape[1]
    x, y = np.empty(sides), np.empty(sides)
    used = 0
    for p in range(pixels.shape[0]):
        first[p] = used
        sx, sy = pixels[p, 0], pixels[p, 1]
        rho = math.hypot(sx, sy)
        interval = min(int(rho / step), reach.size - 1)
        if reach[interval] <= 0.0:
            continue
        cos, sin = (sx / rho, sy / rho) if rho > 0.0 else (1.0, 0.0)
        for k in range(sides):
            x[k] = cos * corners[interval, k, 0] - sin * corners[interval, k, 1]
            y[k] = sin * corners[interval, k, 0] + cos * corners[interval, k, 1]
        used, _ = _store_fan(triangles, used, x, y, sides, 0.0, 0.0, 0.0, 0.0, 0.0)
    first[pixels.shape[0]] = used
    return used
