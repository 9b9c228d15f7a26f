"""Flights of rays in scattering media, and directions from their ends: kernels.

Media are homogeneous: distances are drawn in closed form, which is delta tracking without null collisions.
"""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.kernels.sincos import turn
from plenoptic.core.kernels.sobol import random_number
from plenoptic.core.kernels.vectors import add, dot, fill_vector, frame_about, row_vector, scale
from plenoptic.core.kernels.wavelengths import row_channel, wavelength_index
from plenoptic.core.numba.jit import device, kernel
from plenoptic.scene.materials.kernels.absorption import innermost

_ROULETTE = np.uint64(314)


@kernel
def end_flights(distances, flights, queue, hits, media, wavelengths):
    """Draw where rays scatter in the medium around them; those that do before their reach lose their hit.

    `distances` (n,) are those to there in mm, inf for rays that do not scatter; rays begin behind the transparent
    surfaces that they have passed, so that distances may be negative. They follow the scattering coefficient of one
    channel, drawn by its throughput (row 1 of the random numbers), and weights the mean of all densities, so that none
    is large. Absorption of rays that reach their hit is that of `fill_absorption`.
    """
    reach, random = flights.reach, flights.distance_random
    path_of, throughput, inside_of = queue.path, queue.throughput, queue.media
    triangle_hit, travelled = hits.triangle, hits.travelled
    scattering, extinction = media.scattering, media.extinction
    waves = wavelengths.number
    basis = wavelengths.basis
    channels = throughput.shape[1]
    for i in range(distances.size):
        distances[i] = math.inf
        inside = innermost(inside_of[i])
        if inside < 0:
            continue
        wave = wavelength_index(waves, path_of[i])
        total, largest = 0.0, 0.0
        for c in range(channels):
            total += throughput[i, c]
            largest = max(largest, row_channel(scattering, inside, c, basis, wave))
        if not total > 0.0 or not largest > 0.0:
            continue
        chosen, lot = 0, random[1, i] * total
        while chosen < channels - 1 and lot >= throughput[i, chosen]:
            lot -= throughput[i, chosen]
            chosen += 1
        coefficient = row_channel(scattering, inside, chosen, basis, wave)
        distance = -math.log1p(-random[0, i]) / coefficient if coefficient > 0.0 else math.inf
        ends = distance < reach[i]
        flight = distance if ends else reach[i]
        if flight == math.inf:
            # It leaves the scene, which has no sky.
            continue
        density = 0.0
        for c in range(channels):
            coefficient = row_channel(scattering, inside, c, basis, wave)
            of_channel = math.exp(-coefficient * flight) * (coefficient if ends else 1.0)
            density += throughput[i, c] / total * of_channel
        for c in range(channels):
            coefficient = row_channel(scattering, inside, c, basis, wave)
            loss = row_channel(extinction, inside, c, basis, wave) if ends else coefficient
            left = math.exp(-loss * flight) * (coefficient if ends else 1.0)
            throughput[i, c] *= left / density if density > 0.0 else 0.0
        if ends:
            distances[i] = distance
            if travelled is not None:
                distances[i] -= travelled[i]
            triangle_hit[i] = -1


@device
def phase(cosine, g):
    """Density in 1/sr of a direction at an angle with the one before."""
    s = 1.0 + g * g - 2.0 * g * cosine
    return (1.0 - g * g) / (4.0 * math.pi * s * math.sqrt(s))


@device
def phase_cosine(u, g):
    """Cosine of the angle that a random number draws, written without a division by g."""
    s = 2.0 * u - 1.0
    over = 1.0 + g * s
    cosine = (s + 0.5 * g * (s * s + 3.0) + g * g * s + 0.5 * g * g * g * (s * s - 1.0)) / (over * over)
    return min(1.0, max(-1.0, cosine))


@kernel
def scatter_in_media(new, n_rays, distances, flights, queue, media, russian_roulette):
    """Append rays from where rays scatter, by rows 2 and 3 of their random numbers; return the number of all rays.

    With Russian roulette, paths survive with the probability of their largest throughput. The density of a direction
    includes the ray's chance to scatter: all flights are lit, but few scatter in thin media, and multiple importance
    sampling prefers the light that is drawn.
    """
    random = flights.light_random
    for i in range(distances.size):
        if distances[i] == math.inf:
            continue
        largest, factor = 0.0, 1.0
        for c in range(queue.throughput.shape[1]):
            largest = max(largest, queue.throughput[i, c])
        if not largest > 0.0:
            continue
        if russian_roulette and largest < 1.0:
            if random_number(flights.key[i], flights.number[i], _ROULETTE) >= largest:
                continue
            factor = 1.0 / largest
        g = media.asymmetry[innermost(queue.media[i])]
        before = row_vector(queue.rays, i, 3)
        p, q = frame_about(before)
        cosine = phase_cosine(random[2, i], g)
        sine = math.sqrt(max(0.0, 1.0 - cosine * cosine))
        c_turn, s_turn = turn(random[3, i])
        w = add(add(scale(p, sine * c_turn), scale(q, sine * s_turn)), scale(before, cosine))
        fill_vector(new.rays, n_rays, 0, add(row_vector(queue.rays, i, 0), scale(before, distances[i])))
        fill_vector(new.rays, n_rays, 3, scale(w, 1.5 - 0.5 * dot(w, w)))
        new.path[n_rays] = queue.path[i]
        new.pdf[n_rays] = phase(cosine, g) * flights.chance[i]
        for c in range(queue.throughput.shape[1]):
            new.throughput[n_rays, c] = queue.throughput[i, c] * factor
        for k in range(queue.media.shape[1]):
            new.media[n_rays, k] = queue.media[i, k]
        if new.rough is not None:
            new.rough[n_rays] = 1
        n_rays += 1
    return n_rays
