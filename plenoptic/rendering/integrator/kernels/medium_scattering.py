"""Flights of rays in scattering media, and directions from their ends: kernels.

Media are homogeneous: distances are drawn in closed form, which is delta tracking without null collisions.
"""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.kernels.sincos import turn
from plenoptic.core.kernels.sobol import random_number
from plenoptic.core.kernels.vectors import add, dot, fill_vector, frame_about, row_vector, scale, sub
from plenoptic.core.kernels.wavelengths import row_channel, wavelength_index
from plenoptic.core.numba.jit import device, kernel
from plenoptic.scene.materials.kernels.absorption import innermost

_ROULETTE = np.uint64(314)
_NEAR, _LEAST_NEARNESS = 0.7, 0.05
"""Distance from the middle of the scene over `Lights.far` that is near, and least probability of paths to go on from
far away."""


@kernel
def list_flights(flights, queue, media, wavelengths):
    """Fill the rays that fly in a scattering medium, and their chance to scatter; return their number."""
    ray, path, reach, chance = flights.ray, flights.path, flights.reach, flights.chance
    throughput, scattering = queue.throughput, media.scattering
    waves = wavelengths.number
    basis = wavelengths.basis
    count = 0
    for i in range(reach.size):
        inside = innermost(queue.media[i])
        if inside < 0 or not reach[i] > 0.0:
            continue
        wave = wavelength_index(waves, queue.path[i])
        total, scattered = 0.0, 0.0
        for c in range(throughput.shape[1]):
            coefficient = row_channel(scattering, inside, c, basis, wave)
            total += throughput[i, c]
            if coefficient > 0.0:
                scattered -= throughput[i, c] * math.expm1(-coefficient * reach[i])
        if scattered > 0.0:
            ray[count], path[count], chance[count] = i, queue.path[i], scattered / total
            count += 1
    return count


@kernel
def end_flights(flights, queue, hits, media, wavelengths):
    """Draw where rays scatter in the medium around them; those that do before their reach lose their hit.

    The distances follow the scattering coefficient of one channel, drawn by its throughput (rows 0 and 1 of the random
    numbers), and weights the mean of all densities, so that none is large. Absorption of rays that reach their hit is
    that of `fill_absorption`.
    """
    ray_of, path_of, reach, random, end = flights.ray, flights.path, flights.reach, flights.end_random, flights.end
    throughput, scattering, extinction = queue.throughput, media.scattering, media.extinction
    waves = wavelengths.number
    basis = wavelengths.basis
    channels = throughput.shape[1]
    for j in range(ray_of.size):
        i, total = ray_of[j], 0.0
        inside, wave = innermost(queue.media[i]), wavelength_index(waves, path_of[j])
        for c in range(channels):
            total += throughput[i, c]
        chosen, lot = 0, random[1, j] * total
        while chosen < channels - 1 and lot >= throughput[i, chosen]:
            lot -= throughput[i, chosen]
            chosen += 1
        coefficient = row_channel(scattering, inside, chosen, basis, wave)
        distance = -math.log1p(-random[0, j]) / coefficient if coefficient > 0.0 else math.inf
        ends = distance < reach[i]
        end[j] = distance if ends else math.inf
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
            hits.triangle[i] = -1


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


@device
def _nearness(start, end, lights):
    """Squared distance from the scene at which a flight began over that at which it ends: at most 1.

    Paths that leave the scene, and hit nothing, bring the less light the farther from it they scatter.
    """
    before, after = sub(start, lights.middle), sub(end, lights.middle)
    near2 = max(dot(before, before), (_NEAR * lights.far) ** 2)
    return max(_LEAST_NEARNESS, min(1.0, near2 / max(dot(after, after), near2)))


@kernel
def scatter_in_media(new, n_rays, flights, queue, hits, media, lights, russian_roulette):
    """Append rays from where rays scatter, by rows 2 and 3 of their random numbers; return the number of all rays.

    With Russian roulette, paths survive with the probability of their largest throughput, times n^2 in a body: radiance
    there is larger by n^2, and throughput less, until it leaves. Paths that have left the scene may end at any bounce.
    The density of a direction includes the ray's chance to scatter: all flights are lit, but few scatter in thin media,
    and multiple importance sampling prefers the light that is drawn.
    """
    random, travelled = flights.light_random, hits.travelled
    for j in range(flights.ray.size):
        i, distance = flights.ray[j], flights.end[j]
        if distance == math.inf:
            continue
        if travelled is not None:
            # Rays begin behind the transparent surfaces that they have passed.
            distance -= travelled[i]
        start, before, inside = row_vector(queue.rays, i, 0), row_vector(queue.rays, i, 3), innermost(queue.media[i])
        end = add(start, scale(before, distance))
        largest, survival = 0.0, 1.0
        for c in range(queue.throughput.shape[1]):
            largest = max(largest, queue.throughput[i, c])
        if not largest > 0.0:
            continue
        if russian_roulette:
            survival = min(1.0, largest * media.squared_index[inside])
        if lights.sheets is None and flights.reach[i] == math.inf:
            survival *= _nearness(start, end, lights)
        if survival < 1.0 and random_number(flights.key[j], flights.number[j], _ROULETTE) >= survival:
            continue
        g = media.asymmetry[inside]
        p, q = frame_about(before)
        cosine = phase_cosine(random[2, j], g)
        sine = math.sqrt(max(0.0, 1.0 - cosine * cosine))
        c_turn, s_turn = turn(random[3, j])
        w = add(add(scale(p, sine * c_turn), scale(q, sine * s_turn)), scale(before, cosine))
        fill_vector(new.rays, n_rays, 0, end)
        fill_vector(new.rays, n_rays, 3, scale(w, 1.5 - 0.5 * dot(w, w)))
        new.path[n_rays] = queue.path[i]
        new.pdf[n_rays] = phase(cosine, g) * flights.chance[j]
        for c in range(queue.throughput.shape[1]):
            new.throughput[n_rays, c] = queue.throughput[i, c] / survival
        for k in range(queue.media.shape[1]):
            new.media[n_rays, k] = queue.media[i, k]
        if new.rough is not None:
            new.rough[n_rays] = 1
        n_rays += 1
    return n_rays
