"""Where paths start: a point on a pixel and a point in the region that feeds it."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.jit import device, kernel
from plenoptic.core.kernels.ray_blocks import BLOCK, MISSED, RAY, STATUS, WEIGHT, L, M, N, X, Y, Z
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
    """The triangle between low and high - 1 whose share of the summed area holds `area`."""
    while high - low > _FEW:
        middle = (low + high) // 2
        if triangles[middle - 1, 6] > area:
            high = middle
        else:
            low = middle
    # Counting has no branch that a processor could guess wrong.
    k = low
    for i in range(low, high - 1):
        k += 1 if triangles[i, 6] <= area else 0
    return k


@device
def aim(ray, i, triangles, low, high, sx, sy, u, v):
    """Point of the region by areas: u finds the triangle, which is returned, and, stretched, with v the point in it."""
    total = triangles[high - 1, 6]
    wanted = u * total
    k = _find(triangles, low, high, wanted)
    before = triangles[k - 1, 6] if k > low else 0.0
    root = math.sqrt(min(max((wanted - before) / (triangles[k, 6] - before), 0.0), 1.0))
    a, b = root * (1.0 - v), root * v
    mx = triangles[k, 0] + a * triangles[k, 2] + b * triangles[k, 4]
    my = triangles[k, 1] + a * triangles[k, 3] + b * triangles[k, 5]
    ray[X + i] = mx
    ray[Y + i] = my
    ray[L + i] = mx - sx
    ray[M + i] = my - sy
    ray[Z + i] = triangles[k, 7]
    ray[N + i] = triangles[k, 8]
    ray[WEIGHT + i] = total
    ray[STATUS + i] = 0.0
    return k


@device
def pad(blocks, n):
    """Fill the last block from ray n on with rays that are lost already."""
    for path in range(n, blocks.size // 8):
        ray = blocks[(path // BLOCK) * RAY : (path // BLOCK + 1) * RAY]
        i = path % BLOCK
        for row in range(8):
            ray[row * BLOCK + i] = 0.0
        ray[STATUS + i] = MISSED


@device
def _fill_coordinates(u, net, dimension, index, run, key):
    """Scrambled coordinates of points index ... index + run - 1 of a net."""
    seed = np.uint32(mix(key, np.uint64(dimension)))
    for k in range(run):
        u[dimension, k] = to_unit(scramble_reversed(net[dimension, index + k], seed))


@kernel
def fill_camera_samples(
    blocks,
    lanes,
    first_path,
    n,
    samples,
    replicates,
    first_replicate,
    seed,
    net,
    pixels,
    number,
    edges,
    skew,
    triangles,
    details,
    first,
):
    """Start paths first_path ... first_path + n - 1 of a tile.

    `net` (4, points) are the bit-reversed Sobol points that all replicates scramble, `first_replicate` is the number of
    the first one, `pixels` (p, 2) the centres of the
    tile's lit pixels, `number` their numbers on the whole sensor, `edges` the width and height of a pixel; a pixel that
    is turned has the sides (edges[0], skew[1]) and (skew[0], edges[1]). The triangles of pixel i are those from
    first[i] to first[i + 1]. `lanes` gets the rows of `details` of the triangles, where there are any.
    """
    u = np.empty((DIMENSIONS, net.shape[1]))
    width, height = edges[0], edges[1]
    path = first_path
    end = first_path + n
    while path < end:
        pixel, replicate, index = path_place(path, samples, replicates)
        run = min(replicate_size(replicate, samples, replicates) - index, end - path)
        key = set_key(stream(seed, number[pixel], first_replicate + replicate), 0)
        for dimension in range(DIMENSIONS):
            _fill_coordinates(u, net, dimension, index, run, key)
        low, high = first[pixel], first[pixel + 1]
        corner_x = pixels[pixel, 0] - 0.5 * width
        corner_y = pixels[pixel, 1] - 0.5 * height
        for k in range(run):
            at = path - first_path + k
            base = (at // BLOCK) * RAY
            sx, sy = corner_x + width * u[0, k], corner_y + height * u[1, k]
            if skew is not None:
                sx += skew[0] * (u[1, k] - 0.5)
                sy += skew[1] * (u[0, k] - 0.5)
            chosen = aim(blocks[base : base + RAY], at % BLOCK, triangles, low, high, sx, sy, u[2, k], u[3, k])
            if details is not None:
                lanes[at] = details[chosen]
        path += run
    pad(blocks, n)


@kernel
def fill_path_keys(keys, indices, first_path, samples, replicates, first_replicate, first_index, seed, number):
    """The random stream of each path of a bundle and the path's number in it."""
    for k in range(keys.size):
        pixel, replicate, index = path_place(first_path + k, samples, replicates)
        keys[k] = stream(seed, number[pixel], first_replicate + replicate)
        indices[k] = first_index + index


COLOUR_SET = 1 << 20
"""Set of the sampling points that draws wavelengths: beyond those of all bounces."""


@kernel
def fill_waves(waves, first_path, n, samples, replicates, first_replicate, first_index, seed, number, cdf, guide):
    """Number of the wavelength of each path of a bundle, drawn by the cumulative probabilities `cdf`.

    `guide` says from which wavelength on to look for a number u between 0 and 1: guide[int(u guide.size)] is the first
    whose cdf is above the beginning of that interval (H.-C. Chen, Y. Asau, AIIE Transactions 6, 1974).
    """
    path, end = first_path, first_path + n
    while path < end:
        pixel, replicate, index = path_place(path, samples, replicates)
        run = min(replicate_size(replicate, samples, replicates) - index, end - path)
        key = set_key(stream(seed, number[pixel], first_replicate + replicate), COLOUR_SET)
        scrambling = np.uint32(mix(key, np.uint64(0)))
        for k in range(run):
            point = set_index(first_index + index + k, key, COLOUR_SET)
            u = to_unit(scramble_reversed(reversed_point(point, 0), scrambling))
            wave = guide[int(u * guide.size)]
            while cdf[wave] <= u:
                wave += 1
            waves[path - first_path + k] = wave
        path += run
    for k in range(n, waves.size):
        waves[k] = 0


@kernel
def fill_sums(sums, blocks, radiance, waves, weights, first_path, n, samples, replicates):
    """Add what the paths of a bundle bring to sums (pixels, replicates, channels), in the order of their numbers.

    `radiance` is (n, channels), or None for 1 everywhere: a white image. With `weights` (wavelengths, channels), each
    path has a wavelength, its radiance is one number, and the weights are what that adds to the channels. Returns how
    many contributions were not finite; these are left out.
    """
    broken = 0
    path = first_path
    end = first_path + n
    while path < end:
        pixel, replicate, index = path_place(path, samples, replicates)
        run = min(replicate_size(replicate, samples, replicates) - index, end - path)
        for c in range(sums.shape[2]):
            total = sums[pixel, replicate, c]
            for k in range(path - first_path, path - first_path + run):
                light = blocks[(k // BLOCK) * RAY + WEIGHT + k % BLOCK]
                if weights is not None:
                    light *= weights[waves[k], c]
                    if radiance is not None:
                        light *= radiance[k, 0]
                elif radiance is not None:
                    light *= radiance[k, c]
                if light - light == 0.0:
                    total += light
                else:
                    broken += 1
            sums[pixel, replicate, c] = total
        path += run
    return broken


@kernel
def fill_clamped(radiance, blocks, n, limit):
    """Scale down what paths bring that is brighter than a limit; returns the light that is kept and that is not."""
    kept, removed = 0.0, 0.0
    for k in range(n):
        brightest, mean = 0.0, 0.0
        for c in range(radiance.shape[1]):
            brightest = max(brightest, radiance[k, c])
            mean += radiance[k, c] / radiance.shape[1]
        light = mean * blocks[(k // BLOCK) * RAY + WEIGHT + k % BLOCK]
        share = 1.0
        if brightest > limit:
            share = limit / brightest
            for c in range(radiance.shape[1]):
                radiance[k, c] *= share
        kept += share * light
        removed += (1.0 - share) * light
    return kept, removed


@kernel
def fill_status_counts(counts, blocks, n):
    """Count the rays of a bundle by their status."""
    for k in range(n):
        counts[int(blocks[(k // BLOCK) * RAY + STATUS + k % BLOCK])] += 1


@kernel
def fill_world_rays(rays, lanes, blocks, n, rotation, position):
    """The rays of a bundle that left the lens, as rows of origin and direction in the world; returns how many.

    `rotation` and `position` are None where the world is the camera's frame.
    """
    found = 0
    for k in range(n):
        base = (k // BLOCK) * RAY + k % BLOCK
        if blocks[base + STATUS] != 0.0:
            continue
        x, y, z = blocks[base + X], blocks[base + Y], blocks[base + Z]
        l, m, n_z = blocks[base + L], blocks[base + M], blocks[base + N]
        row = rays[found]
        if rotation is None:
            row[0], row[1], row[2], row[3], row[4], row[5] = x, y, z, l, m, n_z
        else:
            for axis in range(3):
                row[axis] = rotation[axis, 0] * x + rotation[axis, 1] * y + rotation[axis, 2] * z + position[axis]
                row[3 + axis] = rotation[axis, 0] * l + rotation[axis, 1] * m + rotation[axis, 2] * n_z
        lanes[found] = k
        found += 1
    return found
