"""Light in absorbing bodies: kernels.

A ray's media are the materials of the bodies that it is in, (rays, n): the outermost first, -1 behind the last.
"""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.jit import device, kernel
from plenoptic.scene.geometry.kernels.interaction import mirrors
from plenoptic.scene.geometry.kernels.intersect import corners, meet
from plenoptic.scene.materials.kernels.bsdf import row_channel
from plenoptic.scene.textures.kernels.colors import wave_of


@kernel
def fill_absorbed(
    throughput,
    media,
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
        t, _, _, nx, ny, nz = meet(rays, i, *corners(vertices, triangles, k, matrices, place))
        behind = nx * rays[i, 3] + ny * rays[i, 4] + nz * rays[i, 5] > 0.0
        if matrices is not None:
            if place >= 0 and mirrors(matrices[place]):
                behind = not behind
        material = triangle_material[k]
        if behind and glass_index[material, 0] > 0.0 and not holds(media[i], material):
            enter(media[i], material)
        inside = innermost(media[i])
        if inside < 0 or not t > 0.0:
            continue
        if travelled is not None:
            t += travelled[i]
        wave = wave_of(waves, path_of[i])
        for c in range(throughput.shape[1]):
            throughput[i, c] *= math.exp(-t * row_channel(absorption, inside, c, basis, wave))


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
    """Whether a material is among a row of media."""
    found = False
    for k in range(row.size):
        found = found or row[k] == material
    return found


@device
def enter(row, material):
    """Add a body inside those of a row; where there is no room, it takes the place of the innermost one."""
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
def fill_next_media(next_media, next_from, media, surface, lane_of, material_of, glass_index):
    """The media of rays onwards: those of the ray before, with the body that was entered or without the one left."""
    for i in range(next_from.size):
        came = next_from[i]
        met = came if came >= 0 else -1 - came
        for k in range(media.shape[1]):
            next_media[i, k] = media[lane_of[met], k]
        material = material_of[met]
        # Through a pane nothing changes.
        if came < 0 and glass_index[material, 0] > 0.0:
            if surface[met, 10] > 0.0:
                enter(next_media[i], material)
            else:
                leave(next_media[i], material)


@kernel
def fill_dimmed_lights(lit, media, drawn, surface, lane_of, material_of, path_of, absorption, waves, basis):
    """Weaken the lights that were drawn by the medium between them and the surface."""
    beyond = np.empty(media.shape[1], np.int32)
    for i in range(material_of.size):
        row, inside = surface[i], innermost(media[lane_of[i]])
        if drawn[i, 0] * row[3] + drawn[i, 1] * row[4] + drawn[i, 2] * row[5] < 0.0:
            # The light is on the other side.
            for k in range(beyond.size):
                beyond[k] = media[lane_of[i], k]
            if row[10] > 0.0:
                enter(beyond, material_of[i])
            else:
                leave(beyond, material_of[i])
            inside = innermost(beyond)
        if inside >= 0:
            dx, dy, dz = drawn[i, 3] - surface[i, 0], drawn[i, 4] - surface[i, 1], drawn[i, 5] - surface[i, 2]
            way = math.sqrt(dx * dx + dy * dy + dz * dz)
            wave = wave_of(waves, path_of[lane_of[i]])
            for c in range(lit.shape[1]):
                lit[i, c] *= math.exp(-way * row_channel(absorption, inside, c, basis, wave))
