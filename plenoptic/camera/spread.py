"""Short bends: light is shared between the pixels that it reaches. Long ones are drawn; see `diffraction`.

A path to a place of the sensor stands for light that is headed there. Bends send it to the pixels around, in shares
that are known: those of short bends are added up with each path, so that pixels use the paths of their neighbours and
no bend is left to chance. What bends farther is little, and drawn for one path in `EVERY`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import Assembly, sensor_corners
from plenoptic.camera.sampling.record import Batch, SpreadTable, batch_record
from plenoptic.core.color.spectra import ColourTables
from plenoptic.core.values import Floats
from plenoptic.optics.diffraction.far_field import without

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.camera.diffraction import BendRecord
    from plenoptic.camera.record import SensorRecord

EVERY = 4
"""Paths for each drawn bend."""
APART = 1 << 48
"""From numbers of pixels to those by which drawn bends have random numbers of their own."""
_FINE = 32
"""Places along a side of a pixel: what changes within one blurs less than 0.1 % of the contrast at any frequency."""
_LEVEL = 0.01
"""Steps of distances from the array, over these."""
_REACH, _DRAWN = 3, 0.05
"""The most pixels on each side with which light is shared, and the part that may be left to draws for fewer."""


class Spread(NamedTuple):
    """How light is shared between pixels, and what is drawn."""

    table: SpreadTable
    rest: BendRecord
    """Of bends that are not short."""
    drawn: float
    """Their share of the light."""


def spread_of(
    camera: PlenopticCamera, sensor: SensorRecord, parts: Assembly, bend: BendRecord, colour: ColourTables | None
) -> Spread:
    """Divide bends: short are those of which each wavelength's end within some pixels, at any distance."""
    wavelengths = bend.wavelengths[:1] if len(bend.wavelengths) == 1 else bend.wavelengths[1:]
    distances = np.array([sensor.plane.distance])
    if parts.tilt is not None:
        found = sensor.plane.distance + sensor_corners(camera, parts)[:, :2] @ parts.tilt
        least, most = float(found.min()), float(found.max())
        n = max(1, int(np.ceil(np.log(most / least) / _LEVEL)))
        distances = least + (most - least) * (np.arange(n) + 0.5) / n
    scale = bend.back @ bend.field.scale
    longest = float(wavelengths.max() * distances.max())
    along = (np.arange(len(bend.field.columns)) + 0.5) * bend.field.step - bend.field.inner
    x, y = np.meshgrid(along, along)
    farthest = longest * np.abs(scale).sum(axis=1) * 0.5 * bend.field.step
    ends = np.stack([longest * np.abs(row[0] * x + row[1] * y) + far for row, far in zip(scale, farthest, strict=True)])
    for reach in range(1, _REACH + 1):
        short = np.asarray((ends <= reach).all(axis=0))
        rest, drawn = without(bend.field, short)
        if drawn <= _DRAWN:
            break
    lit = np.diff(bend.field.columns, axis=1) * np.diff(bend.field.rows)[:, None]
    kinds = [lit[short]]
    if bend.field.opening is not None:
        through = bend.field.opening[short]
        kinds = [lit[short] * through, lit[short] * (1.0 - bend.field.share * through) / (1.0 - bend.field.share)]
    at = np.stack([x[short], y[short]])
    cover = _covers(np.asarray(camera.sensor.pixel_aperture), reach)
    rows = [
        _shares((wavelength * distance) * (scale @ at), light, cover, reach) / sensor.fill_factor
        for wavelength in wavelengths
        for distance in distances
        for light in kinds
    ]
    means = None
    if len(rows) == len(wavelengths):
        chances = np.ones(1) if colour is None else np.diff(colour.cdf, prepend=0.0)
        means = np.einsum("w,wk->k", chances, np.stack([part.mean(axis=0) for part in rows]))
    low, step = float(distances[0]), float(distances[1] - distances[0]) if len(distances) > 1 else 1.0
    table = SpreadTable(
        np.concatenate(rows),
        means,
        reach,
        _FINE,
        len(kinds),
        len(distances),
        sensor.plane,
        low - 0.5 * step,
        1.0 / step,
    )
    return Spread(table, bend._replace(field=rest), drawn)


def _covers(aperture: Floats, reach: int) -> list[Floats]:
    """Along x and y, what of places lies in the parts of pixels that see light: (pixels, places of all of them)."""
    edges = np.arange((2 * reach + 1) * _FINE + 1) / _FINE - reach - 0.5
    pixel = np.arange(-reach, reach + 1)[:, None]
    found = []
    for part in aperture:
        inside = np.clip(edges, pixel - 0.5 * part, pixel + 0.5 * part)
        found.append(np.diff(inside, axis=1) * _FINE)
    return found


def _shares(ends: Floats, light: Floats, covers: list[Floats], reach: int) -> Floats:
    """(_FINE^2, pixels): what pixels get of light that is headed to places of the middle one, and bends by `ends`
    (2, n) pixels.
    """
    n = 2 * reach * _FINE + 1
    place = np.clip((ends + reach) * _FINE, 0.0, n - 1.000001)
    corner = place.astype(np.int64)
    x, y = place - corner
    spread = np.zeros(n * n)
    for right, wide in ((0, 1.0 - x), (1, x)):
        for down, high in ((0, 1.0 - y), (1, y)):
            at = (corner[1] + down) * n + corner[0] + right
            spread += np.bincount(at, weights=light * wide * high, minlength=n * n)
    # Places of the middle pixel, moved by each step of the grid.
    moved = np.arange(_FINE)[:, None] + np.arange(n)
    by_x, by_y = (cover[:, moved] for cover in covers)
    found = np.einsum("dim,mn,ajn->ijda", by_y, spread.reshape(n, n), by_x, optimize=True)
    return np.ascontiguousarray(found.reshape(_FINE * _FINE, -1))


def rest_of(batch: Batch) -> Batch:
    """The drawn bends that belong to a batch: the first stands for its first `EVERY` samples of a replicate, and so on,
    whichever batches these come in.
    """
    first, size = batch.first_index // EVERY, batch.samples // batch.streams
    short, long = (-(-(batch.first_index + n) // EVERY) - first for n in (size, size + 1))
    samples = batch.streams * short + batch.samples % batch.streams * (long - short)
    return batch_record(batch.seed, 0, samples, batch.streams, batch.first_stream, first)


def rest_numbers(number: NDArray[np.int64]) -> NDArray[np.int64]:
    """Numbers of pixels for random numbers of drawn bends."""
    return number + APART
