"""Start of paths: a point on a pixel and a point in its aperture region."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.camera.sampling.kernels.parts import ROOM, STEPS, Divided, aim_at, aim_divided, divide, fill_part, moved
from plenoptic.camera.sampling.kernels.pixel_regions import MOST_PIECES
from plenoptic.camera.sampling.record import NEAR
from plenoptic.core.kernels.bundles import pad
from plenoptic.core.kernels.polygons import area_of, point_in
from plenoptic.core.kernels.ray_blocks import BENT_IN, BLOCK, MISSED, RAY, STATUS, WEIGHT, L, M, N, X, Y, Z
from plenoptic.core.kernels.sobol import (
    DIMENSIONS,
    mix,
    reversed_point,
    sample,
    scramble_reversed,
    set_index,
    set_key,
    stream,
    to_unit,
)
from plenoptic.core.numba.jit import device, kernel
from plenoptic.optics.diffraction.kernels.far_field import sample_deflection
from plenoptic.optics.microlens.kernels.to_lens import at_wavelength

_FEW = 8
COLOUR_SET = 1 << 20
"""Set of the sampling points that draws wavelengths: beyond those of all bounces."""
BEND_SET = COLOUR_SET + 1
"""The one that draws how light bends."""


@device
def path_place(path, samples, replicates):
    """Pixel, replicate and number in the replicate of path `path` of a tile.

    Paths run over pixels, in a pixel over replicates, in a replicate over its samples; the first
    `samples % replicates` replicates have one sample more than the others.
    """
    pixel = path // samples
    rest = path - pixel * samples
    each, more = samples // replicates, samples % replicates
    long = more * (each + 1)
    if rest < long:
        replicate = rest // (each + 1)
        return pixel, replicate, rest - replicate * (each + 1)
    replicate = more + (rest - long) // each
    return pixel, replicate, rest - long - (replicate - more) * each


@device
def replicate_size(replicate, samples, replicates):
    """Samples of a replicate of a pixel."""
    return samples // replicates + (1 if replicate < samples % replicates else 0)


@device
def _find(pieces, low, high, area):
    """The piece between low and high - 1 whose part of the summed area holds `area`."""
    while high - low > _FEW:
        middle = (low + high) // 2
        if pieces[middle - 1].area > area:
            high = middle
        else:
            low = middle
    # Counting has no branch that a processor could guess wrong.
    k = low
    for i in range(low, high - 1):
        k += 1 if pieces[i].area <= area else 0
    return k


@device
def choose(pieces, region, random):
    """Sample a piece of a region with probability proportional to its area.

    Returns the area of all, the index of the piece, and the rest of the random number times that area, for use within
    the piece.
    """
    low, high = region
    total = pieces[high - 1].area
    wanted = random * total
    k = _find(pieces, low, high, wanted)
    # Read first: behind the piece, this branch is one that the processor guesses, and costs 20 ns a path.
    before = 0.0
    if k > low:
        before = pieces[k - 1].area
    return total, k, wanted - before


@device
def aim(ray, i, regions, region, start, random):
    """Point of the region of one point of the sensor, by areas: one random number finds the piece and, stretched, the
    triangle of its fan, the other the point in it.

    `region` is the first piece and the end of the region's, `start` x and y on the sensor. Returns the piece.
    """
    total, k, left = choose(regions.pieces, region, random[0])
    piece = regions.pieces[k]
    point = point_in(regions.corners, piece.first_corner, piece.corners, left, random[1])
    aim_at(ray, i, piece, point, start, total)
    return k


@device
def _fill_coordinates(u, net, dimension, index, run, key):
    """Scrambled coordinates of points index ... index + run - 1 of a net."""
    seed = np.uint32(mix(key, np.uint64(dimension)))
    for k in range(run):
        u[dimension, k] = to_unit(scramble_reversed(net[dimension, index + k], seed))


@device
def _is_still(pieces, low, high):
    """True if a region has the same area for all points of its pixel."""
    still = True
    for k in range(low, high):
        still = still and pieces[k].planes == 0
    return still


@device
def _from_where(around, p, point, wavelength, random):
    """Sample the direction of a point's light before diffraction.

    Returns the point to which light of pixel p was headed, the number of the pixel around the tile in which it lies
    (-1: none that is near, -2: none that is followed), and the weights of paths through openings and outside them.
    """
    frame = around.bend
    h = around.plane.distance
    if around.plane.tilt is not None:
        h += around.plane.tilt[0] * point[0] + around.plane.tilt[1] * point[1]
    by_x, by_y, through, beside = sample_deflection(frame.field, random[0], random[1])
    x, y = point[0] - h * wavelength * by_x, point[1] - h * wavelength * by_y
    dx, dy = x - frame.shift[0], y - frame.shift[1]
    rows, columns = around.shape
    column = 0.5 * columns - (frame.back[0, 0] * dx + frame.back[0, 1] * dy)
    row = 0.5 * rows + (frame.back[1, 0] * dx + frame.back[1, 1] * dy)
    found = -2
    if -NEAR <= row < rows + NEAR and -NEAR <= column < columns + NEAR:
        found, i, j = -1, math.floor(row), math.floor(column)
        if abs(i - around.own[p, 0]) <= NEAR and abs(j - around.own[p, 1]) <= NEAR:
            found = around.grid[i - around.corner[0], j - around.corner[1]]
    return (x, y), found, (through, beside)


@device
def _counted(ray, i, lens, counts):
    """Weight of a deflected path through the opening of its microlens, or outside it."""
    ray[WEIGHT + i] *= counts[1] if lens.clip < 0.0 else counts[0]


@device
def _aim_still(ray, i, regions, region, place, random):
    """Start path i towards a region that is the same for all points of its pixel; returns the piece."""
    total, chosen, left = choose(regions.pieces, region, random[0])
    piece = regions.pieces[chosen]
    point = point_in(regions.corners, piece.first_corner, piece.corners, left, random[1])
    aim_at(ray, i, piece, moved(piece, point, place[1]), place[0], total)
    return chosen


@device
def _aim_moving(ray, i, room, regions, region, place, random):
    """Start path i towards a region that differs over its pixel, in room for its parts; returns the piece."""
    polygon, counts, areas = room
    low, high = region
    on_sensor, at = place
    pieces, total = regions.pieces, 0.0
    for c in range(high - low):
        counts[c] = fill_part(polygon, c * ROOM, regions.corners, regions.planes, pieces[low + c], at)
        areas[c] = area_of(polygon, c * ROOM, counts[c]) if counts[c] >= 3 else 0.0
        total += areas[c]
    c, left = 0, random[0] * total
    while c < high - low - 1 and left >= areas[c]:
        left -= areas[c]
        c += 1
    chosen, point = low + c, (0.0, 0.0)
    if areas[c] > 0.0:
        point = point_in(polygon, c * ROOM, counts[c], left, random[1])
    aim_at(ray, i, pieces[chosen], moved(pieces[chosen], point, at), on_sensor, total)
    if not areas[c] > 0.0:
        ray[WEIGHT + i], ray[STATUS + i] = 0.0, MISSED
    return chosen


@device
def _lose(ray, i, status):
    """A path without light."""
    ray[X + i], ray[Y + i], ray[L + i], ray[M + i], ray[Z + i], ray[N + i] = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    ray[WEIGHT + i], ray[STATUS + i] = 0.0, status


@device
def _keep(ray, i, start, random, counts):
    """Store the state from which a path is started later; see `fill_far_samples`."""
    ray[X + i], ray[Y + i] = start
    ray[L + i], ray[M + i] = random
    ray[Z + i], ray[N + i] = counts


@device
def _spot(spread, wavelength, start, aside, places):
    """The row of a `SpreadTable` for a path of a wavelength from a point and its places in the pixel."""
    h = spread.plane.distance
    if spread.plane.tilt is not None:
        h += spread.plane.tilt[0] * start[0] + spread.plane.tilt[1] * start[1]
    level = min(max(int((wavelength * h - spread.low) * spread.per_level), 0), spread.levels - 1)
    row = level * spread.kinds + (1 if aside else 0)
    across, down = int(places[0] * spread.fine), int(places[1] * spread.fine)
    return (row * spread.fine + down) * spread.fine + across


@kernel
def fill_camera_samples(blocks, sure, own, bends, start, n, batch, fed):
    """Start paths start ... start + n - 1 of a batch of the pixels of a tile, which are `FedPixels`.

    A pixel that is turned has the sides (width, skew[1]) and (skew[0], height). `own` gets the parameters of the paths'
    microlenses, where they differ. Of each path, first the point on the pixel is drawn, then one in the aperture
    regions of that point; paths from points without such regions are lost.

    With `sure`, blocks as well, unvignetted light is aimed there and need not be traced, and paths are drawn
    in the remainder around it.

    Where light bends, a path starts where it was headed. Those that come from far away are left to `fill_far_samples`,
    with that place, two random numbers and their weights; `Bends` gets their numbers. Returns how many there are.
    Where light is shared, they get the row of the `SpreadTable` for each path.
    """
    net, samples, streams = batch.net, batch.samples, batch.streams
    regions = fed.regions
    pieces, first = regions.pieces, regions.first
    details = regions.details
    centres, number = fed.centres, fed.number
    around = fed.around
    pixel = fed.pixel
    away = 0
    u = np.empty((DIMENSIONS, net.shape[1]))
    polygon = np.empty((3, MOST_PIECES * ROOM))
    counts, areas = np.empty(MOST_PIECES, np.int64), np.empty(MOST_PIECES)
    if sure is not None:
        divided = Divided(
            polygon,
            np.empty((3, MOST_PIECES * ROOM)),
            np.empty((3, ROOM)),
            np.empty((MOST_PIECES, 3), np.int64),
            np.empty((MOST_PIECES, 2)),
            np.empty((MOST_PIECES, STEPS)),
        )
    path, end = start, start + n
    while path < end:
        p, replicate, index = path_place(path, samples, streams)
        run = min(replicate_size(replicate, samples, streams) - index, end - path)
        key = set_key(stream(batch.seed, number[p], batch.first_stream + replicate), 0)
        for dimension in range(DIMENSIONS):
            _fill_coordinates(u, net, dimension, index, run, key)
        if around is not None:
            bending = set_key(stream(batch.seed, number[p], batch.first_stream + replicate), BEND_SET)
            source, low, high, still = -3, 0, 0, False
        else:
            low, high = first[p], first[p + 1]
            still = _is_still(pieces, low, high)
        if sure is not None:
            for c in range(min(high - low, MOST_PIECES)):
                divided.corners[c, 2] = 0
        for k in range(run):
            at = path - start + k
            ray, i = blocks[(at // BLOCK) * RAY : (at // BLOCK + 1) * RAY], at % BLOCK
            across, down = u[0, k] - 0.5, u[1, k] - 0.5
            dx, dy = pixel.width * across, pixel.height * down
            if pixel.skew is not None:
                dx, dy = dx + pixel.skew[0] * down, dy + pixel.skew[1] * across
            place, on_sensor, random = (dx, dy), (centres[p, 0] + dx, centres[p, 1] + dy), (u[2, k], u[3, k])
            if around is not None:
                point = set_index(batch.first_index + index + k, bending, BEND_SET)
                wavelength = at_wavelength(around.bend.wavelengths, bends.waves, at)
                two = sample(point, 0, bending), sample(point, 1, bending)
                before = source
                on_sensor, source, counts_as = _from_where(around, p, on_sensor, wavelength, two)
                if source < 0 or first[source] == first[source + 1]:
                    _lose(ray, i, BENT_IN if source == -2 else MISSED)
                    if sure is not None:
                        _lose(sure[(at // BLOCK) * RAY : (at // BLOCK + 1) * RAY], i, 0.0)
                    if source == -1:
                        bends.far[away] = at
                        away += 1
                        _keep(ray, i, on_sensor, random, counts_as)
                    continue
                place = on_sensor[0] - around.centres[source, 0], on_sensor[1] - around.centres[source, 1]
                if source != before:
                    low, high = first[source], first[source + 1]
                    still = _is_still(pieces, low, high)
                    if sure is not None:
                        for c in range(min(high - low, MOST_PIECES)):
                            divided.corners[c, 2] = 0
            if sure is not None:
                beside = sure[(at // BLOCK) * RAY : (at // BLOCK + 1) * RAY]
                if high - low <= MOST_PIECES:
                    divide(divided, regions, (low, high), place)
                    chosen = aim_divided(ray, beside, i, divided, regions, (low, high), (on_sensor, place), random)
                else:
                    chosen = _aim_still(ray, i, regions, (low, high), (on_sensor, place), random)
                    aim_at(beside, i, pieces[chosen], (0.0, 0.0), on_sensor, 0.0)
            elif still:
                chosen = _aim_still(ray, i, regions, (low, high), (on_sensor, place), random)
            else:
                room = polygon, counts, areas
                chosen = _aim_moving(ray, i, room, regions, (low, high), (on_sensor, place), random)
            if details is not None:
                own[at] = details[chosen]
                if around is not None:
                    _counted(ray, i, details[chosen], counts_as)
            if fed.spread is not None:
                wavelength, aside = at_wavelength(fed.spread.wavelengths, bends.waves, at), False
                if details is not None:
                    aside = fed.spread.kinds > 1 and details[chosen].clip < 0.0
                bends.spots[at] = _spot(fed.spread, wavelength, on_sensor, aside, (u[0, k], u[1, k]))
        path += run
    pad(blocks, n)
    if sure is not None:
        pad(sure, n)
    return away


@kernel
def fill_far_samples(blocks, own, far, regions):
    """Start the paths of numbers `far` (n,) from where their light was headed, towards the regions of these points."""
    details = regions.details
    for k in range(far.size):
        ray, i = blocks[(far[k] // BLOCK) * RAY : (far[k] // BLOCK + 1) * RAY], far[k] % BLOCK
        start, random, counts = (ray[X + i], ray[Y + i]), (ray[L + i], ray[M + i]), (ray[Z + i], ray[N + i])
        if regions.first[k] == regions.first[k + 1]:
            _lose(ray, i, MISSED)
            continue
        chosen = aim(ray, i, regions, (regions.first[k], regions.first[k + 1]), start, random)
        if details is not None:
            own[far[k]] = details[chosen]
            _counted(ray, i, details[chosen], counts)


@device
def bend_at_pupil(ray, i, z, by):
    """Bend a ray by direction cosines where it passes a plane z; it starts where it would have crossed its own z.

    Light that would be deflected by more than a right angle does not go on.
    """
    t = (z - ray[Z + i]) / ray[N + i]
    x, y = ray[X + i] + t * ray[L + i], ray[Y + i] + t * ray[M + i]
    l, m = ray[L + i] + by[0], ray[M + i] + by[1]
    n = math.copysign(math.sqrt(max(1.0 - l * l - m * m, 0.0)), ray[N + i])
    if n != 0.0:
        t = (ray[Z + i] - z) / n
        ray[X + i], ray[Y + i] = x + t * l, y + t * m
        ray[L + i], ray[M + i], ray[N + i] = l, m, n
    elif ray[STATUS + i] == 0.0:
        ray[WEIGHT + i], ray[STATUS + i] = 0.0, MISSED


@kernel
def fill_bent_at_iris(blocks, start, n, batch, number, waves, iris):
    """Bend paths start ... start + n - 1 of a batch at the entrance pupil; `number` are those of the pixels."""
    for k in range(n):
        pixel, replicate, index = path_place(start + k, batch.samples, batch.streams)
        key = set_key(stream(batch.seed, number[pixel], batch.first_stream + replicate), BEND_SET)
        point = set_index(batch.first_index + index, key, BEND_SET)
        wavelength = at_wavelength(iris.wavelengths, waves, k)
        by_x, by_y, _, _ = sample_deflection(iris.field, sample(point, 2, key), sample(point, 3, key))
        ray = blocks[(k // BLOCK) * RAY : (k // BLOCK + 1) * RAY]
        bend_at_pupil(ray, k % BLOCK, iris.z, (wavelength * by_x, wavelength * by_y))


@kernel
def fill_waves(waves, start, n, batch, number, cdf, guide):
    """Number of the wavelength of each path of a bundle, drawn by the cumulative probabilities `cdf`.

    `number` are those of the pixels. `guide` says from which wavelength on to look for a number u between 0 and 1:
    guide[int(u guide.size)] is the first whose cdf is above the beginning of that interval (H.-C. Chen, Y. Asau, AIIE
    Transactions 6, 1974).
    """
    samples, streams = batch.samples, batch.streams
    path, end = start, start + n
    while path < end:
        pixel, replicate, index = path_place(path, samples, streams)
        run = min(replicate_size(replicate, samples, streams) - index, end - path)
        key = set_key(stream(batch.seed, number[pixel], batch.first_stream + replicate), COLOUR_SET)
        scrambling = np.uint32(mix(key, np.uint64(0)))
        for k in range(run):
            point = set_index(batch.first_index + index + k, key, COLOUR_SET)
            u = to_unit(scramble_reversed(reversed_point(point, 0), scrambling))
            wave = guide[int(u * guide.size)]
            while cdf[wave] <= u:
                wave += 1
            waves[path - start + k] = wave
        path += run
    for k in range(n, waves.size):
        waves[k] = 0
