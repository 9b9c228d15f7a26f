"""Developing: one exposure, many sensors."""

from __future__ import annotations

import enum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.parallel import run_in_order, thread_count
from plenoptic.core.values import Floats, check_kind, seed_number
from plenoptic.errors import InvalidValueError
from plenoptic.optics.sensor.color_filter import channels_of
from plenoptic.optics.sensor.model import SensorModel, ShotNoise, any_pixels
from plenoptic.readout.raw import RawImage
from plenoptic.rendering.exposure import Exposure

_BAND = 1 << 18
"""Numbers in a band of rows: float64 of a few bands fit into a cache of 10 MB, and their overhead is negligible."""
_MAX_ELECTRONS = 1e300
"""Limit of the electrons from light, so that no number overflows; every sensor is saturated far below."""


class _Purpose(enum.IntEnum):
    """Purpose of random numbers; part of their key, so that no two purposes share any."""

    SHOT = 1
    READ = 2
    ROW = 3
    PRNU = 4
    DSNU = 5
    COLUMN = 6
    DEAD = 7
    HOT = 8


def develop(exposure: Exposure, model: SensorModel, *, seed: int = 0, threads: int | None = None) -> RawImage:
    """Read an exposure out by a sensor; see `Exposure.develop`.

    The image is the mean light on each pixel, which must be finite and at least 0. A single channel, as of scenes
    without colour, stands for three equal ones if the channels of the sensor differ. `seed` is that of shot, read and
    row noise; fixed patterns have the model's `pattern_seed`. Every random number is a function of seed, purpose, row,
    column and channel: bits do not depend on threads, and those of a region are those of the whole.
    """
    check_kind(exposure, "exposure", Exposure, "pl.render(scene, camera)")
    check_kind(model, "model", SensorModel, "pl.SensorModel(photon_rate=1e6)")
    _check_light(exposure.image)
    seed = seed_number(seed)
    rows, columns, channels = exposure.image.shape
    height = max(1, _BAND // (columns * channels))
    first_row, first_column = (0, 0) if exposure.region is None else (exposure.region[0], exposure.region[2])

    def band(start: int) -> NDArray[Any]:
        return _band(exposure.image[start : start + height], model, seed, first_row + start, first_column)

    data = np.concatenate(list(run_in_order(band, range(0, rows, height), threads=thread_count(threads))))
    data = data[:, :, 0] if data.shape[2] == 1 else data
    region, samples, camera = exposure.region, exposure.samples, exposure.camera
    return RawImage(data, model, region=region, seed=seed, samples=samples, camera=camera)


def _check_light(image: NDArray[np.float32]) -> None:
    wrong = ~np.isfinite(image) | (image < 0)
    if wrong.any():
        row, column, channel = np.argwhere(wrong)[0]
        raise InvalidValueError(
            f"the image holds {image[row, column, channel]} at row {row}, column {column}, and {wrong.sum()} such "
            "values in all; light must be finite and at least 0: replace them first"
        )


def _band(image: NDArray[np.float32], model: SensorModel, seed: int, row: int, column: int) -> NDArray[Any]:
    """A band of rows of the image, (H, W, C), as digital numbers."""
    draw = _Draws(image.shape[:2], row, column)
    electrons = _mean_light(image, model, row, column)
    if model.prnu:
        electrons *= np.maximum(1.0 + model.prnu * draw.normals(electrons, model.pattern_seed, _Purpose.PRNU), 0.0)
    electrons += model.dark_electrons
    # A pixel that is both hot and dead is dead.
    if any_pixels(model.hot):
        electrons[draw.chosen(model.hot, model.pattern_seed, _Purpose.HOT)] += model.hot_current * model.exposure_time
    if any_pixels(model.dead):
        electrons[draw.chosen(model.dead, model.pattern_seed, _Purpose.DEAD)] = 0.0
    if model.shot_noise == ShotNoise.POISSON:
        electrons = draw.poisson(electrons, seed)
    if model.full_well is not None:
        np.minimum(electrons, model.full_well, out=electrons)
    for spread, of, purpose in (
        (model.dsnu, model.pattern_seed, _Purpose.DSNU),
        (model.column_dsnu, model.pattern_seed, _Purpose.COLUMN),
        (model.read_noise, seed, _Purpose.READ),
        (model.row_noise, seed, _Purpose.ROW),
    ):
        if spread:
            electrons += spread * draw.normals(electrons, of, purpose)
    with np.errstate(over="ignore"):
        numbers = model.black_level + model.gain * electrons
    if model.bits is None:
        return numbers
    return np.rint(np.clip(numbers, 0.0, 2.0**model.bits - 1)).astype(np.uint16)


def _mean_light(image: NDArray[np.float32], model: SensorModel, row: int, column: int) -> Floats:
    """Mean electrons from light, (H, W, C); C is 1 behind colour filters."""
    light = image.astype(np.float64)
    if model.is_coloured and light.shape[2] == 1:
        light = np.repeat(light, 3, axis=2)
    with np.errstate(over="ignore"):
        light = np.minimum(light * model.electrons_per_unit, _MAX_ELECTRONS)
    if model.colour_filters is None:
        return light
    channel = channels_of(model.colour_filters, image.shape[:2], (row, column))
    return np.take_along_axis(light, channel[:, :, np.newaxis], axis=2)


class _Draws(NamedTuple):
    """Random numbers for a rectangle of pixels that begins at (row, column) of the sensor."""

    shape: tuple[int, int]
    row: int
    column: int

    def normals(self, like: Floats, seed: int, purpose: _Purpose) -> Floats:
        """Standard normal numbers that fit `like`: one for each pixel, row or column."""
        from plenoptic.optics.sensor.kernels.noise import fill_normals

        rows, columns, channels = like.shape
        _, row, column = self
        if purpose == _Purpose.ROW:
            columns, column = 1, 0
        if purpose == _Purpose.COLUMN:
            rows, row = 1, 0
        normals = np.empty((rows, columns, channels))
        fill_normals(normals, np.uint64(seed), int(purpose), row, column)
        return normals

    def poisson(self, means: Floats, seed: int) -> Floats:
        """Poisson numbers of these means."""
        from plenoptic.optics.sensor.kernels.noise import fill_poisson

        counts = np.empty(means.shape)
        fill_poisson(counts, means, np.uint64(seed), int(_Purpose.SHOT), self.row, self.column)
        return counts

    def chosen(self, which: float | NDArray[np.int64], seed: int, purpose: _Purpose) -> NDArray[np.bool_]:
        """Mask (H, W) of the listed pixels, or of a random fraction."""
        from plenoptic.optics.sensor.kernels.noise import fill_uniforms

        if isinstance(which, np.ndarray):
            mask, pixels = np.zeros(self.shape, dtype=np.bool_), which - (self.row, self.column)
            mask[tuple(pixels[((pixels >= 0) & (pixels < self.shape)).all(axis=1)].T)] = True
            return mask
        uniforms = np.empty(self.shape)
        fill_uniforms(uniforms, np.uint64(seed), int(purpose), self.row, self.column)
        return np.asarray(uniforms < which)
