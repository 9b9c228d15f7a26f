"""Where paths start: a point on a pixel and a point in the region that feeds it."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.jit import device, kernel
from plenoptic.core.kernels.bundles import pad
from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, STATUS, WEIGHT, L, M, N, X, Y, Z
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
def _find(triangles, low, high, area):
    """The triangle between low and high - 1 whose part of the summed area holds `area`."""
    while high - low > _FEW:
        middle = (low + high) // 2
        if triangles[middle - 1].area > area:
            high = middle
        else:
            low = middle
    # Counting has no branch that a processor could guess wrong.
    k = low
    for i in range(low, high - 1):
        k += 1 if triangles[i].area <= area else 0
    return k


@device
def aim(ray, i, triangles, region, start, random):
    """Point of a region by areas: one random number finds the triangle and, stretched, with the other the point in it.

    `region` is the first triangle and the end of the region's, `start` x and y on the sensor. Returns the triangle.
    """
    low, high = region
    u, v = random
    total = triangles[high - 1].area
    wanted = u * total
    k = _find(triangles, low, high, wanted)
    # Read first: behind the triangle, this branch is one that the processor guesses, and costs 20 ns a path.
    before = 0.0
    if k > low:
        before = triangles[k - 1].area
    triangle = triangles[k]
    root = math.sqrt(min(max((wanted - before) / (triangle.area - before), 0.0), 1.0))
    a, b = root * (1.0 - v), root * v
    mx = triangle.x + a * triangle.ax + b * triangle.bx
    my = triangle.y + a * triangle.ay + b * triangle.by
    ray[X + i] = mx
    ray[Y + i] = my
    ray[L + i] = mx - start[0]
    ray[M + i] = my - start[1]
    ray[Z + i] = triangle.axis_x
    ray[N + i] = triangle.axis_y
    ray[WEIGHT + i] = total
    ray[STATUS + i] = 0.0
    return k


@device
def _fill_coordinates(u, net, dimension, index, run, key):
    """Scrambled coordinates of points index ... index + run - 1 of a net."""
    seed = np.uint32(mix(key, np.uint64(dimension)))
    for k in range(run):
        u[dimension, k] = to_unit(scramble_reversed(net[dimension, index + k], seed))


@kernel
def fill_camera_samples(blocks, own, start, n, batch, fed, pixel):
    """Start paths start ... start + n - 1 of a batch of the pixels of a tile, which are `FedPixels`.

    A pixel is a `PixelRecord`; one that is turned has the sides (width, skew[1]) and (skew[0], height). `own` gets what
    the microlenses of the paths are, where they differ.
    """
    net, samples, streams = batch.net, batch.samples, batch.streams
    triangles, first = fed.regions.triangles, fed.regions.first
    centres, number = fed.centres, fed.number
    u = np.empty((DIMENSIONS, net.shape[1]))
    width, height = pixel.width, pixel.height
    path = start
    end = start + n
    while path < end:
        p, replicate, index = path_place(path, samples, streams)
        run = min(replicate_size(replicate, samples, streams) - index, end - path)
        key = set_key(stream(batch.seed, number[p], batch.first_stream + replicate), 0)
        for dimension in range(DIMENSIONS):
            _fill_coordinates(u, net, dimension, index, run, key)
        region = first[p], first[p + 1]
        corner_x = centres[p, 0] - 0.5 * width
        corner_y = centres[p, 1] - 0.5 * height
        for k in range(run):
            at = path - start + k
            base = (at // BLOCK) * RAY
            sx, sy = corner_x + width * u[0, k], corner_y + height * u[1, k]
            if pixel.skew is not None:
                sx += pixel.skew[0] * (u[1, k] - 0.5)
                sy += pixel.skew[1] * (u[0, k] - 0.5)
            chosen = aim(blocks[base : base + RAY], at % BLOCK, triangles, region, (sx, sy), (u[2, k], u[3, k]))
            if fed.regions.details is not None:
                own[at] = fed.regions.details[chosen]
        path += run
    pad(blocks, n)


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
