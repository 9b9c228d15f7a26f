"""Developing: one exposure, many sensors."""

from __future__ import annotations

import enum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.parallel import run_in_order, thread_count
from plenoptic.core.values import Floats, check_kind
from plenoptic.errors import InvalidValueError
from plenoptic.optics.sensor.color_filter import channels_of
from plenoptic.optics.sensor.model import SensorModel, ShotNoise, as_seed, has
from plenoptic.readout.raw import RawImage
from plenoptic.rendering.exposure import Exposure

__all__ = ["develop"]

_BAND = 1 << 18
"""Numbers in a band of rows: float64 of a few bands fit into a cache of 10 MB, and their overhead is negligible."""


_MOST = 1e300
"""Electrons from light beyond which a number might overflow; every sensor is long saturated there."""


class _Purpose(enum.IntEnum):
    """What random numbers are for; part of their key, so that no two purposes share any."""

    SHOT = 1
    READ = 2
    ROW = 3
    PRNU = 4
    DSNU = 5
    COLUMN = 6
    DEAD = 7
    HOT = 8


def develop(exposure: Exposure, model: SensorModel, *, seed: int = 0, threads: int | None = None) -> RawImage:
    """What a sensor reads out after an exposure.

    The image is taken for the mean light on each pixel. Its Monte Carlo error is not sensor noise: it is
    there in addition, the same in every raw image of one exposure, and should be well below the shot noise.

    Parameters
    ----------
    exposure : Exposure
        Values finite and at least 0. One of a single channel stands for three equal ones where the sensor tells
        channels apart, since scenes without colour, and white images, have one channel.
    model : SensorModel
    seed : int
        Of shot, read and row noise, which differ from one exposure to the next; fixed patterns have the model's
        `pattern_seed`. Every random number is a function of seed, purpose, row, column and channel, so that the
        same seed gives the same bits, with any number of threads, and a region of an exposure those of the whole.
    threads : int, optional
        As many as there are processors by default.

    Raises
    ------
    InvalidValueError
        Where the exposure holds values that are negative or not finite, or the seed is none.

    Examples
    --------
    >>> import numpy as np
    >>> import plenoptic as pl
    >>> from plenoptic.readout.develop import develop
    >>> from plenoptic.optics.sensor.model import SensorModel
    >>> shot = pl.Exposure(np.full((100, 100, 1), 0.5))
    >>> raw = develop(shot, SensorModel(photon_rate=2000.0, read_noise=2.0), seed=1)
    >>> raw
    RawImage(100 x 100, 12 bits, 0 % saturated)
    >>> bool(abs(raw.data.mean() - 1000) < 4 * raw.data.std() / 100)
    True
    """
    check_kind(exposure, "exposure", Exposure, "pl.render(scene, camera)")
    check_kind(model, "model", SensorModel, "pl.SensorModel(photon_rate=1e6)")
    _check_light(exposure.image)
    seed = as_seed(seed, "seed")
    rows, columns, channels = exposure.image.shape
    height = max(1, _BAND // (columns * channels))
    first_row, first_column = (0, 0) if exposure.region is None else (exposure.region[0], exposure.region[2])

    def band(start: int) -> NDArray[Any]:
        return _band(exposure.image[start : start + height], model, seed, first_row + start, first_column)

    bands = list(run_in_order(band, range(0, rows, height), threads=thread_count(threads)))
    data = np.concatenate(bands)
    data = data[:, :, 0] if data.shape[2] == 1 else data
    named = {name: getattr(exposure, name) for name in ("region", "samples", "camera")}
    return RawImage(data, model, seed=seed, **named)


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
    _spoil(electrons, model, draw)
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
    return _converted(electrons, model)


def _mean_light(image: NDArray[np.float32], model: SensorModel, row: int, column: int) -> Floats:
    """Mean electrons from light, (H, W, C); C is 1 behind colour filters."""
    light = image.astype(np.float64)
    if model.is_coloured and light.shape[2] == 1:
        light = np.repeat(light, 3, axis=2)
    with np.errstate(over="ignore"):
        light = np.minimum(light * model.electrons_per_unit, _MOST)
    if model.colour_filters is None:
        return light
    seen = channels_of(model.colour_filters, image.shape[:2], (row, column))
    return np.take_along_axis(light, seen[:, :, np.newaxis], axis=2)


def _spoil(electrons: Floats, model: SensorModel, draw: _Draws) -> None:
    """Give hot pixels their current and take everything from dead ones; a pixel that is both is dead."""
    if has(model.hot):
        electrons[draw.chosen(model.hot, model.pattern_seed, _Purpose.HOT)] += model.hot_current * model.exposure_time
    if has(model.dead):
        electrons[draw.chosen(model.dead, model.pattern_seed, _Purpose.DEAD)] = 0.0


def _converted(electrons: Floats, model: SensorModel) -> NDArray[Any]:
    with np.errstate(over="ignore"):
        numbers = model.black_level + model.gain * electrons
    if model.bits is None:
        return numbers
    rounded: NDArray[np.uint16] = np.rint(np.clip(numbers, 0.0, 2.0**model.bits - 1)).astype(np.uint16)
    return rounded


class _Draws(NamedTuple):
    """Random numbers for a rectangle of pixels that begins at (row, column) of the sensor."""

    shape: tuple[int, int]
    row: int
    column: int

    def normals(self, like: Floats, seed: int, purpose: _Purpose) -> Floats:
        """Standard normal numbers that fit `like`: one for each pixel, row or column."""
        from plenoptic.optics.sensor.kernels import noise as noise_kernels

        rows, columns, channels = like.shape
        _, row, column = self
        if purpose == _Purpose.ROW:
            columns, column = 1, 0
        if purpose == _Purpose.COLUMN:
            rows, row = 1, 0
        normals = np.empty((rows, columns, channels))
        noise_kernels.fill_normals(normals, np.uint64(seed), int(purpose), row, column)
        return normals

    def poisson(self, means: Floats, seed: int) -> Floats:
        """Poisson numbers of these means."""
        from plenoptic.optics.sensor.kernels import noise as noise_kernels

        counts = np.empty(means.shape)
        noise_kernels.fill_poisson(counts, means, np.uint64(seed), int(_Purpose.SHOT), self.row, self.column)
        return counts

    def chosen(self, which: float | NDArray[np.int64], seed: int, purpose: _Purpose) -> NDArray[np.bool_]:
        """(H, W): the pixels that a list names, or each with the probability that a fraction says."""
        from plenoptic.optics.sensor.kernels import noise as noise_kernels

        if isinstance(which, np.ndarray):
            mask = np.zeros(self.shape, dtype=np.bool_)
            place = which - (self.row, self.column)
            inside = ((place >= 0) & (place < self.shape)).all(axis=1)
            mask[tuple(place[inside].T)] = True
            return mask
        uniforms = np.empty(self.shape)
        noise_kernels.fill_uniforms(uniforms, np.uint64(seed), int(purpose), self.row, self.column)
        below: NDArray[np.bool_] = uniforms < which
        return below
