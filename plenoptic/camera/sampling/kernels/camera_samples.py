"""Camera samples: a point on a pixel, and a point in the aperture region of that point."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.camera.sampling.kernels.aimed_rays import displaced_point, set_aimed_ray
from plenoptic.camera.sampling.kernels.path_numbers import DEFLECTION_SET, WAVELENGTH_SET, path_indices, replicate_size
from plenoptic.camera.sampling.kernels.region_polygons import MAX_PIECES
from plenoptic.camera.sampling.kernels.round_pieces import aim_round_run, point_in_ellipse
from plenoptic.camera.sampling.kernels.unvignetted_core import (
    MAX_CLIPPED_CORNERS,
    MAX_RIMS,
    SplitRegion,
    aim_with_core,
    fill_clipped_piece,
    split_region,
)
from plenoptic.camera.sampling.sampling_records import FAR, GROUP_SIDE
from plenoptic.core.kernels.bundles import pad
from plenoptic.core.kernels.polygons import area_of, point_in
from plenoptic.core.kernels.ray_blocks import BENT_IN, BLOCK, MISSED, RAY, STATUS, WEIGHT, L, M, N, X, Y, Z
from plenoptic.core.kernels.sobol import (
    DIMENSIONS,
    mix,
    reversed_point,
    sample,
    scramble_bits,
    set_index,
    set_key,
    stream,
    to_unit,
)
from plenoptic.core.numba.jit import device, kernel
from plenoptic.optics.diffraction.kernels.far_field import sample_deflection
from plenoptic.optics.microlens.kernels.to_lens import at_wavelength

_FEW = 8
"""Pieces among which a linear search is faster than bisection."""
_UNSET, _OUTSIDE, _DARK, _DISTANT = -4, -3, -2, -1
"""In place of the index of a source pixel: none yet; too far outside the sensor; no light is aimed there; farther than
`DeflectionRecord.near`."""
_LIT_DRAWS, _MAX_DRAWS, _DRAWS = 4, 16, 100
"""Deflections from lit places that are drawn for a path, most deflections in all, and the first of the numbers that
distinguish them."""


@device
def _first_exceeding(pieces, low, high, area):
    """First of the pieces low ... high - 1 whose cumulative area exceeds `area`; the last one if none does."""
    while high - low > _FEW:
        middle = (low + high) // 2
        if pieces[middle - 1].area > area:
            high = middle
        else:
            low = middle
    # Counting has no branch that a processor could mispredict.
    k = low
    for i in range(low, high - 1):
        k += 1 if pieces[i].area <= area else 0
    return k


@device
def aim_sample(ray, i, regions, region, start, random):
    """Aim path i at a point of a region that is not clipped, uniformly by area; return the index of its piece.

    The first random number selects the piece and, stretched, the triangle of its fan; the second one the point in it.
    In ellipses they are the squared radius and the angle.
    `region` is the first and the end of its pieces; `start` is the point on the sensor, and the same point relative to
    the centre of the area that the region represents, such as the pixel.
    """
    pieces, (low, high) = regions.pieces, region
    total_area = pieces[high - 1].area
    remainder = random[0] * total_area
    k = _first_exceeding(pieces, low, high, remainder)
    # Read first: after the piece is read, this branch is mispredicted, and costs 20 ns a path.
    if k > low:
        remainder -= pieces[k - 1].area
    piece = pieces[k]
    if piece.is_round == 1:
        part = remainder / (piece.area - (pieces[k - 1].area if k > low else 0.0))
        point = point_in_ellipse(regions.corners, piece.first_corner, part, random[1])
    else:
        point = point_in(regions.corners, piece.first_corner, piece.corners, remainder, random[1])
    set_aimed_ray(ray, i, piece, displaced_point(piece, point, start[1]), start[0], total_area)
    return k


@device
def _fill_coordinates(u, net, dimension, index, run, key):
    """Scrambled coordinates of points index ... index + run - 1 of a net."""
    seed = np.uint32(mix(key, np.uint64(dimension)))
    for k in range(run):
        u[dimension, k] = to_unit(scramble_bits(net[dimension, index + k], seed))


@device
def _is_constant(pieces, low, high):
    """True if a region is the same for all points of its pixel: no planes clip its pieces."""
    constant = True
    for k in range(low, high):
        constant = constant and pieces[k].planes == 0
    return constant


@device
def _sample_source(sources, first, p, point, wavelength, path):
    """Draw deflections by diffraction of light that arrives at a point of pixel p, until k have light aimed there.

    Returns the first one with light, see `_draw_source`, or the last one if all are dark. The weights are times an
    unbiased estimate of the probability of light: (k - 1) / (n - 1) if draw n is the k-th one with light, and the
    fraction of draws with light if fewer than k have it (M. A. Girshick, F. Mosteller and L. J. Savage, Annals of
    Mathematical Statistics 17, 13 (1946)). `path` is the key of the deflections and the index of the path.
    """
    key, index = path
    aimed, source, weights, fraction, n_lit = point, _DARK, (0.0, 0.0), 0.0, 0
    for n in range(1, _MAX_DRAWS + 1):
        point_index = set_index(index, key, DEFLECTION_SET)
        random = sample(point_index, 0, key), sample(point_index, 1, key)
        draw = _draw_source(sources, first, p, point, wavelength, random)
        lit = draw[1] == _DISTANT or draw[1] >= 0
        if n_lit == 0:
            aimed, source, weights = draw
        n_lit += 1 if lit else 0
        fraction = n_lit / n
        if n_lit == _LIT_DRAWS:
            fraction = (_LIT_DRAWS - 1.0) / (n - 1)
            break
        key = mix(path[0], np.uint64(_DRAWS + n))
    return aimed, source, (fraction * weights[0], fraction * weights[1])


@device
def _draw_source(sources, first, p, point, wavelength, random):
    """Draw the deflection by diffraction of light that arrives at a point of pixel p.

    Returns the point at which the light was aimed, the index of its source pixel (or _DISTANT, _DARK or _OUTSIDE), and
    the weights of paths through openings and through gaps.
    """
    frame = sources.deflection
    h = sources.plane.distance
    if sources.plane.tilt is not None:
        h += sources.plane.tilt[0] * point[0] + sources.plane.tilt[1] * point[1]
    by_x, by_y, opening_weight, gap_weight = sample_deflection(frame.field, random[0], random[1])
    x, y = point[0] - h * wavelength * by_x, point[1] - h * wavelength * by_y
    dx, dy = x - frame.shift[0], y - frame.shift[1]
    rows, columns = sources.shape
    column = 0.5 * columns - (frame.back[0, 0] * dx + frame.back[0, 1] * dy)
    row = 0.5 * rows + (frame.back[1, 0] * dx + frame.back[1, 1] * dy)
    source = _OUTSIDE
    border = frame.border
    if -border <= row < rows + border and -border <= column < columns + border:
        source, i, j = _DISTANT, math.floor(row), math.floor(column)
        distance = max(abs(i - sources.pixels[p, 0]), abs(j - sources.pixels[p, 1]))
        if distance <= frame.near:
            source = sources.grid[i - sources.corner[0], j - sources.corner[1]]
            if first[source] == first[source + 1]:
                source = _DARK
        elif distance <= FAR:
            i, j = i // GROUP_SIDE - sources.first_group[0], j // GROUP_SIDE - sources.first_group[1]
            if not sources.lit_groups[i, j]:
                source = _DARK
    return (x, y), source, (opening_weight, gap_weight)


@device
def _apply_weight(ray, i, details, chosen, weights):
    """Multiply the weight of a deflected path by that of the opening or the gap; see `_sample_source`."""
    through_gap = False
    if details is not None:
        through_gap = details[chosen].clip < 0.0
    ray[WEIGHT + i] *= weights[1] if through_gap else weights[0]


@device
def _aim_varying(ray, i, workspace, regions, region, start, random):
    """Aim path i at a region that varies over its pixel, clipped in a workspace; return the index of the piece."""
    polygon, counts, areas = workspace
    low, high = region
    on_sensor, in_pixel = start
    pieces, total_area = regions.pieces, 0.0
    for c in range(high - low):
        first = c * MAX_CLIPPED_CORNERS
        counts[c] = fill_clipped_piece(polygon, first, regions.corners, regions.planes, pieces[low + c], in_pixel)
        areas[c] = area_of(polygon, first, counts[c]) if counts[c] >= 3 else 0.0
        total_area += areas[c]
    c, remainder = 0, random[0] * total_area
    while c < high - low - 1 and remainder >= areas[c]:
        remainder -= areas[c]
        c += 1
    k, point = low + c, (0.0, 0.0)
    if areas[c] > 0.0:
        if pieces[k].is_round == 1:
            part = min(remainder / areas[c], 1.0)
            point = point_in_ellipse(regions.corners, pieces[k].first_corner, part, random[1])
        else:
            point = point_in(polygon, c * MAX_CLIPPED_CORNERS, counts[c], remainder, random[1])
    set_aimed_ray(ray, i, pieces[k], displaced_point(pieces[k], point, in_pixel), on_sensor, total_area)
    if not areas[c] > 0.0:
        ray[WEIGHT + i], ray[STATUS + i] = 0.0, MISSED
    return k


@device
def _set_lost(ray, i, status):
    """Set a path without light."""
    ray[X + i], ray[Y + i], ray[L + i], ray[M + i], ray[Z + i], ray[N + i] = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    ray[WEIGHT + i], ray[STATUS + i] = 0.0, status


@device
def _kernel_row(kernel_table, wavelength, start, through_gap, places):
    """Row of a `KernelTable` for a path of a wavelength from a point and its places in the pixel."""
    h = kernel_table.plane.distance
    if kernel_table.plane.tilt is not None:
        h += kernel_table.plane.tilt[0] * start[0] + kernel_table.plane.tilt[1] * start[1]
    scale = int((wavelength * h - kernel_table.lowest_scale) * kernel_table.scales_per_area)
    scale = min(max(scale, 0), kernel_table.scales - 1)
    row = scale * kernel_table.patterns + (1 if through_gap else 0)
    across, down = int(places[0] * kernel_table.subdivisions), int(places[1] * kernel_table.subdivisions)
    return (row * kernel_table.subdivisions + down) * kernel_table.subdivisions + across


@kernel
def fill_camera_samples(blocks, core, lenslets, deflected, start, n, batch, illuminated):
    """Sample paths start ... start + n - 1 of a batch of the pixels of a tile, which are `IlluminatedPixels`.

    Each path draws a point on the pixel, then a point in the aperture region of that point; paths from points without
    a region are lost. X, Y of a path get the point on the array, L, M its offset from the point on the sensor, Z, N the
    axis of the microlens and WEIGHT the area of the region in mm^2; the kernels of the microlens model make rays of
    them. A rotated pixel has the sides (width, skew[1]) and (skew[0], height). `lenslets` is filled with
    the parameters of each path's microlens, where these differ.

    If `core` is not None, it is filled with rays through the unvignetted core, which need not be traced; the paths are
    then drawn in the rims around the cores.

    With diffraction, a path starts at the point at which its light was aimed. Paths from distant pixels are left to
    `fill_distant_samples`; `DeflectedSamples` gets their indices. Returns their number. With a diffraction kernel,
    `DeflectedSamples` gets the row of the `KernelTable` of each path.
    """
    net, samples, streams = batch.net, batch.samples, batch.streams
    regions = illuminated.regions
    pieces, first = regions.pieces, regions.first
    details = regions.details
    centres, number = illuminated.centres, illuminated.number
    sources = illuminated.sources
    pixel = illuminated.pixel
    n_distant = 0
    u = np.empty((DIMENSIONS, net.shape[1]))
    points = np.empty((4, BLOCK))
    polygon = np.empty((3, MAX_PIECES * MAX_CLIPPED_CORNERS))
    counts, areas = np.empty(MAX_PIECES, np.int64), np.empty(MAX_PIECES)
    if core is not None:
        split = SplitRegion(
            polygon,
            np.empty((3, MAX_PIECES * MAX_CLIPPED_CORNERS)),
            np.empty((3, MAX_CLIPPED_CORNERS)),
            np.empty((MAX_PIECES, 3), np.int64),
            np.empty((MAX_PIECES, 2)),
            np.empty((MAX_PIECES, MAX_RIMS)),
        )
    path, end = start, start + n
    while path < end:
        p, replicate, index = path_indices(path, samples, streams)
        run = min(replicate_size(replicate, samples, streams) - index, end - path)
        key = set_key(stream(batch.seed, number[p], batch.first_stream + replicate), 0)
        for dimension in range(DIMENSIONS):
            _fill_coordinates(u, net, dimension, index, run, key)
        if sources is not None:
            deflection_key = set_key(stream(batch.seed, number[p], batch.first_stream + replicate), DEFLECTION_SET)
        source, low, high, constant = _UNSET, 0, 0, False
        if core is None and details is None and sources is None and illuminated.kernel is None and pixel.skew is None:
            low, high = first[p], first[p + 1]
            if high == low + 1 and pieces[low].is_round == 1:
                place = low, pixel, (centres[p, 0], centres[p, 1])
                aim_round_run(blocks, path - start, run, points, u, regions, place)
                path += run
                continue
        for k in range(run):
            at = path - start + k
            ray, i = blocks, (at // BLOCK) * RAY + at % BLOCK
            # A point on the pixel.
            across, down = u[0, k] - 0.5, u[1, k] - 0.5
            dx, dy = pixel.width * across, pixel.height * down
            if pixel.skew is not None:
                dx, dy = dx + pixel.skew[0] * down, dy + pixel.skew[1] * across
            in_pixel, on_sensor, random = (dx, dy), (centres[p, 0] + dx, centres[p, 1] + dy), (u[2, k], u[3, k])
            previous_source, source = source, p
            if sources is not None:
                # The point at which its light was aimed, before diffraction.
                wavelength = at_wavelength(sources.deflection.wavelengths, deflected.waves, at)
                path_key = deflection_key, batch.first_index + index + k
                on_sensor, source, weights = _sample_source(sources, first, p, on_sensor, wavelength, path_key)
                if source < 0:
                    _set_lost(ray, i, BENT_IN if source == _OUTSIDE else MISSED)
                    if core is not None:
                        _set_lost(core, i, 0.0)
                    if source == _DISTANT:
                        deflected.distant[n_distant] = at
                        n_distant += 1
                        # What `fill_distant_samples` needs of the path.
                        (ray[X + i], ray[Y + i]), (ray[L + i], ray[M + i]) = on_sensor, random
                        ray[Z + i], ray[N + i] = weights
                    continue
                in_pixel = on_sensor[0] - sources.centres[source, 0], on_sensor[1] - sources.centres[source, 1]
            # The region of that point.
            if source != previous_source:
                low, high = first[source], first[source + 1]
                constant = _is_constant(pieces, low, high)
                if core is not None:
                    for c in range(min(high - low, MAX_PIECES)):
                        split.corners[c, 2] = 0
            # A point in the region.
            region, start_point = (low, high), (on_sensor, in_pixel)
            if core is not None:
                core_ray = core
                if high - low <= MAX_PIECES:
                    split_region(split, regions, region, in_pixel)
                    chosen = aim_with_core(ray, core_ray, i, split, regions, region, start_point, random)
                else:
                    chosen = aim_sample(ray, i, regions, region, start_point, random)
                    set_aimed_ray(core_ray, i, pieces[chosen], (0.0, 0.0), on_sensor, 0.0)
            elif constant:
                chosen = aim_sample(ray, i, regions, region, start_point, random)
            else:
                chosen = _aim_varying(ray, i, (polygon, counts, areas), regions, region, start_point, random)
            if details is not None:
                lenslets[at] = details[chosen]
            if sources is not None:
                _apply_weight(ray, i, details, chosen, weights)
                if core is not None:
                    _apply_weight(core_ray, i, details, chosen, weights)
            if illuminated.kernel is not None:
                wavelength, through_gap = at_wavelength(illuminated.kernel.wavelengths, deflected.waves, at), False
                if details is not None:
                    through_gap = illuminated.kernel.patterns > 1 and details[chosen].clip < 0.0
                places = u[0, k], u[1, k]
                deflected.kernel_rows[at] = _kernel_row(illuminated.kernel, wavelength, on_sensor, through_gap, places)
        path += run
    pad(blocks, n)
    if core is not None:
        pad(core, n)
    return n_distant


@kernel
def fill_distant_samples(blocks, lenslets, distant, regions):
    """Aim paths `distant` (n,) from the points at which their light was aimed, towards the regions of these points."""
    details = regions.details
    for k in range(distant.size):
        ray, i = blocks, (distant[k] // BLOCK) * RAY + distant[k] % BLOCK
        start, random, weights = (ray[X + i], ray[Y + i]), (ray[L + i], ray[M + i]), (ray[Z + i], ray[N + i])
        if regions.first[k] == regions.first[k + 1]:
            _set_lost(ray, i, MISSED)
            continue
        region = regions.first[k], regions.first[k + 1]
        chosen = aim_sample(ray, i, regions, region, (start, (0.0, 0.0)), random)
        if details is not None:
            lenslets[distant[k]] = details[chosen]
        _apply_weight(ray, i, details, chosen, weights)


@kernel
def fill_waves(waves, start, n, batch, number, cdf, guide):
    """Draw the wavelength index of each path of a bundle from the cumulative probabilities `cdf`.

    `number` are the numbers of the pixels. `guide` is the guide table of the inversion: guide[int(u guide.size)] is the
    first index whose cdf is above the beginning of that interval of u (H.-C. Chen, Y. Asau, AIIE Transactions 6, 1974).
    """
    samples, streams = batch.samples, batch.streams
    path, end = start, start + n
    while path < end:
        pixel, replicate, index = path_indices(path, samples, streams)
        run = min(replicate_size(replicate, samples, streams) - index, end - path)
        key = set_key(stream(batch.seed, number[pixel], batch.first_stream + replicate), WAVELENGTH_SET)
        scrambling = np.uint32(mix(key, np.uint64(0)))
        for k in range(run):
            point = set_index(batch.first_index + index + k, key, WAVELENGTH_SET)
            u = to_unit(scramble_bits(reversed_point(point, 0), scrambling))
            wave = guide[int(u * guide.size)]
            while cdf[wave] <= u:
                wave += 1
            waves[path - start + k] = wave
        path += run
    for k in range(n, waves.size):
        waves[k] = 0
