"""Spectral sensitivities of sensors, and spectra of the scene's RGB colours."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.color import rgb_basis as basis_table
from plenoptic.core.display import picture_of
from plenoptic.core.values import (
    Floats,
    check_kind,
    frozen_array,
    numbers,
    positive,
    read_only,
    set_field,
    value,
    wavelength_in_nm,
)
from plenoptic.errors import InvalidValueError

_SMALLEST_INTEGRAL = 1e-9
"""Smallest valid integral of a response over the integral of its magnitude; smaller ones are rounding errors."""

_NEGLIGIBLE_RESPONSE = 1e-7
"""Fraction of the response that all omitted bins may have together, below the resolution of a float32 image."""


@value
class Sensitivity:
    """Spectral sensitivity of the channels of a sensor: a response curve, or one wavelength, for each channel.

    A response is the value of a channel for spectral radiance (energy, not photons, per nm): a quantum efficiency
    times the wavelength. Its unit is free: a camera scales every channel so that a spectrum of constant radiance 1
    gives 1, as `normalised` does. Gains of the channels belong to the sensor's electronics. Responses may be negative,
    as those of colour matching functions are.

    Without `response` each channel is a line: channel c is traced at wavelengths[c] and measures channel c of the
    scene's colours unchanged. A single line measures the spectra of `rgb_to_spectrum`.

    Parameters
    ----------
    wavelengths : (n,) array
        Vacuum wavelengths in nm, ascending. Lines (1 or 3) are in the order of the channels.
    response : (n, C) array, optional
        Response of the C channels (1, or 3: red, green, blue), linear between the wavelengths and 0 beyond them; (n,)
        is one channel. None: lines.

    Raises
    ------
    InvalidValueError
        If shapes do not fit, a number is not finite, wavelengths do not ascend, or the integral of a channel is
        not above 0.

    Examples
    --------
    A table as it comes from a file has the wavelengths in its first column:

    >>> import numpy as np, plenoptic as pl
    >>> table = np.array([[500, 0.0], [550, 1.0], [600, 0.0]])
    >>> green = pl.sensor.Sensitivity(table[:, 0], table[:, 1:])
    >>> green.at([525.0, 700.0])
    array([[0.5],
           [0. ]])
    >>> green.normalised.response.max(axis=0).tolist()
    [0.02]
    >>> pl.sensor.Sensitivity.lines((610.0, 550.0, 465.0)).wavelength_range
    (465.0, 610.0)
    """

    wavelengths: Floats
    response: Floats | None = None

    def __post_init__(self) -> None:
        set_field(self, "wavelengths", _as_wavelengths(self.wavelengths))
        n = len(self.wavelengths)
        if self.response is None:
            if n not in (1, 3):
                raise InvalidValueError(f"{n} wavelengths are given without a response; lines have 1 or 3 channels")
            return
        raw = np.asarray(self.response, dtype=object)
        table = frozen_array(raw[:, None] if raw.ndim == 1 else raw, name="response", shape=(n, "C"))
        if table.shape[1] not in (1, 3):
            raise InvalidValueError(f"response has {table.shape[1]} channels; it must have 1 or 3, one in each column")
        if n < 2 or not (np.diff(self.wavelengths) > 0).all():
            raise InvalidValueError("wavelengths of a response must be 2 or more and ascend; sort them, each once")
        if not np.isfinite(table).all():
            raise InvalidValueError("response holds a number that is not finite; give 0 where a channel sees nothing")
        set_field(self, "response", table)
        integral, magnitude = _integral(self.wavelengths, table), _integral(self.wavelengths, np.abs(table))
        for channel in np.flatnonzero(~(integral > _SMALLEST_INTEGRAL * magnitude)):
            raise InvalidValueError(
                f"the response of channel {channel} has the integral {integral[channel]:g}; it must be above 0, so "
                "that the channel can be scaled to see a constant spectrum as 1"
            )

    @staticmethod
    def lines(wavelengths: ArrayLike) -> Sensitivity:
        """One wavelength for each channel: (1,) or (3,), in nm in vacuum, of red, green and blue in this order."""
        return Sensitivity(np.asarray(wavelengths))

    @property
    def channels(self) -> int:
        """Number of channels, 1 or 3."""
        return len(self.wavelengths) if self.response is None else self.response.shape[1]

    @property
    def wavelength_range(self) -> tuple[float, float]:
        """Shortest and longest wavelength in nm of non-zero response."""
        if self.response is None:
            return float(self.wavelengths.min()), float(self.wavelengths.max())
        nonzero = np.flatnonzero(self.response.any(axis=1))
        last = len(self.wavelengths) - 1
        return float(self.wavelengths[max(nonzero[0] - 1, 0)]), float(self.wavelengths[min(nonzero[-1] + 1, last)])

    @property
    def normalised(self) -> Sensitivity:
        """Sensitivity with channels of integral 1 over the wavelength, in 1/nm; lines stay unchanged."""
        return self if self.response is None else Sensitivity(self.wavelengths, self.response / self.integral)

    @property
    def integral(self) -> Floats:
        """Integral (C,) of each channel's response over the wavelength, nm; InvalidValueError for lines."""
        if self.response is None:
            raise InvalidValueError("the channels are lines, whose response has no integral")
        return _integral(self.wavelengths, self.response)

    def at(self, wavelengths: ArrayLike) -> Floats:
        """Response (m, C) at wavelengths (m,) in nm; InvalidValueError for lines, whose response is infinite."""
        if self.response is None:
            raise InvalidValueError("the channels are lines, which have no response to tabulate; see `wavelengths`")
        return _interpolate(_as_wavelengths(wavelengths), self.wavelengths, self.response, outside=0.0)

    _repr_html_ = picture_of


def rgb_basis(wavelengths: ArrayLike) -> Floats:
    """Spectra of the colours red, green and blue, which add up to 1 at every wavelength.

    The three are the solution of a convex problem: the sum of their squared slopes is least among all that are
    nowhere negative, add up to 1, and measure as (1, 0, 0), (0, 1, 0) and (0, 0, 1) in linear sRGB adapted to
    equal-energy white, `sensitivities.linear_srgb`. So mixtures of colours from 0 to 1 are spectra from 0 to 1, and
    white is constant. They are tabulated from 380 to 730 nm in steps of 5 nm, linear between and constant beyond.

    Parameters
    ----------
    wavelengths : (n,) array_like
        nm.

    Returns
    -------
    (n, 3) array

    Notes
    -----
    Spectral primary decomposition: I. Mallett, C. Yuksel, Eurographics Symposium on Rendering (2019), DOI
    10.2312/sr.20191216. Their white is daylight, D65. Here the colour of a lamp is relative to equal-energy white, of
    constant spectrum.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.sensor.rgb_basis([450.0, 540.0, 620.0]).round(2)
    array([[0.03, 0.  , 0.97],
           [0.  , 1.  , 0.  ],
           [0.96, 0.04, 0.  ]])
    """
    return _interpolate(_as_wavelengths(wavelengths), basis_table.WAVELENGTHS, basis_table.PARTS, outside=None) * 1e-6


def rgb_to_spectrum(rgb: ArrayLike, wavelengths: ArrayLike) -> Floats:
    """Smooth spectra of RGB colours, rgb . `rgb_basis`; at most 1 if no channel exceeds 1.

    Parameters
    ----------
    rgb : (..., 3) array_like
        Linear sRGB, of reflectances (0 to 1) or of radiances.
    wavelengths : (n,) array_like
        nm.

    Returns
    -------
    (..., n) array
        Reflectance, or radiance per nm relative to the constant spectrum of white of radiance 1.

    Raises
    ------
    InvalidValueError
        If `rgb` has no last axis of 3 finite numbers, or a wavelength is invalid.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.sensor.rgb_to_spectrum((0.5, 0.5, 0.5), [450.0, 550.0])
    array([0.5, 0.5])
    """
    colours = numbers(rgb, "rgb")
    if colours.ndim == 0 or colours.shape[-1] != 3:
        raise InvalidValueError(f"rgb has shape {colours.shape}; its last axis must be 3: red, green and blue")
    if not np.isfinite(colours).all():
        raise InvalidValueError("rgb holds a number that is not finite; give linear values of red, green and blue")
    return np.asarray(colours @ rgb_basis(wavelengths).T)


class ColourTables(NamedTuple):
    """A sensitivity as a distribution of wavelengths to sample, and the weight of each sample; all read-only.

    With wavelength w sampled from `cdf`, channel c measures weights[w, c] (basis[w] . rgb) of a colour rgb of the
    scene; the expectation over w is the measured value.
    """

    wavelengths: Floats
    """(W,) vacuum wavelengths in nm."""
    cdf: Floats
    """(W,) cumulative probability; ascends to exactly 1."""
    weights: Floats
    """(W, C) integral of a channel's response over a bin, divided by the bin's probability."""
    basis: Floats
    """(W, 3) spectral value at each wavelength of the scene's red, green and blue."""


def colour_tables(sensitivity: Sensitivity, *, step: float = 1.0) -> ColourTables:
    """Wavelengths to sample in proportion to the total response of all channels.

    The range is cut into bins of equal width, `step` nm at most; the error of a smooth spectrum falls with its square.
    A bin's wavelength is its middle, its weight in channel c the integral of the normalised response over it, s[w, c],
    and its probability p[w] = sum_c |s[w, c]| / S with S the sum over all bins. The weights s / p are at most S in
    magnitude (C if no response is negative), and exactly 1 for a single channel without negative response. The s[w, c]
    of each channel add up to 1: a constant spectrum of radiance 1 has the mean 1. Bins of negligible response are
    omitted. Lines are equally probable.
    """
    check_kind(sensitivity, "sensitivity", Sensitivity, "sensitivities.colour_camera()")
    if sensitivity.response is None:
        wavelengths, integrals = sensitivity.wavelengths, np.eye(sensitivity.channels)
        basis = integrals if sensitivity.channels == 3 else rgb_basis(wavelengths)
    else:
        wavelengths, integrals = _bin_integrals(sensitivity, positive(step, "step", "nm"))
        basis = rgb_basis(wavelengths)
    magnitudes = np.abs(integrals).sum(axis=1)
    cdf = np.cumsum(magnitudes)
    cdf /= cdf[-1]
    # Differences of the rounded cdf are the true probabilities, so that rounding does not bias the mean.
    weights = integrals / np.diff(cdf, prepend=0.0)[:, None]
    return ColourTables(*(read_only(np.ascontiguousarray(part)) for part in (wavelengths, cdf, weights, basis)))


def _bin_integrals(sensitivity: Sensitivity, step: float) -> tuple[Floats, Floats]:
    """Middles of bins, and the exact integrals of the piecewise linear response over them."""
    low, high = sensitivity.wavelength_range
    count = max(1, math.ceil((high - low) / step - 1e-9))
    edges = np.linspace(low, high, count + 1)
    inside = (sensitivity.wavelengths > low) & (sensitivity.wavelengths < high)
    points = np.union1d(edges, sensitivity.wavelengths[inside])
    heights = sensitivity.at(points)
    pieces = (heights[1:] + heights[:-1]) * (0.5 * np.diff(points))[:, None]
    integrals = np.zeros((count, sensitivity.channels))
    np.add.at(integrals, np.searchsorted(edges, points[:-1], side="right") - 1, pieces)
    integrals /= integrals.sum(axis=0)
    magnitude = np.abs(integrals).sum(axis=1)
    significant = magnitude > _NEGLIGIBLE_RESPONSE / count * magnitude.sum()
    middles = 0.5 * (edges[1:] + edges[:-1])
    return middles[significant], integrals[significant] / integrals[significant].sum(axis=0)


def _as_wavelengths(wavelengths: ArrayLike) -> Floats:
    array = frozen_array(wavelengths, name="wavelengths", shape=("n",))
    for wavelength in array.tolist():
        wavelength_in_nm(wavelength)
    return array


def _interpolate(x: Floats, nodes: Floats, table: Floats, *, outside: float | None) -> Floats:
    columns = [np.interp(x, nodes, column, left=outside, right=outside) for column in table.T]
    return np.stack(columns, axis=-1)


def _integral(x: Floats, table: Floats) -> Floats:
    """Integrals over x of the columns of a table that is linear between its rows."""
    return np.asarray(0.5 * np.diff(x) @ (table[1:] + table[:-1]))
