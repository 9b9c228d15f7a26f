"""Kernels of representative rays: from a point on the pixel through the lit centroid of its brightest microlens."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.camera.sampling.kernels.candidates import crossing, polar
from plenoptic.camera.sampling.kernels.parts import ROOM, aim_at, fill_part, moved
from plenoptic.camera.sampling.kernels.paths import aim
from plenoptic.core.kernels.bundles import pad
from plenoptic.core.kernels.ray_blocks import BLOCK, MISSED, RAY, STATUS, WEIGHT, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import device, kernel

AIM = 6
"""Numbers of a probe: the point aimed at, the optical axis of its microlens, its piece, and whether it counts."""

CANDIDATES = 4
"""Microlenses for which a start on a pixel is sought."""

_INSIDE = 0.499
"""How far from the centre of a pixel a start may lie, in its sides: not on the edge, which belongs to two."""

_ROUNDS = 4
"""Corrections of a start; on a sensor parallel to the array the first one is exact."""


@kernel
def fill_region_rays(rays, lanes, at, which, starts, fed, distance):
    """Aim a ray of each of some fed pixels at the centroid of the part of a microlens that gives a start most light.

    `which` (m,) are their numbers among the fed ones, `at` (m,) the places of their `rays` (see `PixelRays`), `starts`
    (m, k, 2) points on them. Where nothing feeds these, rays stay unchanged. `distance`: of the sensor, in mm.
    """
    centres, regions = fed.centres, fed.regions
    pieces, first, corners, planes = regions.pieces, regions.first, regions.corners, regions.planes
    details = regions.details
    polygon = np.empty((3, ROOM))
    for m in range(which.size):
        p = which[m]
        best, found, start, point = 0.0, -1, (0.0, 0.0), (0.0, 0.0)
        for k in range(starts.shape[1]):
            x, y = starts[m, k, 0], starts[m, k, 1]
            before = 0.0
            for t in range(first[p], first[p + 1]):
                uncut, before, passes = pieces[t].area - before, pieces[t].area, 1.0
                if details is not None:
                    passes = details[t].transmission
                if passes * uncut > best:
                    beside = x - centres[p, 0], y - centres[p, 1]
                    n = fill_part(polygon, 0, corners, planes, pieces[t], beside)
                    area, middle_x, middle_y = _centroid(polygon, 0, n)
                    middle_x, middle_y = moved(pieces[t], (middle_x, middle_y), beside)
                    u, v = pieces[t].cell_x + middle_x - x, pieces[t].cell_y + middle_y - y
                    # The fourth power of the cosine decides where several microlenses are lit to the full.
                    light = passes * area / (1.0 + (u * u + v * v) / (distance * distance)) ** 2
                    if light > best:
                        best, found, start, point = light, t, (x, y), (middle_x, middle_y)
        if found < 0:
            continue
        to, piece = at[m], pieces[found]
        aim_at(rays.blocks[(to // BLOCK) * RAY : (to // BLOCK + 1) * RAY], to % BLOCK, piece, point, start, 1.0)
        rays.starts[to, 0], rays.starts[to, 1] = start
        rays.aims[to, 0], rays.aims[to, 1] = piece.cell_x + point[0], piece.cell_y + point[1]
        _name_cell(rays.cells[to], piece, details, found)
        if details is not None:
            lanes[to] = details[found]


@kernel
def fill_probes(blocks, lanes, aims, starts, regions, patterns):
    """Aim rays from each start at its region; where they are aimed is kept in `aims`.

    Starts take the `patterns` (s, k, 2) of points in the unit square in turn.

    Light that passes beside the openings of microlenses does not count.
    """
    first = regions.first
    n = 0
    for p in range(starts.shape[0]):
        points = patterns[p % patterns.shape[0]]
        for k in range(points.shape[0]):
            base = (n // BLOCK) * RAY
            ray = blocks[base : base + RAY]
            i = n % BLOCK
            chosen, counts = -1, 1.0
            if first[p + 1] > first[p]:
                start = starts[p, 0], starts[p, 1]
                chosen = aim(ray, i, regions, (first[p], first[p + 1]), start, (points[k, 0], points[k, 1]))
                if regions.details is not None:
                    lanes[n] = regions.details[chosen]
                    counts = 0.0 if regions.details[chosen].clip < 0.0 else 1.0
            else:
                for row in range(8):
                    ray[row * BLOCK + i] = 0.0
                ray[STATUS + i] = MISSED
            aims[n, 0], aims[n, 1], aims[n, 2], aims[n, 3] = ray[X + i], ray[Y + i], ray[Z + i], ray[N + i]
            aims[n, 4], aims[n, 5] = chosen, counts
            n += 1
    pad(blocks, n)


@kernel
def fill_centroid_rays(rays, starts, probes, aims, regions):
    """From the traced probes, aim one ray from each start at the lit centroid of the cell that passes most light.

    Probes run through the region in the order of its pieces, so that those of a cell are neighbours. Where all
    probes of a cell arrive, its centroid is that of its whole region. Starts without light get a lost ray. Beside a
    ray, `rays` gets its light and the probe of that cell that arrives nearest to the centroid; see `StartRays`.
    """
    pieces = regions.pieces
    blocks, lanes, cells = rays.blocks, rays.lanes, rays.cells
    count = aims.shape[0] // starts.shape[0]
    for p in range(starts.shape[0]):
        best, best_x, best_y, found = 0.0, 0.0, 0.0, 0
        low, high = 0, 0
        k = 0
        while k < count:
            start = p * count + k
            light, sum_x, sum_y, lit, seen = 0.0, 0.0, 0.0, 0, 0
            while k < count and _same_cell(aims, p * count + k, start):
                n = p * count + k
                if _arrives(probes, aims, n):
                    light += probes[(n // BLOCK) * RAY + n % BLOCK + WEIGHT]
                    sum_x += aims[n, 0]
                    sum_y += aims[n, 1]
                    lit += 1
                seen += 1
                k += 1
            if light > best:
                best, found = light, int(aims[start, 4])
                best_x, best_y = sum_x / lit, sum_y / lit
                low, high = start, p * count + k
                if lit == seen:
                    piece = pieces[found]
                    _, best_x, best_y = _centroid(regions.corners, piece.first_corner, piece.corners)
                    best_x, best_y = piece.cell_x + best_x, piece.cell_y + best_y
        base = (p // BLOCK) * RAY
        ray = blocks[base : base + RAY]
        i = p % BLOCK
        ray[X + i], ray[Y + i] = best_x, best_y
        ray[L + i], ray[M + i] = best_x - starts[p, 0], best_y - starts[p, 1]
        ray[Z + i] = ray[N + i] = 0.0
        cells[p, 0], cells[p, 1], cells[p, 2] = math.nan, math.nan, math.nan
        if best > 0.0:
            ray[Z + i], ray[N + i] = pieces[found].axis_x, pieces[found].axis_y
            _name_cell(cells[p], pieces[found], regions.details, found)
            if regions.details is not None:
                lanes[p] = regions.details[found]
        ray[WEIGHT + i] = 1.0
        ray[STATUS + i] = 0.0 if best > 0.0 else MISSED
        rays.light[p] = best
        rays.nearest[p], least = -1, math.inf
        for n in range(low, high):
            away = math.hypot(aims[n, 0] - best_x, aims[n, 1] - best_y)
            if away < least and _arrives(probes, aims, n):
                rays.nearest[p], least = n, away
    pad(blocks, starts.shape[0])


@kernel
def fill_aimed_starts(starts, which, fed, pixel, sensor, pupil):
    """Points (n, CANDIDATES, 2) of pixels from which microlenses see the middle of the pupil, or nearest to such ones.

    The middle is that of the pupil's outline for the cell; light passes the optical axis of a microlens straight. Of
    the microlenses that feed the fed pixels `which` (n,), those count whose points are nearest to the pixel; the centre
    stands for no further.
    """
    centres, pieces, first = fed.centres, fed.regions.pieces, fed.regions.first
    # Members that may be absent are read one by one, so that their branches are pruned.
    tilt = sensor.tilt
    skew = pixel.skew
    frame = pupil.plane.frame
    plane = pupil.plane
    far = plane.distance
    if frame is not None:
        far = frame[11] - plane.distance
    along_x, along_y = 0.0, 0.0
    if skew is not None:
        along_x, along_y = skew[0], skew[1]
    across = pixel.width * pixel.height - along_x * along_y
    distances = np.empty(CANDIDATES)
    for m in range(which.size):
        p = which[m]
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
            for _ in range(_ROUNDS):
                h = sensor.distance
                if tilt is not None:
                    h += tilt[0] * sx + tilt[1] * sy
                qx, qy = crossing((ox, oy), (sx, sy), (ox, oy, 0.0), 1.0 / h, pupil.pinhole, plane)
                sx += (qx - mx) * h / far
                sy += (qy - my) * h / far
            dx, dy = sx - centre_x, sy - centre_y
            a = min(max((pixel.height * dx - along_x * dy) / across, -_INSIDE), _INSIDE)
            b = min(max((pixel.width * dy - along_y * dx) / across, -_INSIDE), _INSIDE)
            x, y = centre_x + a * pixel.width + b * along_x, centre_y + b * pixel.height + a * along_y
            away = math.hypot(sx - x, sy - y)
            k = CANDIDATES
            while k > 0 and away < distances[k - 1]:
                k -= 1
            for later in range(CANDIDATES - 1, k, -1):
                distances[later] = distances[later - 1]
                starts[m, later, 0], starts[m, later, 1] = starts[m, later - 1, 0], starts[m, later - 1, 1]
            if k < CANDIDATES:
                distances[k] = away
                starts[m, k, 0], starts[m, k, 1] = x, y


@device
def _arrives(probes, aims, n):
    return probes[(n // BLOCK) * RAY + n % BLOCK + STATUS] == 0.0 and aims[n, 5] > 0.0


@device
def _same_cell(aims, n, start):
    return aims[n, 2] == aims[start, 2] and aims[n, 3] == aims[start, 3] and aims[n, 5] == aims[start, 5]


@device
def _name_cell(cell, piece, details, k):
    """Centre of the cell of piece k, and the row of its lens; see `PixelRays`."""
    cell[0], cell[1], cell[2] = piece.axis_x, piece.axis_y, -1.0
    if details is not None:
        cell[0], cell[1], cell[2] = details[k].cell_x, details[k].cell_y, details[k].row


@device
def _centroid(polygon, first, n):
    """Area and centroid of a polygon."""
    x, y = polygon[0, first], polygon[1, first]
    twice, sum_x, sum_y = 0.0, 0.0, 0.0
    for q in range(first + 1, first + n - 1):
        ax, ay, bx, by = polygon[0, q] - x, polygon[1, q] - y, polygon[0, q + 1] - x, polygon[1, q + 1] - y
        part = ax * by - ay * bx
        twice += part
        sum_x += part * (ax + bx)
        sum_y += part * (ay + by)
    if not twice > 0.0:
        return 0.0, x, y
    return 0.5 * twice, x + sum_x / (3.0 * twice), y + sum_y / (3.0 * twice)
