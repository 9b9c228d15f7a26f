"""Light in absorbing bodies: kernels. A ray's medium is the material of the body that it is in, -1 in none."""

from __future__ import annotations

import math

from plenoptic._jit import kernel
from plenoptic.scene._bsdf import one_channel
from plenoptic.scene._colours import wave_of
from plenoptic.scene._hit import corners, meet
from plenoptic.scene._surfaces import mirrors


@kernel
def fill_absorbed(
    throughput,
    medium,
    path_of,
    hits,
    placed,
    rays,
    vertices,
    triangles,
    triangle_material,
    matrices,
    glass_index,
    absorption,
    travelled,
    waves,
    basis,
):
    """Weaken rays by what they have passed since they were sent (Beer-Lambert).

    A ray that meets the back of a body's surface was inside that body, whatever was known of it.
    """
    for i in range(hits.size):
        k = hits[i]
        if k < 0:
            continue
        place = -1 if placed is None else placed[i]
        ray = rays[i]
        t, _, _, nx, ny, nz = meet(ray, *corners(vertices, triangles, k, matrices, place))
        behind = nx * ray[3] + ny * ray[4] + nz * ray[5] > 0.0
        if matrices is not None:
            if place >= 0 and mirrors(matrices[place]):
                behind = not behind
        material = triangle_material[k]
        inside = material if behind and glass_index[material, 0] > 0.0 else medium[i]
        if inside < 0 or not t > 0.0:
            continue
        medium[i] = inside
        if travelled is not None:
            t += travelled[i]
        wave = wave_of(waves, path_of[i])
        for c in range(throughput.shape[1]):
            throughput[i, c] *= math.exp(-t * one_channel(absorption[inside], c, basis, wave))


@kernel
def fill_next_media(next_medium, next_from, medium, surface, lane_of, material_of, glass_index):
    """The media of rays onwards: that of the ray before, the body entered, or none behind it."""
    for i in range(next_from.size):
        came = next_from[i]
        if came >= 0:
            next_medium[i] = medium[lane_of[came]]
            continue
        came = -1 - came
        material = material_of[came]
        if not glass_index[material, 0] > 0.0:
            # Through a pane.
            next_medium[i] = medium[lane_of[came]]
        else:
            next_medium[i] = material if surface[came, 11] > 0.0 else -1


@kernel
def fill_dimmed_lights(
    lit, medium, drawn, surface, lane_of, material_of, path_of, glass_index, absorption, waves, basis
):
    """Weaken the lights that were drawn by the medium between them and the surface."""
    for i in range(material_of.size):
        row, inside = surface[i], medium[lane_of[i]]
        if drawn[i, 0] * row[3] + drawn[i, 1] * row[4] + drawn[i, 2] * row[5] < 0.0:
            # The light is on the other side.
            material = material_of[i]
            inside = material if row[11] > 0.0 and glass_index[material, 0] > 0.0 else -1
        if inside >= 0:
            dx, dy, dz = drawn[i, 3] - surface[i, 0], drawn[i, 4] - surface[i, 1], drawn[i, 5] - surface[i, 2]
            way = math.sqrt(dx * dx + dy * dy + dz * dz)
            wave = wave_of(waves, path_of[lane_of[i]])
            for c in range(lit.shape[1]):
                lit[i, c] *= math.exp(-way * one_channel(absorption[inside], c, basis, wave))
