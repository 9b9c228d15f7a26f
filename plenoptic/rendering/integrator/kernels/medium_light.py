"""Light that media scatter once towards the start of flights: kernels.

Each flight has one point that a drawn light lights, whether the ray itself scatters or not. Its distance is drawn by
the profile of that light and by the extinction, combined with the balance heuristic.
"""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.kernels.vectors import add, dot, fill_vector, row_vector, scale, sub
from plenoptic.core.kernels.wavelengths import row_channel, wavelength_index
from plenoptic.core.numba.jit import device, kernel
from plenoptic.rendering.integrator.kernels.flight_profiles import (
    lit_by_sheet,
    lit_by_spot,
    no_profile,
    point_profile,
    profile_density,
    sample_profile,
    sheet_profile,
)
from plenoptic.rendering.integrator.kernels.medium_scattering import phase
from plenoptic.scene.geometry.geometry_records import POINT as INTERACTION_POINT
from plenoptic.scene.lights.kernels.sky import sample_cdf, weight
from plenoptic.scene.lights.light_records import (
    CORNER,
    DIRECTION,
    EDGE_1,
    EDGE_2,
    END,
    EXTENT,
    PDF,
    POINT,
    SHEET,
    TRIANGLE,
)
from plenoptic.scene.materials.kernels.absorption import innermost

DISTANCE, OVER_DENSITY, CHANCE = 0, 1, 2
"""Rows of points on flights: distance from the flight's start in mm, 1 / density in mm, and the chance to scatter."""


@device
def _triangle_point(areas, light, u, v):
    """The point of a triangle that `sample_emitters` draws by the same random numbers."""
    root = math.sqrt(u)
    on_edges = add(
        scale(row_vector(areas, light, EDGE_1), root * (1.0 - v)), scale(row_vector(areas, light, EDGE_2), root * v)
    )
    return add(row_vector(areas, light, CORNER), on_edges)


@kernel
def draw_lit_points(points, distances, flights, queue, hits, lights, media, wavelengths):
    """Draw points on flights that lights may shine on, at most one on each; return their number.

    Bodies without a light in them have none: their surfaces block shadow rays. Rows 0 and 1 of the random numbers of
    the light draw it, rows 2 and 3 of those of the end draw the distance.
    """
    reach, random, lot = flights.reach, flights.end_random, flights.light_random
    throughput, travelled, scattering = queue.throughput, hits.travelled, media.scattering
    cdf, items = lights.cdf, lights.items
    areas = lights.areas
    lamps = lights.points
    sheets = lights.sheets
    waves = wavelengths.number
    basis = wavelengths.basis
    channels = throughput.shape[1]
    coefficient, weakened = np.zeros(channels), np.zeros(channels)
    count = 0
    for j in range(flights.ray.size):
        i = flights.ray[j]
        inside, wave = innermost(queue.media[i]), wavelength_index(waves, flights.path[j])
        if media.lit[inside] == 0:
            continue
        origin, direction = row_vector(queue.rays, i, 0), row_vector(queue.rays, i, 3)
        if travelled is not None:
            origin = sub(origin, scale(direction, travelled[i]))
        light, u = sample_cdf(cdf, lot[0, j])
        begin, end, profile = 0.0, reach[i], no_profile()
        if areas is not None:
            if items[light].kind == TRIANGLE:
                place = _triangle_point(areas, light, u, lot[1, j])
                profile = point_profile(sub(place, origin), direction, areas[light, EXTENT], begin, end)
        if lamps is not None:
            if items[light].kind == POINT:
                lamp = lamps[items[light].row]
                to_lamp = sub((lamp.x, lamp.y, lamp.z), origin)
                begin, end = lit_by_spot(lamp, to_lamp, direction, reach[i])
                profile = point_profile(to_lamp, direction, 0.0, begin, end)
        if sheets is not None:
            if items[light].kind == SHEET:
                sheet, largest = sheets[items[light].row], 0.0
                for c in range(channels):
                    largest = max(largest, row_channel(media.extinction, inside, c, basis, wave))
                to_waist = sub((sheet.x, sheet.y, sheet.z), origin)
                begin, end = lit_by_sheet(sheet, to_waist, direction, reach[i])
                profile = sheet_profile(sheet, to_waist, direction, largest, begin, end)
        probability, total, distance, density = profile[1], 0.0, begin, 0.0
        if not end > begin:
            continue
        for c in range(channels):
            coefficient[c] = 0.0
            if row_channel(scattering, inside, c, basis, wave) > 0.0:
                coefficient[c] = row_channel(media.extinction, inside, c, basis, wave)
                weakened[c] = -math.expm1(-coefficient[c] * (end - begin))
                total += throughput[i, c]
        if random[2, j] < probability:
            distance = sample_profile(profile, random[2, j] / probability)
        else:
            # A channel that scatters, by its throughput.
            chosen, left = 0, random[3, j] * total
            for c in range(channels):
                if coefficient[c] > 0.0 and left >= 0.0:
                    chosen, left = c, left - throughput[i, c]
            u = (random[2, j] - probability) / (1.0 - probability)
            distance = begin - math.log1p(-u * weakened[chosen]) / coefficient[chosen]
        distance = min(max(distance, begin), end)
        if probability > 0.0:
            density = probability * profile_density(profile, distance)
        for c in range(channels):
            if coefficient[c] > 0.0 and weakened[c] > 0.0:
                fraction = (1.0 - probability) * throughput[i, c] / total
                left = math.exp(-coefficient[c] * (distance - begin))
                density += fraction * coefficient[c] * left / weakened[c]
        distances[DISTANCE, count] = distance
        distances[CHANCE, count] = flights.chance[j]
        distances[OVER_DENSITY, count] = 1.0 / density if density > 0.0 else 0.0
        points.ray[count], points.path[count] = i, flights.path[j]
        points.random[0, count], points.random[1, count] = lot[0, j], lot[1, j]
        fill_vector(points.rows, count, INTERACTION_POINT, add(origin, scale(direction, distance)))
        count += 1
    return count


@kernel
def fill_medium_lights(shadow, points, distances, drawn, queue, media, wavelengths):
    """Fill the shadow rays from the points on flights to the drawn lights, and their light; return their number."""
    shadow_rays, shadow_path, shadow_radiance = shadow.rays, shadow.path, shadow.radiance
    lights, radiance, rows = drawn.rows, drawn.radiance, points.rows
    throughput, asymmetry = queue.throughput, media.asymmetry
    waves = wavelengths.number
    basis = wavelengths.basis
    count = 0
    for j in range(points.path.size):
        ray, path = points.ray[j], points.path[j]
        brightest = 0.0
        for c in range(radiance.shape[1]):
            brightest = max(brightest, radiance[j, c])
        if not brightest > 0.0:
            continue
        inside, wave = innermost(queue.media[ray]), wavelength_index(waves, path)
        place = row_vector(rows, j, INTERACTION_POINT)
        to_light = sub(row_vector(lights, j, END), place)
        pdf = phase(dot(row_vector(queue.rays, ray, 3), row_vector(lights, j, DIRECTION)), asymmetry[inside])
        factor = pdf * distances[OVER_DENSITY, j]
        if lights[j, PDF] >= 0.0:
            factor *= weight(lights[j, PDF], pdf * distances[CHANCE, j])
        length = distances[DISTANCE, j] + math.sqrt(dot(to_light, to_light))
        brightest = 0.0
        for c in range(radiance.shape[1]):
            scattered = row_channel(media.scattering, inside, c, basis, wave)
            if scattered > 0.0:
                scattered *= math.exp(-length * row_channel(media.extinction, inside, c, basis, wave))
            shadow_radiance[count, c] = throughput[ray, c] * radiance[j, c] * factor * scattered
            brightest = max(brightest, shadow_radiance[count, c])
        if brightest > 0.0:
            fill_vector(shadow_rays, count, 0, place)
            fill_vector(shadow_rays, count, 3, to_light)
            shadow_path[count] = path
            count += 1
    return count
