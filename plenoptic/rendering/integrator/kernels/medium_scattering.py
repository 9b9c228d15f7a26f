"""Flights of rays in scattering media, light drawn at their ends, and directions from there: kernels.

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
from plenoptic.scene.geometry.geometry_records import POINT
from plenoptic.scene.geometry.kernels.intersect import corners, intersect_triangle, is_reflection
from plenoptic.scene.lights.kernels.sky import weight
from plenoptic.scene.lights.light_records import DIRECTION, END, PDF
from plenoptic.scene.materials.kernels.absorption import enter, holds, innermost
from plenoptic.scene.materials.material_records import INSIDE

_ROULETTE = np.uint64(314)


@kernel
def fill_reaches(reach, queue, hits, geometry, glass_index, surrounding):
    """Fill how far rays go from their start before they hit a surface, in mm; inf without one.

    The media of rays are put right: one that hits the back of a body's surface was inside that body. One that hits
    nothing has missed the surface of its body by rounding, and is in the scene's medium (`surrounding`, -1 if none).
    """
    rays, inside_of = queue.rays, queue.media
    triangle_hit, instances, travelled = hits.triangle, hits.instance, hits.travelled
    vertices = geometry.vertices
    triangles = geometry.triangles
    triangle_material = geometry.triangle_material
    instance_to_world = geometry.instance_to_world
    for i in range(reach.size):
        reach[i] = math.inf
        k = triangle_hit[i]
        if k < 0:
            for body in range(inside_of.shape[1]):
                inside_of[i, body] = surrounding if body == 0 else -1
        elif vertices is not None:
            instance = -1 if instances is None else instances[i]
            direction = row_vector(rays, i, 3)
            triangle = corners(vertices, triangles, k, instance_to_world, instance)
            t, _, _, normal = intersect_triangle(row_vector(rays, i, 0), direction, triangle)
            behind = (dot(normal, direction) > 0.0) != is_reflection(instance_to_world, instance)
            material = triangle_material[k]
            if behind and glass_index[material, INSIDE] > 0.0 and not holds(inside_of[i], material):
                enter(inside_of[i], material)
            reach[i] = max(t, 0.0)
            if travelled is not None:
                reach[i] += travelled[i]


@kernel
def end_flights(flights, reach, queue, hits, media, random, wavelengths):
    """Draw where rays scatter in the medium around them; those that do before their reach lose their hit.

    `flights` (n,) are the distances to there in mm along the rays, which begin behind the transparent surfaces that
    they have passed, so that distances may be negative; inf for rays that do not scatter. Distances follow the
    scattering coefficient of one channel, drawn by its throughput (row 1 of the random numbers), and weights the mean
    of all densities, so that none is large. Absorption of rays that reach their hit is that of `fill_absorption`.
    """
    path_of, throughput, inside_of = queue.path, queue.throughput, queue.media
    triangle_hit, travelled = hits.triangle, hits.travelled
    scattering, extinction = media.scattering, media.extinction
    waves = wavelengths.number
    basis = wavelengths.basis
    channels = throughput.shape[1]
    for i in range(flights.size):
        flights[i] = math.inf
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
            flights[i] = distance
            if travelled is not None:
                flights[i] -= travelled[i]
            triangle_hit[i] = -1


@kernel
def fill_vertices(vertices, flights, queue):
    """Fill the points at which rays scatter; return their number."""
    rows, ray, path, material = vertices.rows, vertices.ray, vertices.path, vertices.material
    count = 0
    for i in range(flights.size):
        if flights[i] < math.inf:
            place = add(row_vector(queue.rays, i, 0), scale(row_vector(queue.rays, i, 3), flights[i]))
            fill_vector(rows, count, POINT, place)
            ray[count], path[count], material[count] = i, queue.path[i], 0
            count += 1
    return count


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
def fill_medium_lights(shadow, vertices, drawn, queue, media, wavelengths):
    """Fill the shadow rays from points in media to the drawn lights, and their light; return their number."""
    shadow_rays, shadow_path, shadow_radiance = shadow.rays, shadow.path, shadow.radiance
    lights, radiance, rows = drawn.rows, drawn.radiance, vertices.rows
    throughput, extinction, asymmetry = queue.throughput, media.extinction, media.asymmetry
    waves = wavelengths.number
    basis = wavelengths.basis
    count = 0
    for i in range(vertices.path.size):
        ray, path = vertices.ray[i], vertices.path[i]
        inside = innermost(queue.media[ray])
        place = row_vector(rows, i, POINT)
        to_light = sub(row_vector(lights, i, END), place)
        brightest = 0.0
        for c in range(radiance.shape[1]):
            brightest = max(brightest, radiance[i, c])
        if not brightest > 0.0:
            continue
        pdf = phase(dot(row_vector(queue.rays, ray, 3), row_vector(lights, i, DIRECTION)), asymmetry[inside])
        factor = pdf if lights[i, PDF] < 0.0 else pdf * weight(lights[i, PDF], pdf)
        wave = wavelength_index(waves, path)
        distance = math.sqrt(dot(to_light, to_light))
        brightest = 0.0
        for c in range(radiance.shape[1]):
            left = math.exp(-distance * row_channel(extinction, inside, c, basis, wave))
            shadow_radiance[count, c] = throughput[ray, c] * radiance[i, c] * factor * left
            brightest = max(brightest, shadow_radiance[count, c])
        if brightest > 0.0:
            fill_vector(shadow_rays, count, 0, place)
            fill_vector(shadow_rays, count, 3, to_light)
            shadow_path[count] = path
            count += 1
    return count


@kernel
def scatter_in_media(new, n_rays, vertices, queue, media, russian_roulette):
    """Append rays from points in media, by rows 2 and 3 of the random numbers; return the number of all rays.

    With Russian roulette, paths survive with the probability of their largest throughput.
    """
    rows, random = vertices.rows, vertices.random
    for i in range(vertices.path.size):
        ray = vertices.ray[i]
        largest, factor = 0.0, 1.0
        for c in range(queue.throughput.shape[1]):
            largest = max(largest, queue.throughput[ray, c])
        if not largest > 0.0:
            continue
        if russian_roulette and largest < 1.0:
            if random_number(vertices.key[i], vertices.number[i], _ROULETTE) >= largest:
                continue
            factor = 1.0 / largest
        g = media.asymmetry[innermost(queue.media[ray])]
        before = row_vector(queue.rays, ray, 3)
        p, q = frame_about(before)
        cosine = phase_cosine(random[2, i], g)
        sine = math.sqrt(max(0.0, 1.0 - cosine * cosine))
        c_turn, s_turn = turn(random[3, i])
        w = add(add(scale(p, sine * c_turn), scale(q, sine * s_turn)), scale(before, cosine))
        fill_vector(new.rays, n_rays, 0, row_vector(rows, i, POINT))
        fill_vector(new.rays, n_rays, 3, scale(w, 1.5 - 0.5 * dot(w, w)))
        new.path[n_rays] = vertices.path[i]
        new.pdf[n_rays] = phase(cosine, g)
        for c in range(queue.throughput.shape[1]):
            new.throughput[n_rays, c] = queue.throughput[ray, c] * factor
        for k in range(queue.media.shape[1]):
            new.media[n_rays, k] = queue.media[ray, k]
        if new.rough is not None:
            new.rough[n_rays] = 1
        n_rays += 1
    return n_rays
