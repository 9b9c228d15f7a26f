"""Light in absorbing bodies: kernels.

A ray's media are the materials of the bodies that it is in, (rays, n): the outermost first, -1 behind the last.
"""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.kernels.vectors import dot, row_vector, sub
from plenoptic.core.kernels.wavelengths import row_channel, wavelength_index
from plenoptic.core.numba.jit import device, kernel
from plenoptic.scene.geometry.geometry_records import FRONT, NORMAL, POINT
from plenoptic.scene.geometry.kernels.intersect import corners, intersect_triangle, is_reflection
from plenoptic.scene.lights.light_records import DIRECTION, END
from plenoptic.scene.materials.material_records import INSIDE


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
            reach[i] = t if t > 0.0 else 0.0
            if travelled is not None:
                reach[i] += travelled[i]


@kernel
def fill_absorption(queue, reach, hits, absorption, wavelengths):
    """Attenuate the rays that hit a surface by the media along them (Beer-Lambert)."""
    throughput = queue.throughput
    waves = wavelengths.number
    basis = wavelengths.basis
    for i in range(reach.size):
        inside = innermost(queue.media[i])
        if hits.triangle[i] < 0 or inside < 0:
            continue
        wave = wavelength_index(waves, queue.path[i])
        for c in range(throughput.shape[1]):
            throughput[i, c] *= math.exp(-reach[i] * row_channel(absorption, inside, c, basis, wave))


@device
def innermost(row):
    """The innermost body of a row of media, -1 in none."""
    inside = -1
    for k in range(row.size):
        if row[k] >= 0:
            inside = row[k]
    return inside


@device
def holds(row, material):
    """True if a material is among a row of media."""
    is_held = False
    for k in range(row.size):
        is_held = is_held or row[k] == material
    return is_held


@device
def enter(row, material):
    """Push a body onto the media of a row; in a full row it replaces the innermost body."""
    for k in range(row.size):
        if row[k] < 0 or k == row.size - 1:
            row[k] = material
            return


@device
def leave(row, material):
    """Take the innermost body of a material out of a row; those within it move up."""
    last = -1
    for k in range(row.size):
        if row[k] == material:
            last = k
    if last < 0:
        return
    for k in range(last, row.size - 1):
        row[k] = row[k + 1]
    row[row.size - 1] = -1


@kernel
def fill_next_media(next_media, source, media, interactions, glass_index):
    """Media of the continued rays: those of the previous ray, with the body entered or without the body left."""
    for i in range(source.size):
        came = source[i]
        at = came if came >= 0 else -1 - came
        for k in range(media.shape[1]):
            next_media[i, k] = media[interactions.ray[at], k]
        material = interactions.material[at]
        # Through a pane nothing changes.
        if came < 0 and glass_index[material, INSIDE] > 0.0:
            if interactions.rows[at, FRONT] > 0.0:
                enter(next_media[i], material)
            else:
                leave(next_media[i], material)


@kernel
def fill_dimmed_lights(drawn, media, interactions, absorption, wavelengths):
    """Weaken the lights that were drawn by the medium between them and the surface."""
    lights, radiance = drawn.rows, drawn.radiance
    rows, ray_of, path, material_of = interactions.rows, interactions.ray, interactions.path, interactions.material
    waves = wavelengths.number
    basis = wavelengths.basis
    beyond = np.empty(media.shape[1], np.int32)
    for i in range(material_of.size):
        inside = innermost(media[ray_of[i]])
        if dot(row_vector(lights, i, DIRECTION), row_vector(rows, i, NORMAL)) < 0.0:
            # The light is on the other side.
            for k in range(beyond.size):
                beyond[k] = media[ray_of[i], k]
            if rows[i, FRONT] > 0.0:
                enter(beyond, material_of[i])
            else:
                leave(beyond, material_of[i])
            inside = innermost(beyond)
        if inside >= 0:
            d = sub(row_vector(lights, i, END), row_vector(rows, i, POINT))
            distance = math.sqrt(dot(d, d))
            wave = wavelength_index(waves, path[i])
            for c in range(radiance.shape[1]):
                radiance[i, c] *= math.exp(-distance * row_channel(absorption, inside, c, basis, wave))
