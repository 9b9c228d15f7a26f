"""Bundled sensitivities: colour matching functions, and models of sensors."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.color.spectra import Sensitivity
from plenoptic.core.values import Floats, frozen_array, length_in_mm, positive, wavelength_in_nm
from plenoptic.errors import InvalidValueError

__all__ = ["cie_1931", "colour_camera", "linear_srgb", "silicon"]

_EDGE = 20.0
"""Width in nm of the edges of a band-pass filter, over which its transmission falls from 1 to 0."""

# Height, peak in nm, and inverse widths in 1/nm on its short and its long side, of each lobe of x, y and z.
_LOBES = (
    ((1.056, 599.8, 0.0264, 0.0323), (0.362, 442.0, 0.0624, 0.0374), (-0.065, 501.1, 0.0490, 0.0382)),
    ((0.821, 568.8, 0.0213, 0.0247), (0.286, 530.9, 0.0613, 0.0322)),
    ((1.217, 437.0, 0.0845, 0.0278), (0.681, 459.0, 0.0385, 0.0725)),
)

# Chromaticities x, y of the primaries of sRGB and of its white, D65 (IEC 61966-2-1).
_PRIMARIES = ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06))
_D65 = (0.3127, 0.3290)

# From tristimulus values to the cone responses in which the Bradford adaptation scales, as ICC profiles use it.
_BRADFORD = ((0.8951, 0.2664, -0.1614), (-0.7502, 1.7135, 0.0367), (0.0389, -0.0685, 1.0296))

# Extinction coefficient of silicon at 295 K, at 360, 380, ... 1100 nm.
_EXTINCTION = (
    *(2.9135, 0.98399, 0.32627, 0.17694, 0.11201, 0.079105, 0.059817, 0.048542, 0.039531, 0.029896),
    *(0.026551, 0.021896, 0.018521, 0.016809, 0.014693, 0.013608, 0.012045, 0.010623, 9.3335e-3, 8.1618e-3),
    *(7.0942e-3, 6.1338e-3, 5.2655e-3, 4.4836e-3, 3.7828e-3, 3.1563e-3, 2.6001e-3, 2.1092e-3, 1.6787e-3, 1.3061e-3),
    *(9.8243e-4, 7.1334e-4, 4.9020e-4, 3.1437e-4, 1.7959e-4, 9.2450e-5, 5.2168e-5, 3.0217e-5),
)


def cie_1931() -> Sensitivity:
    """The colour matching functions x, y and z of the CIE 1931 observer, by a fit.

    Returns
    -------
    Sensitivity
        380 to 780 nm, every nm. Used by a camera, its channels are X, Y and Z, 1 for equal-energy white.

    Notes
    -----
    Sums of Gaussians with different widths on either side of their peaks: C. Wyman, P.-P. Sloan, P. Shirley, "Simple
    Analytic Approximations to the CIE XYZ Color Matching Functions", Journal of Computer Graphics Techniques 2(2)
    (2013), the fits with several lobes. At the multiples of 50 nm they differ from the tables of the CIE by less than
    0.01.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.sensitivities.cie_1931().at([555.0]).round(2).tolist()
    [[0.52, 1.0, 0.01]]
    """
    wavelengths = np.arange(380.0, 781.0)
    table = np.zeros((len(wavelengths), 3))
    for channel, lobes in enumerate(_LOBES):
        for height, peak, short, long in lobes:
            deviation = (wavelengths - peak) * np.where(wavelengths < peak, short, long)
            table[:, channel] += height * np.exp(-0.5 * deviation**2)
    return Sensitivity(wavelengths, table)


def linear_srgb() -> Sensitivity:
    """Linear sRGB, adapted from D65 to equal-energy white: a sensor that measures the scene's colours unchanged.

    A surface or lamp of colour rgb is measured as rgb, since `rgb_basis` is made for these sensitivities. Responses
    are partly negative, those of the red channel most. A renderer therefore needs more samples than for a camera's.

    Returns
    -------
    Sensitivity
        380 to 780 nm, every nm, normalised.

    Notes
    -----
    Rows of the inverse of B P D applied to `cie_1931`, normalised: the columns of P D are the primaries of sRGB (IEC
    61966-2-1), scaled by D so that they add up to D65, and B is the Bradford adaptation from D65 to equal energy.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.sensitivities.linear_srgb().at([500.0, 600.0]).round(4)
    array([[-0.0063,  0.0061,  0.0023],
           [ 0.0213,  0.0017, -0.0006]])
    """
    observer = cie_1931().normalised
    assert observer.response is not None
    primaries, white = np.transpose([_tristimulus(xy) for xy in _PRIMARIES]), _tristimulus(_D65)
    scaled = primaries * np.linalg.solve(primaries, white)
    cones = np.array(_BRADFORD)
    adaptation = np.linalg.solve(cones, (cones @ np.ones(3) / (cones @ white))[:, None] * cones)
    to_rgb = np.linalg.inv(adaptation @ scaled)
    return Sensitivity(observer.wavelengths, observer.response @ to_rgb.T).normalised


def colour_camera(
    *,
    peaks: tuple[float, float, float] = (600.0, 530.0, 460.0),
    widths: tuple[float, float, float] = (75.0, 90.0, 75.0),
    band: tuple[float, float] = (400.0, 700.0),
) -> Sensitivity:
    """Model of a typical colour camera: three Gaussians of the wavelength behind a band-pass filter.

    Parameters
    ----------
    peaks : (float, float, float)
        Wavelengths in nm of the maxima of red, green and blue.
    widths : (float, float, float)
        Full widths at half maximum in nm.
    band : (float, float)
        Wavelengths in nm at which the filter transmits one half; each of its edges is 20 nm wide.

    Returns
    -------
    Sensitivity
        Every 5 nm at most; peaks of 1 where the filter transmits all.

    Raises
    ------
    InvalidValueError
        If a number is out of range.

    Notes
    -----
    A generic model, not a particular camera. Peaks and widths are typical of the 28 cameras that were measured by
    J. Jiang et al., "What is the space of spectral sensitivity functions for digital color cameras?", WACV 2013, DOI
    10.1109/WACV.2013.6475015. Real curves are less regular, and overlap by leaks of their filters.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.sensitivities.colour_camera().wavelength_range
    (390.0, 710.0)
    """
    wavelengths, transmission = _band_pass(band)
    middle = frozen_array(peaks, name="peaks", shape=(3,))
    width = frozen_array(widths, name="widths", shape=(3,))
    for channel in range(3):
        wavelength_in_nm(middle[channel], "a peak")
        positive(width[channel], "a width", "nm")
    deviation = (wavelengths[:, None] - middle) / width
    return Sensitivity(wavelengths, transmission[:, None] * np.exp(-4.0 * math.log(2.0) * deviation**2))


def silicon(*, depth: float = 0.005, band: tuple[float, float] = (400.0, 700.0)) -> Sensitivity:
    """Model of a monochrome sensor: absorption of a silicon layer behind a band-pass filter.

    Parameters
    ----------
    depth : float
        Thickness in mm of the layer whose electrons are collected.
    band : (float, float)
        As in `colour_camera`, from 370 to 1090 nm: (400, 1000) is a sensor without a filter against infrared.

    Returns
    -------
    Sensitivity
        Every 5 nm at most, 1 at its maximum.

    Notes
    -----
    The quantum efficiency is 1 - exp(-alpha depth) with alpha = 4 pi k / wavelength, and the response to energy is
    that times the wavelength. Reflection and losses at the surface, which affect blue most, are neglected. The
    extinction coefficient k is that of C. Schinke et al., AIP Advances 5, 067168 (2015), DOI 10.1063/1.4923379, as
    tabulated in the refractiveindex.info database (public domain, CC0), its logarithm linear between steps of 20 nm.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.sensitivities.silicon(band=(400.0, 1000.0)).wavelength_range
    (390.0, 1010.0)
    """
    depth = length_in_mm(depth, "depth")
    wavelengths, transmission = _band_pass(band)
    tabulated = 360.0 + 20.0 * np.arange(len(_EXTINCTION))
    if wavelengths[0] < tabulated[0] or wavelengths[-1] > tabulated[-1]:
        raise InvalidValueError(
            f"band is {band[0]:g} to {band[1]:g} nm; it must lie within {tabulated[0] + 0.5 * _EDGE:g} to "
            f"{tabulated[-1] - 0.5 * _EDGE:g} nm, where the absorption of silicon is tabulated"
        )
    extinction = np.exp(np.interp(wavelengths, tabulated, np.log(_EXTINCTION)))
    absorptance = -np.expm1(-4.0 * np.pi * extinction / (wavelengths * 1e-6) * depth)
    response = transmission * absorptance * wavelengths
    return Sensitivity(wavelengths, response / response.max())


def _tristimulus(xy: tuple[float, float]) -> Floats:
    """Tristimulus values X, Y and Z of a chromaticity, for Y = 1."""
    x, y = xy
    return np.array([x / y, 1.0, (1.0 - x - y) / y])


def _band_pass(band: tuple[float, float]) -> tuple[Floats, Floats]:
    """Wavelengths around a band, 5 nm apart at most, and the transmission of a band-pass filter."""
    low, high = (
        wavelength_in_nm(limit, "a limit of the band") for limit in frozen_array(band, name="band", shape=(2,))
    )
    if high - low < _EDGE:
        raise InvalidValueError(f"band is {low:g} to {high:g} nm; it must ascend and be at least {_EDGE:g} nm wide")
    steps = math.ceil((high - low + _EDGE) / 5.0)
    wavelengths = np.linspace(low - 0.5 * _EDGE, high + 0.5 * _EDGE, steps + 1)
    transmission = np.minimum(wavelengths - low, high - wavelengths) / _EDGE + 0.5
    return wavelengths, np.clip(transmission, 0.0, 1.0)
