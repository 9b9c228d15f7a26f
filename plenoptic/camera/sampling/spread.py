"""Short bends: light is shared between the pixels that it reaches. Long ones are drawn; see `diffraction`.

A path to a place of the sensor stands for light that is headed there. Bends send it to the pixels around, in shares
that are known: those of short bends are added up with each path, so that pixels use the paths of their neighbours and
no short deflection is left to chance. Far deflections carry little light, and are drawn for one path in `EVERY`.
"""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import Assembly, sensor_corners
from plenoptic.camera.sampling.record import Batch, SpreadTable, batch_record
from plenoptic.core.color.spectra import ColourTables
from plenoptic.core.values import Floats
from plenoptic.optics.diffraction.far_field import remove_cells

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.camera.diffraction import BendRecord
    from plenoptic.camera.record import SensorRecord

EVERY = 4
"""Paths for each drawn bend."""
_TOGETHER = 64
"""Samples that are added up before they are given to pixels: more take less time, and longer batches."""
LEVELLING = 2
"""Paths of a pixel that tell about how light it is in a white image."""
APART = 1 << 48
"""From numbers of pixels to those by which drawn bends have random numbers of their own."""
_FINE, _FINER = 32, 2
"""Places along a side of a pixel, for which shares are averages, and points of a grid in each for averaging."""
_LEVEL = 0.02
"""Steps of the pattern's size on the sensor, over the least."""
_REACH, _DRAWN = 3, 0.06
"""The most pixels on each side with which light is shared, and the part that may be left to draws for fewer."""
_MOST_DRAWN, _LEAST_SEEN = 0.4, 0.5
"""With more left to draws, and a smaller part of pixels that sees light, sharing brings noise: all bends are drawn."""


class Spread(NamedTuple):
    """Shares of light between pixels by diffraction, and the distribution that is sampled."""

    table: SpreadTable
    rest: BendRecord
    """Of bends that are not short."""
    drawn: float
    """Their share of the light."""


def spread_of(
    camera: PlenopticCamera, sensor: SensorRecord, parts: Assembly, bend: BendRecord, colour: ColourTables | None
) -> Spread | None:
    """Divide bends: short are those that end within some pixels at every wavelength and distance from the array.

    None where it is better to draw all.
    """
    plane, drawn_ones = sensor.plane, bend.wavelengths[min(1, len(bend.wavelengths) - 1) :]
    farther = np.zeros(1) if parts.tilt is None else sensor_corners(camera, parts)[:, :2] @ parts.tilt
    low = float(drawn_ones.min() * (plane.distance + farther.min()))
    largest = float(drawn_ones.max() * (plane.distance + farther.max()))
    levels = math.ceil(math.log(largest / low) / _LEVEL) or 1
    step = (largest - low) / levels or largest
    short, reach = _short(bend, largest)
    far, drawn = without(bend.field, short)
    if drawn > _MOST_DRAWN or sensor.fill_factor < _LEAST_SEEN:
        return None
    light = [(np.diff(bend.field.columns, axis=1) * np.diff(bend.field.rows)[:, None])[short]]
    if bend.field.opening is not None:
        through, blocked_share = bend.field.opening[short], bend.field.share
        light = [light[0] * through, light[0] * (1.0 - blocked_share * through) / (1.0 - blocked_share)]
    cells, covers = np.stack(np.nonzero(short)[::-1]), _covers(np.asarray(camera.sensor.pixel_aperture), reach)
    sizes = low + step * (np.arange(levels) + 0.5) if largest > low else np.array([largest])
    rows = [_shares(bend, size, cells, part, covers) / sensor.fill_factor for size in sizes for part in light]
    means = None
    if parts.tilt is None and len(light) == 1:
        chances = np.ones((1, 1)) if colour is None else np.diff(colour.cdf, prepend=0.0) * colour.weights.T
        at = np.clip((drawn_ones * plane.distance - low) * (1.0 / step), 0, levels - 1).astype(np.int64)
        means = chances @ np.stack([part.mean(axis=0) for part in rows])[at]
    table = SpreadTable(
        parts=np.concatenate(rows),
        means=means,
        reach=reach,
        fine=_FINE,
        kinds=len(light),
        plane=plane,
        wavelengths=bend.wavelengths,
        levels=levels,
        low=low,
        per_level=1.0 / step,
    )
    return Spread(table, bend._replace(field=far), drawn)


def _ends(bend: BendRecord, longest: float, cells: Floats) -> Floats:
    """(2, ...): how far bends lead, in pixels, of places (2, ...) in the table, in cells along x and y."""
    periods = cells * bend.field.step - bend.field.radius
    return np.asarray(np.tensordot(longest * (bend.back @ bend.field.scale), periods, axes=1))


def _short(bend: BendRecord, longest: float) -> tuple[NDArray[np.bool_], int]:
    """Cells (n, n) of the table that end within some pixels at a wavelength times a distance, and in how many."""
    corners = np.arange(len(bend.field.columns) + 1.0)
    ends = np.abs(_ends(bend, longest, np.stack(np.meshgrid(corners, corners)))).max(axis=0)
    ends = np.maximum(np.maximum(ends[1:, 1:], ends[:-1, :-1]), np.maximum(ends[1:, :-1], ends[:-1, 1:]))
    for reach in range(1, _REACH):
        if remove_cells(bend.field, ends <= reach)[1] <= _DRAWN:
            return ends <= reach, reach
    return ends <= _REACH, _REACH


def _covers(aperture: Floats, reach: int) -> list[Floats]:
    """(pixels, places, steps): part of the middle pixel's points, moved by each step of a grid, in the light-sensitive
    parts of pixels, along x and y.
    """
    fine = _FINE * _FINER
    edges = np.arange((2 * reach + 1) * fine + 1) / fine - reach - 0.5
    pixel = np.arange(-reach, reach + 1)[:, None]
    moved = np.arange(fine)[:, None] + np.arange(2 * reach * fine + 1)
    covers = []
    for part in aperture:
        inside = np.diff(np.clip(edges, pixel - 0.5 * part, pixel + 0.5 * part), axis=1) * fine
        covers.append(inside[:, moved].reshape(len(pixel), _FINE, _FINER, -1).mean(axis=2))
    return covers


def _shares(bend: BendRecord, longest: float, cells: NDArray[np.int64], light: Floats, covers: list[Floats]) -> Floats:
    """(_FINE^2, pixels): shares of light that is headed to points of the middle pixel and deflected by cells (2, k) of
    the table.
    """
    reach, fine, n = len(covers[0]) // 2, _FINE * _FINER, covers[0].shape[2]
    grid = np.zeros(n * n)
    # Points of a cell, nearer to one another than those of the grid, to which their light is divided.
    widest = float(np.abs(_ends(bend, longest, np.eye(2)) - _ends(bend, longest, np.zeros((2, 2)))).max())
    points = math.ceil(widest * fine)
    along = (np.arange(points) + 0.5) / points
    light = np.tile(light, points)
    for across in along:
        inside = np.stack(np.broadcast_arrays(cells[0] + along[:, None], cells[1] + across)).reshape(2, -1)
        at = np.clip((_ends(bend, longest, inside) + reach) * fine, 0.0, n - 1 - 1e-9)
        corner = at.astype(np.int64)
        part = at - corner
        for right, down in itertools.product((0, 1), (0, 1)):
            weight = np.abs(1 - right - part[0]) * np.abs(1 - down - part[1])
            grid += np.bincount((corner[1] + down) * n + corner[0] + right, weight * light, minlength=n * n)
    by_x, by_y = covers
    shares = np.einsum("dim,mn,ajn->ijda", by_y, grid.reshape(n, n) / points**2, by_x, optimize=True)
    return np.ascontiguousarray(shares.reshape(_FINE * _FINE, -1))


def samples_together(replicates: int) -> int:
    """Number of samples after which a batch may end without other bits: sums begin anew there."""
    step = EVERY * replicates
    return max(_TOGETHER // step, 1) * step


def rest_of(batch: Batch) -> Batch:
    """The drawn bends that belong to a batch: the first stands for its first `EVERY` samples of a replicate, and so on,
    whichever batches these come in.
    """
    first, size = batch.first_index // EVERY, batch.samples // batch.streams
    short, long = (-(-(batch.first_index + n) // EVERY) - first for n in (size, size + 1))
    samples = batch.streams * short + batch.samples % batch.streams * (long - short)
    return batch_record(batch.seed, 0, samples, batch.streams, batch.first_stream, first)


def levelling_numbers(number: NDArray[np.int64]) -> NDArray[np.int64]:
    """Numbers of pixels for random numbers of paths that tell how light it is."""
    return number + 2 * APART


def rest_numbers(number: NDArray[np.int64]) -> NDArray[np.int64]:
    """Numbers of pixels for random numbers of drawn bends."""
    return number + APART
