"""Conversion of light to digital numbers by a sensor."""

from __future__ import annotations

import enum
import math
from dataclasses import KW_ONLY
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.values import (
    Floats,
    Given,
    checked_field,
    choice,
    frozen_array,
    not_negative,
    number,
    plain_array,
    positive,
    seed_number,
    set_field,
    value,
    whole,
)
from plenoptic.errors import InvalidValueError
from plenoptic.optics.sensor.color_filter import BayerPattern, Filters, as_filters, pattern_of

FEWEST_BITS, MOST_BITS = 8, 16


class ShotNoise(enum.IntEnum):
    """Statistics of the electrons of a pixel. See `SensorModel`."""

    NONE = 0
    """A pixel collects exactly its mean, which need not be whole."""
    POISSON = 1
    """A pixel collects a Poisson number of electrons, from light and dark current together."""


@value
class SensorModel:
    """Model of a sensor that converts light to digital numbers (DN); each effect is optional.

    For a pixel of value I in the image, in this order:

        mean      = rate QE t I (1 + prnu n) + dark_current t        n: standard normal, one for each pixel
        electrons = min(Poisson(mean), full_well)
        signal    = electrons + offsets (dsnu, column_dsnu) + noise (read_noise, row_noise)
        DN        = round(black_level + gain signal), cut to 0 ... 2^bits - 1

    With the defaults there is shot noise, quantisation to 12 bits and nothing else.

    Parameters
    ----------
    photon_rate : float or 3 floats
        Photons on a pixel per second for an image value of 1, one number for all channels or one for each of red,
        green and blue. `photon_rate` computes it from radiance, pixel pitch and wavelength.
    exposure_time : float
        Exposure time t in s.
    quantum_efficiency : float or 3 floats
        Quantum efficiency QE: electrons per photon, above 0 and at most 1; filters included.
    gain : float
        DN per electron, the overall system gain K of EMVA 1288.
    black_level : float
        DN without light, dark current and noise.
    bits : int or None
        Bits of the converter, 8 to 16. None: no quantisation; DN are float64, and neither rounded nor clipped.
    full_well : float, optional
        Most electrons that a pixel holds; None: no limit.
    colour_filters : BayerPattern or (p, q) array_like of int, optional
        Filter on each pixel: a Bayer pattern, or one period of any pattern as channels (0 red, 1 green, 2 blue), whose
        first entry is on the pixel at row 0, column 0 of the sensor. None: all channels of the exposure are
        measured at every pixel, which is a monochrome sensor for an exposure of one channel and a sensor of three
        layers for one of three.
    shot_noise : ShotNoise
    read_noise : float
        Standard deviation, electrons; normal, independent for each pixel and exposure.
    row_noise : float
        Standard deviation of an offset common to a row, electrons; independent for each exposure.
    dark_current : float
        Electrons per second at the sensor's temperature; `dark_current_at` converts temperatures.
    prnu : float
        Photo response non-uniformity: relative standard deviation of the sensitivity of pixels; 0.01 is 1 %.
    dsnu : float
        Dark signal non-uniformity: standard deviation of the offsets of pixels, electrons.
    column_dsnu : float
        Standard deviation of an offset common to a column, electrons.
    dead : float or (n, 2) array_like of int
        Pixels that collect nothing: their fraction, or the row and column of each on the sensor.
    hot : float or (n, 2) array_like of int
        Pixels with an additional dark current of `hot_current`, in the same form.
    hot_current : float
        Electrons per second; infinite by default: hot pixels are saturated.
    pattern_seed : int
        Seed of the fixed pattern of this sensor, which is the same in all exposures: prnu, dsnu, column_dsnu, dead and
        hot.

    Raises
    ------
    InvalidValueError
        If a number is out of range, or hot pixels have no level at which they saturate.

    Notes
    -----
    Read noise below about half a DN (gain times read_noise) leaves quantisation errors that depend on the
    signal; only above it do they act as noise of variance 1/12 DN^2.

    References
    ----------
    EMVA Standard 1288, release 3.1 (2016), sections 2.1, 2.2, 3 and 4. J. R. Janesick, Photon Transfer, SPIE
    Press (2007), doi:10.1117/3.725073.

    Examples
    --------
    >>> import plenoptic as pl
    >>> sensor = pl.SensorModel(
    ...     photon_rate=2.0e6, exposure_time=0.01, quantum_efficiency=(0.4, 0.55, 0.45), gain=0.25, black_level=64,
    ...     bits=12, full_well=15000, colour_filters=pl.BayerPattern.RGGB, read_noise=3.0, prnu=0.008,
    ...     shot_noise=pl.ShotNoise.POISSON,
    ... )
    >>> sensor.electrons_per_unit
    array([ 8000., 11000.,  9000.])
    >>> sensor.white_level
    3814.0
    """

    photon_rate: Given[float | tuple[float, float, float], float | ArrayLike]
    _: KW_ONLY
    exposure_time: float = checked_field(positive, default=1.0, unit="s")
    quantum_efficiency: Given[float | tuple[float, float, float], float | ArrayLike] = Given(default=1.0)
    gain: float = checked_field(positive, default=1.0, unit="DN per electron")
    black_level: float = checked_field(not_negative, default=0.0, unit="DN")
    bits: int | None = 12
    full_well: float | None = checked_field(positive, default=None, unit="electrons")
    colour_filters: Given[Filters | None, BayerPattern | ArrayLike | None] = Given(default=None)
    shot_noise: ShotNoise = checked_field(choice, default=ShotNoise.POISSON, kind=ShotNoise)
    read_noise: float = checked_field(not_negative, default=0.0, unit="electrons")
    row_noise: float = checked_field(not_negative, default=0.0, unit="electrons")
    dark_current: float = checked_field(not_negative, default=0.0, unit="electrons/s")
    prnu: float = checked_field(not_negative, default=0.0)
    dsnu: float = checked_field(not_negative, default=0.0, unit="electrons")
    column_dsnu: float = checked_field(not_negative, default=0.0, unit="electrons")
    dead: Given[float | NDArray[np.int64], float | ArrayLike] = Given(default=0.0)
    hot: Given[float | NDArray[np.int64], float | ArrayLike] = Given(default=0.0)
    hot_current: float = math.inf
    pattern_seed: int = checked_field(seed_number, default=0)

    def __post_init__(self) -> None:
        set_field(self, "photon_rate", _per_channel(self.photon_rate, "photon_rate"))
        set_field(self, "quantum_efficiency", _per_channel(self.quantum_efficiency, "quantum_efficiency", at_most=1.0))
        if not np.isfinite(self.electrons_per_unit).all():
            raise InvalidValueError(
                f"photon_rate {self.photon_rate} in {self.exposure_time:g} s overflows; reduce one of them"
            )
        if self.bits is not None:
            self._check_converter(self.bits)
        if self.colour_filters is not None:
            set_field(self, "colour_filters", as_filters(self.colour_filters, "colour_filters"))
        set_field(self, "dead", _pixels(self.dead, "dead"))
        set_field(self, "hot", _pixels(self.hot, "hot"))
        self._check_hot()

    def _check_converter(self, bits: int) -> None:
        whole(bits, "bits", at_least=FEWEST_BITS)
        if bits > MOST_BITS:
            raise InvalidValueError(f"bits is {bits}; it must be at most {MOST_BITS}")
        set_field(self, "bits", int(bits))
        if self.black_level >= 2**bits - 1:
            raise InvalidValueError(
                f"black_level is {self.black_level:g} DN; it must be below {2**bits - 1}, the largest of {bits} bits"
            )

    def _check_hot(self) -> None:
        current = number(self.hot_current, "hot_current")
        if not current >= 0:
            raise InvalidValueError(f"hot_current is {current:g} electrons/s; it must be at least 0")
        set_field(self, "hot_current", current)
        if math.isinf(current) and any_pixels(self.hot) and self.white_level == math.inf:
            raise InvalidValueError(
                "hot_current is inf, but neither full_well nor bits limits what hot pixels give; give one of the three"
            )

    @property
    def electrons_per_unit(self) -> Floats:
        """Mean electrons from light for an image value of 1: (1,), or (3,) if channels differ."""
        rates = np.atleast_1d(np.asarray(self.photon_rate)) * np.atleast_1d(np.asarray(self.quantum_efficiency))
        with np.errstate(over="ignore"):
            mean: Floats = rates * self.exposure_time
        return mean

    @property
    def dark_electrons(self) -> float:
        """Mean electrons of dark current in one exposure."""
        return self.dark_current * self.exposure_time

    @property
    def white_level(self) -> float:
        """DN of a saturated pixel: of the full well or the largest of the converter; inf without either."""
        well = math.inf if self.full_well is None else self.black_level + self.gain * self.full_well
        return well if self.bits is None else min(float(np.rint(min(well, 2.0**20))), 2.0**self.bits - 1)

    @property
    def is_coloured(self) -> bool:
        """True if channels differ, by filters, rates or quantum efficiencies."""
        return self.colour_filters is not None or self.electrons_per_unit.size > 1

    @property
    def pattern(self) -> NDArray[np.int64] | None:
        """One period of the colour filters as (p, q) channels; None without filters."""
        return None if self.colour_filters is None else pattern_of(self.colour_filters)


def any_pixels(pixels: float | NDArray[np.int64]) -> bool:
    """True if a fraction of pixels is above 0, or a list of pixels is not empty."""
    return len(pixels) > 0 if isinstance(pixels, np.ndarray) else pixels > 0


def _per_channel(values: Any, name: str, at_most: float = math.inf) -> float | tuple[float, ...]:
    """One number for all channels, or a tuple of three."""
    several = isinstance(values, tuple | list) or (isinstance(values, np.ndarray) and values.ndim > 0)
    numbers = tuple(positive(item, name) for item in (values if several else (values,)))
    if several and len(numbers) != 3:
        raise InvalidValueError(f"{name} has {len(numbers)} numbers; give one, or one for each of red, green and blue")
    if max(numbers) > at_most:
        raise InvalidValueError(f"{name} is {max(numbers):g}; it must be at most {at_most:g}")
    return numbers if several else numbers[0]


def _pixels(pixels: Any, name: str) -> float | NDArray[np.int64]:
    """A fraction of all pixels, or a list of (row, column)."""
    if not isinstance(pixels, tuple | list) and np.ndim(pixels) == 0:
        fraction = not_negative(pixels, name)
        if fraction > 1:
            raise InvalidValueError(f"{name} is {fraction:g}; a fraction of the pixels must be at most 1")
        return fraction
    raw = plain_array(pixels, name)
    if raw.size and (raw.dtype.kind not in "iu" or raw.min() < 0):
        raise InvalidValueError(f"{name} must be a fraction, or rows and columns that are whole numbers from 0 on")
    return frozen_array(raw.reshape(0, 2) if raw.size == 0 else raw, name=name, shape=("n", 2), dtype=np.int64)
