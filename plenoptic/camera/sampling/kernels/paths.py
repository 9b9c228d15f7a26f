"""Where paths start: a point on a pixel and a point in the region that feeds it."""

from __future__ import annotations

import numpy as np

from plenoptic.camera.sampling.kernels.parts import ROOM, STEPS, Divided, aim_at, aim_divided, divide, fill_part, moved
from plenoptic.camera.sampling.kernels.pixel_regions import MOST_PIECES
from plenoptic.core.jit import device, kernel
from plenoptic.core.kernels.bundles import pad
from plenoptic.core.kernels.polygons import area_of, point_in
from plenoptic.core.kernels.ray_blocks import BLOCK, MISSED, RAY, STATUS, WEIGHT
from plenoptic.core.kernels.sobol import (
    DIMENSIONS,
    mix,
    reversed_point,
    scramble_reversed,
    set_index,
    set_key,
    stream,
    to_unit,
)

_FEW = 8


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
    """The piece of a region, its first and the end of its pieces, by areas; with the area of all, and what is left."""
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
    """Whether a region has the same area for all points of its pixel."""
    still = True
    for k in range(low, high):
        still = still and pieces[k].planes == 0
    return still


@device
def _aim_still(ray, i, regions, region, place, random):
    """Start path i towards a region that is the same for all points of its pixel; returns the piece."""
    total, chosen, left = choose(regions.pieces, region, random[0])
    piece = regions.pieces[chosen]
    point = point_in(regions.corners, piece.first_corner, piece.corners, left, random[1])
    aim_at(ray, i, piece, moved(piece, point, place[1]), place[0], total)
    return chosen


@kernel
def fill_camera_samples(blocks, sure, own, start, n, batch, fed, pixel):
    """Start paths start ... start + n - 1 of a batch of the pixels of a tile, which are `FedPixels`.

    A pixel is a `PixelRecord`; one that is turned has the sides (width, skew[1]) and (skew[0], height). `own` gets what
    the microlenses of the paths are, where they differ. Of each path, first the point on the pixel is drawn, then one
    of what feeds that very point; paths from points that nothing feeds are lost.

    With `sure`, blocks as well, what surely passes the lens is aimed there and need not be traced, and paths are drawn
    in what is left around it.
    """
    net, samples, streams = batch.net, batch.samples, batch.streams
    regions = fed.regions
    pieces, first, corners, planes = regions.pieces, regions.first, regions.corners, regions.planes
    details = regions.details
    centres, number = fed.centres, fed.number
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
                total = 0.0
                for c in range(high - low):
                    counts[c] = fill_part(polygon, c * ROOM, corners, planes, pieces[low + c], place)
                    areas[c] = area_of(polygon, c * ROOM, counts[c]) if counts[c] >= 3 else 0.0
                    total += areas[c]
                c, left = 0, random[0] * total
                while c < high - low - 1 and left >= areas[c]:
                    left -= areas[c]
                    c += 1
                chosen, point = low + c, (0.0, 0.0)
                if areas[c] > 0.0:
                    point = point_in(polygon, c * ROOM, counts[c], left, random[1])
                aim_at(ray, i, pieces[chosen], moved(pieces[chosen], point, place), on_sensor, total)
                if not areas[c] > 0.0:
                    ray[WEIGHT + i], ray[STATUS + i] = 0.0, MISSED
            if details is not None:
                own[at] = details[chosen]
        path += run
    pad(blocks, n)
    if sure is not None:
        pad(sure, n)


COLOUR_SET = 1 << 20
"""Set of the sampling points that draws wavelengths: beyond those of all bounces."""


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
