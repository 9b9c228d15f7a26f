"""Representative ray of a pixel: from a point on it through the illuminated centroid of its brightest microlens."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.camera.sampling.kernels.aimed_rays import displaced_point, set_aimed_ray
from plenoptic.camera.sampling.kernels.camera_samples import aim_sample
from plenoptic.camera.sampling.kernels.candidates import crossing, polar
from plenoptic.camera.sampling.kernels.unvignetted_core import MAX_CLIPPED_CORNERS, fill_clipped_piece
from plenoptic.core.kernels.bundles import pad
from plenoptic.core.kernels.ray_blocks import BLOCK, MISSED, RAY, STATUS, WEIGHT, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import device, kernel

AIM = 6
"""Columns of a probe: the aim, the optical axis of its microlens, its piece, and 1 if it is valid."""

CANDIDATES = 4
"""Microlenses for which a start on a pixel is computed."""

_MAX_OFFSET = 0.499
"""Largest offset of a start from the pixel's centre, in its sides; the edge belongs to two pixels."""

_ITERATIONS = 4
"""Iterations for a start; on a sensor parallel to the array the first one is exact."""


@kernel
def fill_region_rays(rays, lenslets, places, indices, starts, illuminated, distance):
    """Aim a ray of each of some illuminated pixels at the centroid of the piece that gives a start most light.

    `indices` (m,) are their indices among the illuminated pixels, `places` (m,) those of their `rays` (see
    `RepresentativeRays`), `starts` (m, k, 2) points on them. Rays without a region are unchanged. `distance` is that of
    the sensor, in mm.
    """
    centres, regions = illuminated.centres, illuminated.regions
    pieces, first, corners, planes = regions.pieces, regions.first, regions.corners, regions.planes
    details = regions.details
    polygon = np.empty((3, MAX_CLIPPED_CORNERS))
    for m in range(indices.size):
        p = indices[m]
        most_light, chosen, start, point = 0.0, -1, (0.0, 0.0), (0.0, 0.0)
        for k in range(starts.shape[1]):
            x, y = starts[m, k, 0], starts[m, k, 1]
            area_before = 0.0
            for t in range(first[p], first[p + 1]):
                full_area, area_before, transmission = pieces[t].area - area_before, pieces[t].area, 1.0
                if details is not None:
                    transmission = details[t].transmission
                if transmission * full_area > most_light:
                    in_pixel = x - centres[p, 0], y - centres[p, 1]
                    n = fill_clipped_piece(polygon, 0, corners, planes, pieces[t], in_pixel)
                    area, centroid_x, centroid_y = _centroid(polygon, 0, n)
                    centroid_x, centroid_y = displaced_point(pieces[t], (centroid_x, centroid_y), in_pixel)
                    u, v = pieces[t].cell_x + centroid_x - x, pieces[t].cell_y + centroid_y - y
                    # The fourth power of the cosine decides between several fully illuminated microlenses.
                    light = transmission * area / (1.0 + (u * u + v * v) / (distance * distance)) ** 2
                    if light > most_light:
                        most_light, chosen, start, point = light, t, (x, y), (centroid_x, centroid_y)
        if chosen < 0:
            continue
        index, piece = places[m], pieces[chosen]
        set_aimed_ray(
            rays.blocks[(index // BLOCK) * RAY : (index // BLOCK + 1) * RAY], index % BLOCK, piece, point, start, 1.0
        )
        rays.starts[index, 0], rays.starts[index, 1] = start
        rays.aims[index, 0], rays.aims[index, 1] = piece.cell_x + point[0], piece.cell_y + point[1]
        _set_cell(rays.cells[index], piece, details, chosen)
        if details is not None:
            lenslets[index] = details[chosen]


@kernel
def fill_probes(blocks, lenslets, aims, starts, regions, patterns):
    """Aim probe rays from each start at its region; `aims` is filled with their aims.

    Starts use the `patterns` (s, k, 2) of points in the unit square in turn. Light through gaps between the openings of
    microlenses is not valid.
    """
    first = regions.first
    n = 0
    for p in range(starts.shape[0]):
        points = patterns[p % patterns.shape[0]]
        for k in range(points.shape[0]):
            base = (n // BLOCK) * RAY
            ray = blocks[base : base + RAY]
            i = n % BLOCK
            chosen, is_valid = -1, 1.0
            if first[p + 1] > first[p]:
                start, random = (starts[p, 0], starts[p, 1]), (points[k, 0], points[k, 1])
                chosen = aim_sample(ray, i, regions, (first[p], first[p + 1]), (start, (0.0, 0.0)), random)
                if regions.details is not None:
                    lenslets[n] = regions.details[chosen]
                    is_valid = 0.0 if regions.details[chosen].clip < 0.0 else 1.0
            else:
                for row in range(8):
                    ray[row * BLOCK + i] = 0.0
                ray[STATUS + i] = MISSED
            aims[n, 0], aims[n, 1], aims[n, 2], aims[n, 3] = ray[X + i], ray[Y + i], ray[Z + i], ray[N + i]
            aims[n, 4], aims[n, 5] = chosen, is_valid
            n += 1
    pad(blocks, n)


@kernel
def fill_centroid_rays(rays, starts, probes, aims, regions):
    """Aim one ray from each start at the centroid of the unvignetted probes of the brightest cell.

    Probes run through the region in the order of its pieces, so that those of a cell are neighbours. If all probes of a
    cell are unvignetted, the centroid is that of its whole region. Starts without light get a lost ray. `rays` also
    gets the light, and the unvignetted probe of that cell nearest to the centroid; see `StartRays`.
    """
    pieces = regions.pieces
    blocks, lenslets, cells = rays.blocks, rays.lenslets, rays.cells
    count = aims.shape[0] // starts.shape[0]
    for p in range(starts.shape[0]):
        most_light, aim_x, aim_y, chosen = 0.0, 0.0, 0.0, 0
        low, high = 0, 0
        k = 0
        while k < count:
            start = p * count + k
            light, sum_x, sum_y, n_lit, n_probes = 0.0, 0.0, 0.0, 0, 0
            while k < count and _is_same_cell(aims, p * count + k, start):
                n = p * count + k
                if _all_pass(probes, aims, n):
                    light += probes[(n // BLOCK) * RAY + n % BLOCK + WEIGHT]
                    sum_x += aims[n, 0]
                    sum_y += aims[n, 1]
                    n_lit += 1
                n_probes += 1
                k += 1
            if light > most_light:
                most_light, chosen = light, int(aims[start, 4])
                aim_x, aim_y = sum_x / n_lit, sum_y / n_lit
                low, high = start, p * count + k
                if n_lit == n_probes:
                    piece = pieces[chosen]
                    _, aim_x, aim_y = _centroid(regions.corners, piece.first_corner, piece.corners)
                    aim_x, aim_y = piece.cell_x + aim_x, piece.cell_y + aim_y
        base = (p // BLOCK) * RAY
        ray = blocks[base : base + RAY]
        i = p % BLOCK
        ray[X + i], ray[Y + i] = aim_x, aim_y
        ray[L + i], ray[M + i] = aim_x - starts[p, 0], aim_y - starts[p, 1]
        ray[Z + i] = ray[N + i] = 0.0
        cells[p, 0], cells[p, 1], cells[p, 2] = math.nan, math.nan, math.nan
        if most_light > 0.0:
            ray[Z + i], ray[N + i] = pieces[chosen].axis_x, pieces[chosen].axis_y
            _set_cell(cells[p], pieces[chosen], regions.details, chosen)
            if regions.details is not None:
                lenslets[p] = regions.details[chosen]
        ray[WEIGHT + i] = 1.0
        ray[STATUS + i] = 0.0 if most_light > 0.0 else MISSED
        rays.light[p] = most_light
        rays.nearest[p], least_distance = -1, math.inf
        for n in range(low, high):
            offset = math.hypot(aims[n, 0] - aim_x, aims[n, 1] - aim_y)
            if offset < least_distance and _all_pass(probes, aims, n):
                rays.nearest[p], least_distance = n, offset
    pad(blocks, starts.shape[0])


@kernel
def fill_aimed_starts(starts, indices, illuminated, pixel, sensor, pupil):
    """Fill starts (n, CANDIDATES, 2) on pixels, nearest to the microlenses' images of the pupil's centre.

    The centre is that of the pupil's outline for the cell; light through the optical axis of a microlens is undeviated.
    Of the microlenses that illuminate the pixels `indices` (n,), those with images nearest to the pixel are used;
    missing starts are the pixel's centre.
    """
    centres, pieces, first = illuminated.centres, illuminated.regions.pieces, illuminated.regions.first
    # Members that may be absent are read one by one, so that their branches are pruned.
    tilt = sensor.tilt
    skew = pixel.skew
    frame = pupil.plane.frame
    plane = pupil.plane
    outline_distance = plane.distance
    if frame is not None:
        outline_distance = frame[11] - plane.distance
    along_x, along_y = 0.0, 0.0
    if skew is not None:
        along_x, along_y = skew[0], skew[1]
    across = pixel.width * pixel.height - along_x * along_y
    distances = np.empty(CANDIDATES)
    for m in range(indices.size):
        p = indices[m]
        centre_x, centre_y = centres[p, 0], centres[p, 1]
        distances[:] = math.inf
        for k in range(CANDIDATES):
            starts[m, k, 0], starts[m, k, 1] = centre_x, centre_y
        for t in range(first[p], first[p + 1]):
            ox, oy = pieces[t].axis_x, pieces[t].axis_y
            if t > first[p] and ox == pieces[t - 1].axis_x and oy == pieces[t - 1].axis_y:
                continue
            rho, (cos, sin) = polar(ox, oy, frame)
            interval = min(int(rho / pupil.step), pupil.reach.size - 1)
            mx, my = np.mean(pupil.corners[interval, :, 0]), np.mean(pupil.corners[interval, :, 1])
            mx, my = cos * mx - sin * my, sin * mx + cos * my
            sx, sy = centre_x, centre_y
            for _ in range(_ITERATIONS):
                h = sensor.distance
                if tilt is not None:
                    h += tilt[0] * sx + tilt[1] * sy
                qx, qy = crossing((ox, oy), (sx, sy), (ox, oy, 0.0), 1.0 / h, pupil.pinhole, plane)
                sx += (qx - mx) * h / outline_distance
                sy += (qy - my) * h / outline_distance
            dx, dy = sx - centre_x, sy - centre_y
            a = min(max((pixel.height * dx - along_x * dy) / across, -_MAX_OFFSET), _MAX_OFFSET)
            b = min(max((pixel.width * dy - along_y * dx) / across, -_MAX_OFFSET), _MAX_OFFSET)
            x, y = centre_x + a * pixel.width + b * along_x, centre_y + b * pixel.height + a * along_y
            offset = math.hypot(sx - x, sy - y)
            k = CANDIDATES
            while k > 0 and offset < distances[k - 1]:
                k -= 1
            for j in range(CANDIDATES - 1, k, -1):
                distances[j] = distances[j - 1]
                starts[m, j, 0], starts[m, j, 1] = starts[m, j - 1, 0], starts[m, j - 1, 1]
            if k < CANDIDATES:
                distances[k] = offset
                starts[m, k, 0], starts[m, k, 1] = x, y


@device
def _all_pass(probes, aims, n):
    return probes[(n // BLOCK) * RAY + n % BLOCK + STATUS] == 0.0 and aims[n, 5] > 0.0


@device
def _is_same_cell(aims, n, start):
    return aims[n, 2] == aims[start, 2] and aims[n, 3] == aims[start, 3] and aims[n, 5] == aims[start, 5]


@device
def _set_cell(cell, piece, details, k):
    """Set the centre of the cell of piece k, and the row of its lens; see `RepresentativeRays`."""
    cell[0], cell[1], cell[2] = piece.axis_x, piece.axis_y, -1.0
    if details is not None:
        cell[0], cell[1], cell[2] = details[k].cell_x, details[k].cell_y, details[k].row


@device
def _centroid(polygon, first, n):
    """Area and centroid of a polygon."""
    x, y = polygon[0, first], polygon[1, first]
    twice_area, sum_x, sum_y = 0.0, 0.0, 0.0
    for q in range(first + 1, first + n - 1):
        ax, ay, bx, by = polygon[0, q] - x, polygon[1, q] - y, polygon[0, q + 1] - x, polygon[1, q + 1] - y
        term = ax * by - ay * bx
        twice_area += term
        sum_x += term * (ax + bx)
        sum_y += term * (ay + by)
    if not twice_area > 0.0:
        return 0.0, x, y
    return 0.5 * twice_area, x + sum_x / (3.0 * twice_area), y + sum_y / (3.0 * twice_area)
