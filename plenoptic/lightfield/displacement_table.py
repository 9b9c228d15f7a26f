"""Displacement of pixels from the pinhole model, interpolated between traced pixels of some microlenses.

Over the array, displacement at one offset from the centre of a micro image is a polynomial. Within a micro image it has
kinks where the main lens begins to vignette, and is tabulated on a grid of offsets.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray

from plenoptic.camera.assembly import array_axes
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.points.centres import CentreMethod, MicrolensCentres, microlens_centres
from plenoptic.core.parallel import run_in_order
from plenoptic.core.values import Floats
from plenoptic.lightfield.pinhole_model import (
    PinholeModel,
    chief_ray_displacement,
    chord_disparity,
    object_plane_pair,
    trace_displacement,
)
from plenoptic.optics.microlens.lattice import neighbour_steps

_SERIES = ((4, 3), (8, 5))
"""Microlenses along a side of the sensor whose pixels are traced, and terms of the series along each side; the first
that is accurate is used."""
_MIN_LENSES = 8
"""Microlenses of the sensor for each traced one, below which it is faster to trace all pixels."""
_CHECKED_LENSES, _CHECKED_PIXELS = 5, 40
"""Microlenses along a side, and pixels of each, that are traced for comparison."""
_MAX_ERROR, _MAX_CHIEF_ERROR = 0.03, 0.003
"""Largest RMS error of the displacement of lit pixels and of chief rays, in pixels. The sampling of apertures makes
0.02 of the former, also in traced pixels."""
_MAX_CHORD_ERROR = 3e-4
"""Largest relative RMS error of chord disparity."""
_LIT, _MIN_THROUGHPUT = 0.7, 0.1
"""Throughput from which on displacement is compared, and below which it is unknown."""
_SPACING, _CHORD_SPACING = 0.5, 2.0
"""Spacing of tabulated offsets, pixels."""
_CHORD_NODES = 6
"""Disparities at which chord disparity is tabulated."""
_BLOCK = 64
"""Microlenses interpolated together."""

Traced = Callable[[Floats, Floats, NDArray[np.int64], NDArray[np.int64]], Floats]
"""Values (n, f) of pixels (n, 2) behind microlenses with centres on the array (n, 2), of indices (n, 2) and types (n,).
"""


class DisplacementTable(NamedTuple):
    """Values of pixels as Legendre series in the position of the microlens on the array, for each offset of a grid.

    Offsets are from the microlens's chief ray, in pixels.
    """

    low: Floats
    high: Floats
    """(2,): bounds of microlens positions, mm."""
    spacing: float
    """Spacing of the offsets, which go from -half spacing to half spacing in rows and columns."""
    half: int
    series: Floats
    """(types, terms, offsets, offsets, f)."""

    def basis(self, on_array: Floats) -> Floats:
        """Legendre polynomials (n, terms) at positions (n, 2)."""
        terms = round(self.series.shape[1] ** 0.5)
        unit = (2.0 * on_array - self.low - self.high) / np.maximum(self.high - self.low, 1e-9)
        x, y = (legvander(unit[:, k], terms - 1) for k in (0, 1))
        return np.asarray((x[:, :, None] * y[:, None]).reshape(len(on_array), -1))

    def values(
        self, on_array: Floats, types: NDArray[np.int64], first: Floats, n: int, threads: int
    ) -> NDArray[np.float32]:
        """Values (k, n, n, f) of the pixels from offsets `first` (k, 2) on, behind microlenses at (k, 2)."""
        from plenoptic.lightfield.kernels.displacement_table import fill_values

        basis, result = self.basis(on_array), np.empty((len(on_array), n, n, self.series.shape[-1]), np.float32)

        def fill(start: int) -> None:
            block = slice(start, start + _BLOCK)
            workspace = np.empty(self.series.shape[2:]), np.empty(self.series.shape[3:])
            at = first[block] / self.spacing + self.half
            fill_values(result[block], self.series, basis[block], types[block], at, 1.0 / self.spacing, workspace)

        for _ in run_in_order(fill, range(0, len(on_array), _BLOCK), threads=threads):
            pass
        return result


class DisplacementTables(NamedTuple):
    """Tables of a camera; None where one is not accurate, or not faster than tracing."""

    centres: MicrolensCentres
    """Of the chief rays."""
    image: DisplacementTable | None
    """Throughput t, t times the displacement (2, 2) from that of the chief ray, and the latter (2, 2)."""
    chord: DisplacementTable | None
    """Chord disparity over pitch, minus that of the model, at some of the latter."""


@functools.lru_cache(maxsize=4)
def displacement_tables(
    camera: PlenopticCamera, virtual_depths: tuple[float, float], threads: int
) -> DisplacementTables:
    """Trace the tables of a camera for a range of virtual depths; those of the last cameras are kept."""
    array = camera.microlenses
    assert array is not None
    model = PinholeModel(array_axes(camera), array, object_plane_pair(camera, virtual_depths), threads)
    centres, steps = microlens_centres(camera, CentreMethod.CHIEF_RAY), neighbour_steps(array.lattice)
    planes, at = (
        np.array([plane.disparity_per_pitch for plane in model.planes]),
        chord_nodes(1.0 / np.array(virtual_depths)),
    )

    def trace_image(pixel: Floats, on_array: Floats, _: NDArray[np.int64], types: NDArray[np.int64]) -> Floats:
        throughput, displacement = trace_displacement(model, pixel, on_array, types)
        chief = np.stack(chief_ray_displacement(model, pixel, on_array), axis=1)
        weighted = np.where(throughput[:, None, None] > 0, throughput[:, None, None] * (displacement - chief), 0.0)
        return np.column_stack([throughput, weighted.reshape(-1, 4), chief.reshape(-1, 4)])

    def compare(values: Floats) -> Floats:
        throughput, displacement = throughput_and_displacement(values)
        displacement[throughput < _LIT] = np.nan
        both = (
            coefficients[:, 0] + planes[:, None, None] * coefficients[:, 1]
            for coefficients in (displacement / _MAX_ERROR, values[:, 5:].reshape(-1, 2, 2) / _MAX_CHIEF_ERROR)
        )
        return np.concatenate(list(both)).transpose(1, 0, 2).reshape(len(values), -1)

    def trace_chord(pixel: Floats, _: Floats, index: NDArray[np.int64], __: NDArray[np.int64]) -> Floats:
        disparities = (np.full(len(pixel), per_pitch) for per_pitch in at.tolist())
        return np.stack([chord_disparity(model, pixel, index, steps, one) - one for one in disparities], axis=1)

    radius, n_types = 0.5 * min(array.pitches) / camera.sensor.pixel_pitch, len(array.focal_lengths)
    return DisplacementTables(
        centres,
        _table(trace_image, compare, centres, n_types, radius, _SPACING),
        _table(trace_chord, lambda values: values / (_MAX_CHORD_ERROR * at), centres, 1, radius, _CHORD_SPACING),
    )


def chord_nodes(ends: Floats) -> Floats:
    """Disparities over pitch of the table of chord disparity, from the ends (2,) of their range: Chebyshev's nodes."""
    angle = np.pi * (np.arange(_CHORD_NODES) + 0.5) / _CHORD_NODES
    return np.asarray(0.5 * (ends.sum() - (ends.max() - ends.min()) * np.cos(angle)))


def throughput_and_displacement(values: Floats) -> tuple[Floats, Floats]:
    """Throughput (n,) and displacement (n, 2, 2), as of `trace_displacement`, from values (n, 9) of the image table."""
    throughput, weighted, chief = values[:, 0], values[:, 1:5], values[:, 5:]
    with np.errstate(divide="ignore", invalid="ignore"):
        displacement = np.where(throughput[:, None] > _MIN_THROUGHPUT, chief + weighted / throughput[:, None], np.nan)
    return np.clip(throughput, 0.0, 1.0), displacement.reshape(-1, 2, 2)


def chord_of_values(values: Floats, nodes: Floats, per_pitch: Floats) -> Floats:
    """Chord disparity over pitch (n,) from values (n, k) of the chord table: the polynomial through k nodes."""
    total = per_pitch.copy()
    for k, node in enumerate(nodes):
        other_nodes = np.delete(nodes, k)
        total += np.prod([(per_pitch - other) / (node - other) for other in other_nodes], axis=0) * values[:, k]
    return total


def _table(
    traced: Traced,
    compare: Callable[[Floats], Floats],
    centres: MicrolensCentres,
    n_types: int,
    radius: float,
    spacing: float,
) -> DisplacementTable | None:
    """Table of traced values up to a radius in pixels; None if it is not accurate.

    It is if functions `compare` (n, g) of values (n, f) have RMS errors of at most 1, at pixels of other microlenses
    than the tabulated ones.
    """
    random = np.random.default_rng(1)
    lens = np.repeat(_spread(centres, (np.arange(_CHECKED_LENSES) + 0.5) / _CHECKED_LENSES), _CHECKED_PIXELS)
    types, angle = random.integers(0, n_types, len(lens)), random.uniform(0.0, 2.0 * np.pi, len(lens))
    distance = radius * np.sqrt(random.uniform(0.0, 1.0, len(lens)))
    offset = distance[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    exact = None
    for side, terms in _SERIES:
        if _MIN_LENSES * side * side > len(centres):
            break
        if exact is None:
            exact = compare(traced(centres.pixel[lens] + offset, centres.on_array[lens], centres.index[lens], types))
        table = _fit(traced, centres, (side, terms), n_types, radius, spacing)
        error = compare(table.values(centres.on_array[lens], types, offset, 1, 1)[:, 0, 0].astype(np.float64)) - exact
        if np.isfinite(error).any(axis=0).all() and (np.nanmean(error**2, axis=0) <= 1.0).all():
            return table
    return None


def _spread(centres: MicrolensCentres, parts: Floats) -> NDArray[np.int64]:
    """Numbers of the microlenses nearest to a grid, whose rows and columns divide the sensor in given parts."""
    low, high = centres.on_array.min(axis=0), centres.on_array.max(axis=0)
    grid = low + (high - low) * np.stack(np.meshgrid(parts, parts, indexing="ij"), axis=-1).reshape(-1, 2)
    return np.unique([np.square(centres.on_array - point).sum(axis=1).argmin() for point in grid])


def _fit(
    traced: Traced, centres: MicrolensCentres, size: tuple[int, int], n_types: int, radius: float, spacing: float
) -> DisplacementTable:
    """Table of size (traced microlenses along a side, terms)."""
    side, terms = size
    nodes, half = (
        _spread(centres, 0.5 - 0.5 * np.cos(np.pi * (np.arange(side) + 0.5) / side)),
        int(radius / spacing) + 3,
    )
    steps = spacing * np.arange(-half, half + 1)
    offset = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    # Interpolation takes four grid points along each side.
    near = np.flatnonzero(np.hypot(*offset.T) <= radius + 3.0 * spacing)
    lens, place = (grid.ravel() for grid in np.meshgrid(nodes, near, indexing="ij"))
    low, high = centres.on_array.min(axis=0), centres.on_array.max(axis=0)
    table = DisplacementTable(low, high, spacing, half, np.empty((n_types, terms * terms, 0, 0, 0)))
    fit, series = np.linalg.pinv(table.basis(centres.on_array[nodes])), []
    for lens_type in range(n_types):
        types = np.full(len(lens), lens_type)
        values = traced(centres.pixel[lens] + offset[place], centres.on_array[lens], centres.index[lens], types)
        grid = np.zeros((len(fit), len(offset), values.shape[1]))
        grid[:, near] = (fit @ values.reshape(len(nodes), -1)).reshape(len(fit), len(near), -1)
        series.append(grid.reshape(len(fit), len(steps), len(steps), -1))
    return table._replace(series=np.stack(series))
