"""Which microlenses can see a point: where the light of the point falls onto the array."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.points.projection_chiefs import ThroughArray, rays_from
from plenoptic.camera.psf.sensor_hits import Task
from plenoptic.optics.lens.record import LensRecord
from plenoptic.optics.lens.trace import traced_by
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.listed import Lenslets, described, lattice_types

Floats = NDArray[np.float64]

_RINGS = (1.0, 0.75, 0.5, 0.25, 0.0)
"""Where rays enter, as parts of the way from the middle of what a point's light enters through to its corners."""
_ROOM = 1.25
"""Microlenses are looked for in a box around the light that is larger by this factor."""


class Footprints(NamedTuple):
    """Rays of points that are in sight, all with as many."""

    number: NDArray[np.int64]
    """(m,): which of the points they come from."""
    entering: Floats
    """(m, f, 2): where they enter, on the plane of the entrance."""
    arriving: Floats
    """(m, f, 2): where they meet the array, local; nan where they do not."""
    landing: Floats
    """(m, f, 2): where they would meet the sensor, in its own axes, if a microlens were centred on them."""
    passing: NDArray[np.bool_]
    """(m, f): whether the lens lets them pass."""


def footprints(tasks: list[Task], lens: LensRecord, aim: ThroughArray, *, z: float, wavelength: float) -> Footprints:
    """Trace the rings of rays of every point that has tasks; `lens` has its stops and rims."""
    firsts = {task.number: task for task in tasks[::-1]}
    number = np.array(sorted(firsts), dtype=np.int64)
    entering = np.stack([_rings(firsts[k].triangles) for k in number])
    points = np.repeat([firsts[k].point for k in number], entering.shape[1], axis=0)
    rays = rays_from(points, entering.reshape(-1, 2), z, wavelength)
    traced = traced_by(aim.tables, rays)
    arriving = aim.places(traced)
    landing = aim.landing(arriving, traced).reshape(entering.shape)
    passing = (traced_by(lens, rays).status == 0).reshape(entering.shape[:2])
    return Footprints(number, entering, arriving.reshape(entering.shape), landing, passing)


def _rings(triangles: NDArray[np.void]) -> Floats:
    """Points (f, 2) of a fan of triangles: its corners, and others towards the middle."""
    fan = triangles[np.linspace(0, len(triangles) - 1, 16).round().astype(int)]
    start, first, second = (np.column_stack([fan[x], fan[y]]) for x, y in (("x", "y"), ("ax", "ay"), ("bx", "by")))
    corners = start[:, None] + np.stack([np.zeros((16, 2)), first, second], axis=1)
    middle = corners.reshape(-1, 2).mean(axis=0)
    outline = corners[:, 1:].reshape(-1, 2)
    return np.concatenate([middle + share * (outline - middle) for share in _RINGS])


def candidates(prints: Footprints, aim: ThroughArray) -> NDArray[np.int64]:
    """(k, 3): numbers of points and lattice indices of the microlenses in boxes around their light.

    Those whose chief rays would land farther beside the sensor than a tenth of its size, or two pitches, are left out.
    """
    axes, array = aim.axes, aim.array
    height, width = axes.camera.sensor.size
    limit = np.array([width, height])
    limit = 0.5 * limit + np.maximum(0.1 * limit, 2.0 * max(array.pitches))
    found = [np.empty((0, 3), dtype=np.int64)]
    for number, arriving, landing in zip(prints.number, prints.arriving, prints.landing, strict=True):
        met = np.isfinite(arriving).all(axis=1)
        if not met.any():
            continue
        on_array = axes.on_array(arriving[met])
        low, high = on_array.min(axis=0), on_array.max(axis=0)
        room = 0.5 * (_ROOM - 1.0) * (high - low) + array.cell_radius
        lenses = array.lenses(low - room, high + room)
        near = np.abs(_linear(on_array, landing[met], lenses.axis)) <= limit
        index = lenses.index[near.all(axis=1)]
        found.append(np.column_stack([np.full(len(index), number), index]))
    return np.concatenate(found)


def _linear(places: Floats, values: Floats, wanted: Floats) -> Floats:
    """Values (n, 2) at `wanted` (n, 2) of the linear function that is nearest to those at places (m, 2)."""
    middle = places.mean(axis=0)
    series, *_ = np.linalg.lstsq(np.column_stack([places - middle, np.ones(len(places))]), values, rcond=None)
    return np.asarray((wanted - middle) @ series[:2] + series[2])


def unique_rows(keys: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The different rows (k, c) of whole numbers (n, c) in order, and which of them each row is (n,)."""
    if not len(keys):
        return keys, np.empty(0, np.int64)
    order = np.lexsort(keys.T[::-1])
    ordered = keys[order]
    new = np.append(True, (ordered[1:] != ordered[:-1]).any(axis=1))
    row = np.empty(len(keys), np.int64)
    row[order] = np.cumsum(new) - 1
    return ordered[new], row


def lenses_of(array: MicrolensArray, index: NDArray[np.int64]) -> Lenslets:
    """The microlenses with the lattice indices (n, 2), those of FREE ones being (number, 0)."""
    once, row = unique_rows(index)
    if array.centres is None:
        found = described(array, once, once @ array.basis, lattice_types(array, once))
    else:
        types = np.zeros(len(once), np.int64) if array.types is None else np.asarray(array.types)[once[:, 0]]
        found = described(array, once, np.asarray(array.centres)[once[:, 0]], types)
    return Lenslets(*(getattr(found, field.name)[row] for field in dataclasses.fields(found)))


def nearest_rays(prints: Footprints, number: NDArray[np.int64], places: Floats, *, passing: bool) -> Floats:
    """Where the rays of points `number` (n,) enter that meet the array nearest to `places` (n, 2); nan without one."""
    found = np.full(places.shape, np.nan)
    for k, point in enumerate(prints.number):
        low, high = np.searchsorted(number, [point, point + 1])
        usable = np.isfinite(prints.arriving[k]).all(axis=1)
        if passing:
            usable &= prints.passing[k]
        if low == high or not usable.any():
            continue
        arriving, entering = prints.arriving[k][usable], prints.entering[k][usable]
        off = places[low:high, None] - arriving
        found[low:high] = entering[np.einsum("nfi,nfi->nf", off, off).argmin(axis=1)]
    return found
