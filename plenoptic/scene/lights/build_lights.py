"""The lights of a scene as one table of probabilities, and rows for each kind; see `scene.lights.light_records`."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats, contiguous
from plenoptic.scene.geometry.geometry_records import (
    INSTANCE_DISTANCE,
    RAY_OFFSET,
    RAY_OFFSET_64,
    Geometry,
    InstanceRecord,
)
from plenoptic.scene.lights.environment import EnvironmentMap
from plenoptic.scene.lights.fields import channel_mean
from plenoptic.scene.lights.light_records import (
    AREA_COLUMNS,
    CORNER,
    EDGE_1,
    EDGE_2,
    ENVIRONMENT,
    EXTENT,
    FRONT_NORMAL,
    LIGHT,
    POINT,
    POINT_LIGHT,
    SHADOW_OFFSET,
    SHEET,
    SHEET_LIGHT,
    SUN,
    SUN_LIGHT,
    TRIANGLE,
    Environment,
    Lights,
    Sky,
)
from plenoptic.scene.lights.registry import DistantLight, Light, PositionalLight
from plenoptic.scene.lights.sheet import Sheet
from plenoptic.scene.materials.build_materials import color_rows

_FEWEST, _MOST = 0.1, 0.9
"""Share of the draws that goes to distant lights (suns, sheets, environment) where there are near ones too. Their power
depends on the size of the scene, and a floor of a kilometre must not leave lamps without draws."""
_CANDIDATES, _MANY = 4, 100
"""Lights of which one is chosen by its contribution, and the number of lights in a scene from which on that pays.

A hundred lamps over a floor gain 9 in variance times time at 16 samples, 4 at 256; sixty all around 1.8, but 0.6 at
256, where stratified draws are better.
"""
_TEXELS_PER_GUIDE = 4
_LEFT = 0.75
"""Fraction of a map's mean radiance that is left to scattered rays. All of it would raise the variance under a map with
a sun, where the rest of the sky is below the mean, to 1.7 times what it is without."""


class Emitters(NamedTuple):
    """The triangles that emit."""

    geometry: Geometry
    exitance: Floats
    """(nm,): half of mean emitted radiance times sides that emit."""
    instances: InstanceRecord | None
    triangle_mesh: NDArray[np.int32]
    """(nt,): number of each triangle's mesh."""


def lights_record(
    lights: Sequence[Light], emitters: Emitters | None, sky: Sky, bounds: Floats | None, channels: int, *, drawn: bool
) -> tuple[Lights, Floats | None]:
    """Compile lights, and (nm,), 1/mm^2, with which probability triangles of materials are drawn; None where none is.

    `drawn` says whether anything reflects: otherwise lights are only seen. Suns are added to `sky`.
    """
    points = [light for light in lights if drawn and isinstance(light, PositionalLight)]
    suns = [light for light in lights if isinstance(light, DistantLight)]
    sheets = [light for light in lights if drawn and isinstance(light, Sheet)]
    environment = sky.environment
    extent = np.zeros((2, 3)) if bounds is None else bounds
    diameter, middle = float(np.linalg.norm(extent[1] - extent[0])), extent.mean(axis=0)
    radius = max(diameter / 2, 1e-9)
    disc = math.pi * radius**2
    # Powers relative to the brightest, so that no radiance overflows.
    unit_powers = [light.power for light in points] + [channel_mean(light.irradiance) for light in suns + sheets]
    unit_powers += [] if emitters is None else [float(emitters.exitance.max())]
    unit_powers += [] if environment is None else [environment.total]
    unit = max(unit_powers, default=0.0) or 1.0
    near_rows, near_instances, near_power, area_power = _triangle_powers(emitters if drawn else None, unit)
    point_power = np.array([light.power / unit for light in points])
    sun_power = np.array([disc * (channel_mean(light.irradiance) / unit) for light in suns if drawn])
    sky_power = np.array([] if environment is None or not drawn else [disc * (environment.total / unit)])
    strips = [min(math.sqrt(math.pi / 8) * light.thickness, 2 * radius) * 2 * radius for light in sheets]
    sheet_power = np.array(strips) * [channel_mean(light.irradiance) / unit for light in sheets]
    probability, per_near = _share_sky(
        np.concatenate([near_power, point_power]), np.concatenate([sheet_power, sun_power, sky_power])
    )
    cdf = items = None
    sun_pdf = np.zeros(len(suns))
    if probability.size:
        powers = (near_power, point_power, sheet_power, sun_power, sky_power)
        items = np.empty(probability.size, dtype=LIGHT)
        items["kind"] = np.repeat([TRIANGLE, POINT, SHEET, SUN, ENVIRONMENT], [power.size for power in powers])
        items["row"] = np.concatenate([near_rows, *(np.arange(power.size) for power in powers[1:])])
        items["instance"] = -1
        items["instance"][: near_power.size] = near_instances
        sun_pdf = probability[items["kind"] == SUN]
        cdf = np.cumsum(probability)
        cdf /= cdf[-1]
        # What has no power must not be drawn by the last random number either.
        cdf[np.flatnonzero(probability)[-1] :] = 1.0
        if environment is not None:
            environment = environment._replace(probability=float(probability[-1]))
    sun_rows = [(*sun.row(), pdf) for sun, pdf in zip(suns, sun_pdf, strict=True)]
    sun_colors = [sun.irradiance if sun.radiance is None else sun.radiance for sun in suns]
    record = Lights(
        cdf=None if cdf is None else contiguous(cdf),
        items=None if items is None else contiguous(items),
        areas=None if emitters is None or not near_power.size else _area_rows(emitters, near_rows, near_instances),
        points=contiguous(np.array([light.row() for light in points], POINT_LIGHT)) if points else None,
        point_colors=color_rows([light.intensity for light in points], channels) if points else None,
        sheets=contiguous(np.array([light.row() for light in sheets], SHEET_LIGHT)) if sheets else None,
        sheet_colors=color_rows([light.irradiance for light in sheets], channels) if sheets else None,
        sky=Sky(
            background=sky.background,
            suns=contiguous(np.array(sun_rows, SUN_LIGHT)) if suns else None,
            sun_colors=color_rows(sun_colors, channels) if suns else None,
            environment=environment,
        ),
        far=2 * diameter + 1.0,
        middle=(float(middle[0]), float(middle[1]), float(middle[2])),
        candidates=_CANDIDATES if _number_of_lights(items, emitters) >= _MANY else 1,
    )
    return record, contiguous(area_power * per_near) if cdf is not None and near_power.size else None


def _number_of_lights(items: NDArray[Any] | None, emitters: Emitters | None) -> int:
    """Number of meshes and their places, points and distant lights that are drawn."""
    if items is None:
        return 0
    is_area = items["kind"] == TRIANGLE
    if emitters is None or not is_area.any():
        return len(items)
    places = np.stack([emitters.triangle_mesh[items["row"][is_area]], items["instance"][is_area]])
    return len(np.unique(places, axis=1).T) + int(np.count_nonzero(~is_area))


def _triangle_powers(
    emitters: Emitters | None, unit: float
) -> tuple[NDArray[np.int64], NDArray[np.int32], Floats, Floats]:
    """Triangles that emit, in their places, with their powers; and power per area of each material."""
    if emitters is None:
        return np.empty(0, np.int64), np.empty(0, np.int32), np.empty(0), np.empty(0)
    geometry, instances = emitters.geometry, emitters.instances
    exitance = 2 * math.pi * (emitters.exitance / unit)
    shines = exitance[geometry.triangle_material] > 0
    parts: list[Any] = [(0, len(geometry.triangles) if instances is None else instances.plain, None)]
    if instances is not None:
        linear = instances.matrices.reshape(-1, 3, 4)[:, :, :3]
        parts += zip(instances.first.tolist(), instances.faces.tolist(), linear, strict=True)
    rows, places, areas = [], [], []
    for place, (first, count, matrix) in enumerate(parts, start=-1):
        shining = first + np.flatnonzero(shines[first : first + count])
        if shining.size or place < 0:
            corners = geometry.vertices[geometry.triangles[shining]]
            edges = corners[:, 1:] - corners[:, :1]
            edges = edges if matrix is None else edges @ matrix.T
            rows.append(shining)
            places.append(np.full(shining.size, place, np.int32))
            areas.append(0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1))
    row, where, area = np.concatenate(rows), np.concatenate(places), np.concatenate(areas)
    power = area * exitance[geometry.triangle_material[row]]
    counts = (power > 0) & ~_duplicates(geometry, row, where)
    return row[counts], where[counts], power[counts], exitance


def _area_rows(emitters: Emitters, row: NDArray[np.int64], place: NDArray[np.int32]) -> Floats:
    """(n, AREA_COLUMNS): triangles in their places."""
    geometry, instances = emitters.geometry, emitters.instances
    corners = geometry.vertices[geometry.triangles[row]]
    mirrored, distance = np.zeros(len(row), dtype=bool), np.full(len(row), -1.0)
    moved = place >= 0
    if instances is not None and geometry.instance_to_world is not None and moved.any():
        matrices = instances.matrices[place[moved]].reshape(-1, 3, 4)
        corners[moved] = corners[moved] @ matrices[:, :, :3].transpose(0, 2, 1) + matrices[:, None, :, 3]
        mirrored[moved] = np.linalg.det(matrices[:, :, :3]) < 0
        distance[moved] = geometry.instance_to_world[place[moved], INSTANCE_DISTANCE]
    rows = np.empty((len(row), AREA_COLUMNS))
    rows[:, CORNER : CORNER + 3] = corners[:, 0]
    rows[:, EDGE_1 : EDGE_1 + 3] = corners[:, 1] - corners[:, 0]
    rows[:, EDGE_2 : EDGE_2 + 3] = corners[:, 2] - corners[:, 0]
    normal = np.cross(rows[:, EDGE_1 : EDGE_1 + 3], rows[:, EDGE_2 : EDGE_2 + 3])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    rows[:, FRONT_NORMAL : FRONT_NORMAL + 3] = np.where(mirrored[:, None], -normal, normal)
    rows[:, SHADOW_OFFSET] = _largest_offsets(corners, normal, geometry.middle, distance)
    rows[:, EXTENT] = _extents(corners, np.stack([emitters.triangle_mesh[row], place]))
    return contiguous(rows)


def _extents(corners: Floats, mesh: NDArray[np.int32]) -> Floats:
    """(n,), mm: half the diagonal of the box around all triangles of the same mesh and place (2, n)."""
    order = np.lexsort(mesh)
    begins = np.any(np.diff(mesh[:, order], axis=1, prepend=-2), axis=0)
    first = np.flatnonzero(begins)
    sides = np.maximum.reduceat(corners.max(axis=1)[order], first) - np.minimum.reduceat(
        corners.min(axis=1)[order], first
    )
    extents = np.empty(len(corners))
    extents[order] = 0.5 * np.linalg.norm(sides, axis=1)[np.cumsum(begins) - 1]
    return extents


def _largest_offsets(corners: Floats, normal: Floats, middle: Floats, distance: Floats) -> Floats:
    """(n,): the largest `ray_offset` that a triangle's points have, which is that of a corner: it is convex."""
    across = np.where(distance[:, None] >= 0, 1.0, np.abs(normal))
    off_middle = np.einsum("nij,nj->ni", np.abs(corners - middle), across)
    near = distance
    for a, b in itertools.product(range(3), repeat=2):
        half_width = np.einsum("nj,nj->n", np.abs(corners[:, a] - corners[:, b]), across)
        near = np.maximum(near, off_middle[:, a] + half_width)
    return np.asarray(RAY_OFFSET * near + RAY_OFFSET_64 * np.abs(corners).sum(axis=2).max(axis=1))


def _duplicates(geometry: Geometry, row: NDArray[np.int64], place: NDArray[np.int32]) -> NDArray[np.bool_]:
    """True for triangles exactly on an earlier one, facing the same way: rays hit one of them, not both."""
    corners = geometry.vertices[geometry.triangles[row]]
    # A number for each triangle that does not depend on its first corner; equal ones are compared in full.
    number = np.sort(corners @ np.array([0.8654, 0.4211, 0.2718]), axis=1) @ np.array([1.0, 0.5773, 0.3183])
    _, group, count = np.unique(number, return_inverse=True, return_counts=True)
    repeated = np.zeros(len(row), dtype=bool)
    keys: set[bytes] = set()
    for k in np.flatnonzero(count[group] > 1):
        first = min(range(3), key=lambda corner: corners[k, corner].tolist())
        key = np.roll(corners[k], -first, axis=0).tobytes() + place[k].tobytes()
        repeated[k] = key in keys
        keys.add(key)
    return repeated


def _share_sky(near: Floats, distant: Floats) -> tuple[Floats, float]:
    """Probabilities by power, and probability per power of the near lights."""
    # Relative to the strongest, so that no radiance overflows the sums.
    largest = max(near.max(initial=0.0), distant.max(initial=0.0))
    if not largest > 0:
        return np.empty(0), 0.0
    sums = [(part / largest).sum() for part in (near, distant)]
    sun_share = sums[1] / (sums[0] + sums[1])
    if sums[0] > 0 and sums[1] > 0:
        sun_share = min(max(sun_share, _FEWEST), _MOST)
    scales = [
        (portion / total if total > 0 else 0.0) / largest
        for portion, total in zip((1 - sun_share, sun_share), sums, strict=True)
    ]
    return np.concatenate([near * scales[0], distant * scales[1]]), scales[0]


def environment_record(environment: EnvironmentMap, channels: int) -> Environment | None:
    """Compile an environment map; None where it is black, so that there is nothing to see or draw.

    `channels` are those of the scene, 1 only for maps whose channels are equal. Its probability is left at 0.

    Directions are drawn by the radiance above a fraction of its mean: scattered rays find the rest as well, and the
    weights of both ways then vary less (O. Karlik, M. Sik, P. Vevoda, T. Skrivan and J. Krivanek, ACM Transactions on
    Graphics 38(6), 151 (2019), DOI 10.1145/3355089.3356565).
    """
    if not environment.texels.any():
        return None
    rows, columns, _ = environment.texels.shape
    solid_angle = texel_solid_angles(rows, columns)
    # Weights in their final place: large maps have few copies of themselves.
    weight = environment.texels.mean(axis=2, dtype=np.float64)
    total = float(weight.sum(axis=1) @ solid_angle)
    np.maximum(weight - _LEFT * total / (4 * math.pi), 0.0, out=weight)
    columns_cdf = np.cumsum(weight, axis=1)
    row_weight = columns_cdf[:, -1] * solid_angle
    lit = row_weight > 0
    np.divide(columns_cdf, columns_cdf[:, -1:].copy(), out=columns_cdf, where=lit[:, None])
    rows_cdf = np.cumsum(row_weight)
    rows_cdf /= rows_cdf[-1]
    # What is drawn are the steps of the cumulative sums, roundings included.
    pdf = weight
    pdf[:, 0] = columns_cdf[:, 0]
    np.subtract(columns_cdf[:, 1:], columns_cdf[:, :-1], out=pdf[:, 1:])
    pdf *= (np.diff(rows_cdf, prepend=0.0) / solid_angle)[:, None]
    texels = environment.texels
    if texels.shape[2] != channels:
        texels = texels[..., :1] if channels == 1 else np.repeat(texels, channels, axis=2)
    rotation = None if environment.rotation is None else contiguous(environment.rotation.reshape(9))
    columns_guide = np.stack([_guide(cdf, columns // _TEXELS_PER_GUIDE) for cdf in columns_cdf])
    return Environment(
        texels=contiguous(texels),
        rows_cdf=contiguous(rows_cdf),
        columns_cdf=contiguous(columns_cdf),
        rows_guide=contiguous(_guide(rows_cdf, rows)),
        columns_guide=contiguous(columns_guide),
        edges=contiguous(_row_edges(rows)),
        pdf=contiguous(pdf),
        rotation=rotation,
        probability=0.0,
        total=total,
    )


def _guide(cdf: Floats, size: int) -> NDArray[np.uint16]:
    """Guide table of a cumulative distribution, of at least `size` entries: see `sample_guided_cdf`."""
    size = 1 << max(size - 1, 0).bit_length()
    last = min(cdf.size - 1, np.iinfo(np.uint16).max)  # searches of wider tables begin there
    return np.minimum(np.searchsorted(cdf, np.arange(size) / size, side="right"), last).astype(np.uint16)


def _row_edges(rows: int) -> Floats:
    """(rows, 3): 1 - cosine of the polar angles of both edges of each row, from the nearer pole; 1 there, or -1."""
    row = np.arange(rows)
    up = np.where(2 * row < rows, 1.0, -1.0)
    near, far = (np.where(up > 0, edge, rows - edge) for edge in (row, row + 1))
    return np.stack([*(2 * np.sin(0.5 * np.pi * edge / rows) ** 2 for edge in (near, far)), up], axis=-1)


def texel_solid_angles(rows: int, columns: int) -> Floats:
    """(rows,), sr: solid angle of one texel in each row of an equirectangular image; together they make up 4 pi.

    2 pi / columns times the difference of the cosines of its upper and lower polar angle, as a product.
    """
    middles = np.pi * (np.arange(rows) + 0.5) / rows
    return np.asarray(4 * np.pi / columns * np.sin(0.5 * np.pi / rows) * np.sin(middles))
