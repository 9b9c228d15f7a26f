"""The lights of a scene as one table of probabilities, and rows for each kind; see `scene.lights.record`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats
from plenoptic.scene.geometry.record import Geometry, InstanceRecord
from plenoptic.scene.lights.fields import channel_mean
from plenoptic.scene.lights.record import (
    ENVIRONMENT,
    LIGHT,
    POINT,
    POINT_LIGHT,
    SUN,
    SUN_LIGHT,
    TRIANGLE,
    Environment,
    Lights,
    Sky,
)
from plenoptic.scene.lights.registry import DistantLight, Light, PositionalLight
from plenoptic.scene.materials.compile import color_rows

_FEWEST, _MOST = 0.1, 0.9
"""Share of the draws that goes to distant lights (suns, environment) where there are near ones too. Their power
depends on the size of the scene, and a floor of a kilometre must not leave lamps without draws."""


class Emitters(NamedTuple):
    """The triangles that emit."""

    geometry: Geometry
    exitance: Floats
    """(nm,): half of mean emitted radiance times sides that emit."""
    instances: InstanceRecord | None


class CompiledLights(NamedTuple):
    """Lights, and the probability per area with which triangles of materials are drawn."""

    lights: Lights
    pdf: Floats | None
    """(nm,), 1/mm^2. None where no triangle is drawn."""


def lights_record(
    lights: Sequence[Light], emitters: Emitters | None, sky: Sky, bounds: Floats | None, channels: int, *, drawn: bool
) -> CompiledLights:
    """Compile lights. `drawn` says whether anything reflects: otherwise they are only seen.

    `sky` has background and environment; its suns are added.
    """
    points = [light for light in lights if isinstance(light, PositionalLight)]
    suns = [light for light in lights if isinstance(light, DistantLight)]
    environment = sky.environment
    extent = np.zeros((2, 3)) if bounds is None else bounds
    diameter = float(np.linalg.norm(extent[1] - extent[0]))
    disc = math.pi * max(diameter / 2, 1e-9) ** 2
    # Powers relative to the brightest, so that no radiance overflows.
    unit = _brightest(emitters, points, suns, environment)
    near_rows, near_instances, near_power, area_power = _triangle_powers(emitters if drawn else None, unit)
    point_power = np.array([light.power / unit for light in points if drawn])
    sun_power = np.array([disc * (channel_mean(light.irradiance) / unit) for light in suns if drawn])
    sky_power = np.array([] if environment is None or not drawn else [disc * (environment.total / unit)])
    near, distant = np.concatenate([near_power, point_power]), np.concatenate([sun_power, sky_power])
    probability, per_near = _shared(near, distant)
    any_drawn = bool(probability.size)
    items = np.empty(probability.size, dtype=LIGHT)
    if any_drawn:
        powers = (near_power, point_power, sun_power, sky_power)
        items["kind"] = np.repeat([TRIANGLE, POINT, SUN, ENVIRONMENT], [power.size for power in powers])
        items["row"] = np.concatenate([near_rows, *(np.arange(power.size) for power in powers[1:])])
        items["instance"] = -1
        items["instance"][: near_power.size] = near_instances
    sun_pdf = probability[items["kind"] == SUN] if suns and any_drawn and drawn else np.zeros(len(suns))
    if environment is not None and sky_power.size and any_drawn:
        environment = environment._replace(probability=float(probability[-1]))
    sun_colors = [sun.irradiance if sun.radiance is None else sun.radiance for sun in suns]
    record = Lights(
        cdf=_fixed(_cumulative(probability)) if any_drawn else None,
        items=_fixed(items) if any_drawn else None,
        points=_fixed(np.array([light.row() for light in points], POINT_LIGHT)) if points and drawn else None,
        point_colors=_fixed(color_rows([p.intensity for p in points], channels)) if points and drawn else None,
        sky=Sky(
            background=sky.background,
            suns=_fixed(np.array([(*s.row(), p) for s, p in zip(suns, sun_pdf, strict=True)], SUN_LIGHT))
            if suns
            else None,
            sun_colors=_fixed(color_rows(sun_colors, channels)) if suns else None,
            environment=environment,
        ),
        far=2 * diameter + 1.0,
    )
    return CompiledLights(record, _fixed(area_power * per_near) if any_drawn and near_power.size else None)


def _brightest(
    emitters: Emitters | None,
    points: Sequence[PositionalLight],
    suns: Sequence[DistantLight],
    environment: Environment | None,
) -> float:
    found = [light.power for light in points] + [channel_mean(light.irradiance) for light in suns]
    if emitters is not None:
        found.append(float(emitters.exitance.max()))
    if environment is not None:
        found.append(environment.total)
    return max(found, default=0.0) or 1.0


def _triangle_powers(
    emitters: Emitters | None, unit: float
) -> tuple[NDArray[np.int64], NDArray[np.int32], Floats, Floats]:
    """Triangles that emit, in their places, with their powers; and power per area of each material."""
    if emitters is None:
        return np.empty(0, np.int64), np.empty(0, np.int32), np.empty(0), np.empty(0)
    exitance = 2 * math.pi * (emitters.exitance / unit)
    shines = exitance[emitters.geometry.triangle_material] > 0
    instances = emitters.instances
    plain = len(emitters.geometry.triangles) if instances is None else instances.plain
    rows = [np.flatnonzero(shines[:plain])]
    places = [np.full(rows[0].size, -1, np.int32)]
    areas = [_areas(emitters, rows[0], None)]
    for place in range(0 if instances is None else len(instances.matrices)):
        assert instances is not None
        first, faces = int(instances.first[place]), int(instances.faces[place])
        found = first + np.flatnonzero(shines[first : first + faces])
        if found.size:
            rows.append(found)
            places.append(np.full(found.size, place, np.int32))
            areas.append(_areas(emitters, found, instances.matrices[place].reshape(3, 4)[:, :3]))
    row, where, area = np.concatenate(rows), np.concatenate(places), np.concatenate(areas)
    power = area * exitance[emitters.geometry.triangle_material[row]]
    kept = (power > 0) & ~_repeated(emitters, row, where)
    return row[kept], where[kept], power[kept], exitance


def _repeated(emitters: Emitters, row: NDArray[np.int64], place: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Which triangles lie exactly on an earlier one, facing the same way: rays meet one of them, not both."""
    corners = emitters.geometry.vertices[emitters.geometry.triangles[row]]
    # A number for each triangle that does not depend on its first corner; equal ones are compared in full.
    number = np.sort(corners @ np.array([0.8654, 0.4211, 0.2718]), axis=1) @ np.array([1.0, 0.5773, 0.3183])
    _, group, count = np.unique(number, return_inverse=True, return_counts=True)
    repeated = np.zeros(len(row), dtype=bool)
    seen: set[bytes] = set()
    for k in np.flatnonzero(count[group] > 1):
        first = min(range(3), key=lambda corner: corners[k, corner].tolist())
        key = np.roll(corners[k], -first, axis=0).tobytes() + place[k].tobytes()
        repeated[k] = key in seen
        seen.add(key)
    return repeated


def _areas(emitters: Emitters, rows: NDArray[np.int64], linear: Floats | None) -> Floats:
    corners = emitters.geometry.vertices[emitters.geometry.triangles[rows]]
    edges = corners[:, 1:] - corners[:, :1]
    if linear is not None:
        edges = edges @ linear.T
    return np.asarray(0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1))


def _shared(near: Floats, distant: Floats) -> tuple[Floats, float]:
    """Probabilities by power, and probability per power of the near lights."""
    # Relative to the strongest, so that no radiance overflows the sums.
    largest = max(near.max(initial=0.0), distant.max(initial=0.0))
    if not largest > 0:
        return np.empty(0), 0.0
    sums = [(part / largest).sum() for part in (near, distant)]
    share = sums[1] / (sums[0] + sums[1])
    if sums[0] > 0 and sums[1] > 0:
        share = min(max(share, _FEWEST), _MOST)
    scales = [
        (kept / total if total > 0 else 0.0) / largest for kept, total in zip((1 - share, share), sums, strict=True)
    ]
    return np.concatenate([near * scales[0], distant * scales[1]]), scales[0]


def _cumulative(probability: Floats) -> Floats:
    cumulative = np.cumsum(probability)
    cumulative /= cumulative[-1]
    # What has no power must not be drawn by the last random number either.
    cumulative[np.flatnonzero(probability)[-1] :] = 1.0
    return np.asarray(cumulative)


def _fixed(array: NDArray[Any]) -> NDArray[Any]:
    array = np.ascontiguousarray(array)
    array.flags.writeable = False
    return array
