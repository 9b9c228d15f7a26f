"""The photon transfer curve: variance against mean, measured from pairs of raw images."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.display import picture_of
from plenoptic.core.values import (
    MAX_POINTS,
    Floats,
    check_kind,
    checked_shape,
    frozen_array,
    result,
    seed_number,
    whole,
)
from plenoptic.errors import InvalidValueError
from plenoptic.optics.sensor.model import SensorModel, ShotNoise
from plenoptic.readout.develop import develop
from plenoptic.rendering.exposure import Exposure

LINEAR_PART = 0.7
"""Fraction of the range to saturation in which EMVA 1288, section 6.6, fits the gain."""


@result
class PhotonTransfer:
    """Mean and variance of even exposures, in DN and DN^2, and the prediction of the sensor's parameters.

    See `photon_transfer`, which measures them.

    Parameters
    ----------
    levels : (n,) array
        Values of the even images.
    mean, variance, pattern_variance : (n,) array
        Measured mean, temporal variance (from exposure to exposure) and variance of the fixed pattern (from pixel to
        pixel, without noise; it scatters around 0 without a pattern).
    expected_mean, expected_variance, expected_pattern_variance : (n,) array
        The same from the parameters of the sensor, as if it did not saturate.
    white_level : float
        DN at which it saturates; may be inf.
    """

    levels: Floats
    mean: Floats
    variance: Floats
    pattern_variance: Floats
    expected_mean: Floats
    expected_variance: Floats
    expected_pattern_variance: Floats
    white_level: float

    @property
    def gain(self) -> float:
        """Measured gain, DN per electron: the slope of the variance against the mean.

        Fitted through the lowest level by least squares up to 70 % of the way to saturation (EMVA 1288, release
        3.1, section 6.6); nan with fewer than two levels there. It needs shot noise.
        """
        low = int(np.argmin(self.mean))
        signal, noise = self.mean - self.mean[low], self.variance - self.variance[low]
        used = self.mean <= self.mean[low] + LINEAR_PART * (self.white_level - self.mean[low])
        square = float(np.sum(signal[used] ** 2))
        return float(np.sum(signal[used] * noise[used])) / square if square > 0 else float("nan")

    _repr_html_ = picture_of


def photon_transfer(
    model: SensorModel, levels: ArrayLike, *, shape: tuple[int, int] = (128, 128), channel: int = 0, seed: int = 0
) -> PhotonTransfer:
    """Measure the photon transfer curve of a sensor: two raw images of each of several even exposures.

    Below saturation, with mean electrons mu_p from light and mu_d from dark current,

        mean             = black_level + gain (mu_p + mu_d)
        variance         = gain^2 (mu_p + mu_d + read_noise^2 + row_noise^2) + 1/12
        pattern variance = gain^2 (prnu^2 mu_p^2 + dsnu^2 + column_dsnu^2)

    Parameters
    ----------
    model : SensorModel
        Dead and hot pixels are left out; one channel of a coloured sensor is measured.
    levels : (n,) array_like
        Values of the images, at least 0.
    shape : (int, int)
        Rows and columns of the images.
    channel : int
        0 red, 1 green, 2 blue, for sensors whose channels differ.
    seed : int
        Seed of the noise; every image has its own.

    Raises
    ------
    InvalidValueError
        If a level, shape or channel is invalid.

    References
    ----------
    EMVA Standard 1288, release 3.1 (2016), sections 2.3 and 6.6. J. R. Janesick, Photon Transfer, SPIE Press
    (2007), doi:10.1117/3.725073.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> sensor = pl.SensorModel(photon_rate=10000.0, gain=0.4, read_noise=5.0)
    >>> curve = pl.sensor.photon_transfer(sensor, np.linspace(0, 1, 11))
    >>> round(curve.gain, 1)
    0.4
    """
    check_kind(model, "model", SensorModel, "pl.SensorModel(photon_rate=1e6)")
    brightness = frozen_array(levels, name="levels", shape=("n",))
    size = checked_shape(shape, ("rows", "columns"), at_least=2, at_most=MAX_POINTS)
    single = _one_channel(model, channel)
    seeds = np.random.SeedSequence(seed_number(seed)).generate_state(2 * len(brightness), np.uint64).reshape(-1, 2)
    measured = [_measure(single, level, size, *pair) for level, pair in zip(brightness, seeds.tolist(), strict=True)]
    mean, variance, pattern = np.array(measured).reshape(-1, 3).T
    signal, noise, fixed = _predict(single, brightness)
    return PhotonTransfer(brightness, mean, variance, pattern, signal, noise, fixed, model.white_level)


def _one_channel(model: SensorModel, channel: int) -> SensorModel:
    if whole(channel, "channel", at_least=0) > 2:
        raise InvalidValueError(f"channel is {channel}; it must be 0, 1 or 2")
    return dataclasses.replace(
        model,
        photon_rate=float(np.broadcast_to(np.asarray(model.photon_rate), 3)[channel]),
        quantum_efficiency=float(np.broadcast_to(np.asarray(model.quantum_efficiency), 3)[channel]),
        colour_filters=None,
        dead=0.0,
        hot=0.0,
    )


def _measure(
    model: SensorModel, level: float, shape: tuple[int, ...], seed: int, other_seed: int
) -> tuple[float, float, float]:
    """Mean, temporal variance and variance of the fixed pattern of two raw images."""
    even = Exposure(np.full((*shape, 1), level))
    one, two = (develop(even, model, seed=s).data.astype(np.float64) for s in (seed, other_seed))
    temporal = 0.5 * float(np.var(one - two, ddof=1))
    spatial = float(np.var(0.5 * (one + two), ddof=1)) - 0.5 * temporal
    return float(0.5 * (one.mean() + two.mean())), temporal, spatial


def _predict(model: SensorModel, levels: Floats) -> tuple[Floats, Floats, Floats]:
    """Mean, temporal variance and variance of the fixed pattern, without saturation."""
    light = levels.astype(np.float32) * model.electrons_per_unit
    collected = light + model.dark_electrons
    shot = collected if model.shot_noise == ShotNoise.POISSON else 0.0 * collected
    rounding = 0.0 if model.bits is None else 1.0 / 12.0
    variance = model.gain**2 * (shot + model.read_noise**2 + model.row_noise**2) + rounding
    pattern = model.gain**2 * ((model.prnu * light) ** 2 + model.dsnu**2 + model.column_dsnu**2)
    return model.black_level + model.gain * collected, variance, pattern
