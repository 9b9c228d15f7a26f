"""Photon rate from radiance or luminance, and dark current at another temperature than that of the data sheet."""

from __future__ import annotations

import numpy as np

from plenoptic.core.color.sensitivities import cie_1931
from plenoptic.core.color.spectra import Sensitivity
from plenoptic.core.values import Floats, check_kind, finite, length_in_mm, not_negative, positive, wavelength_in_nm
from plenoptic.errors import InvalidValueError

PLANCK = 6.62607015e-34
"""J s; exact (SI, 2019)."""
LIGHT_SPEED = 299792458.0
"""m/s; exact (SI)."""
EFFICACY = 683.0
"""lm/W, of light of 540 THz, 555 nm; exact (SI, 2019)."""


def photon_rate(
    *,
    pixel_pitch: float,
    wavelength: float | None = None,
    sensitivity: Sensitivity | None = None,
    radiance: float | None = None,
    spectral_radiance: float | None = None,
    luminance: float | None = None,
) -> float | tuple[float, ...]:
    """Photons on a pixel per second for an image value of 1, for `SensorModel`.

    An image is radiance in scene units times steradian, so a value of 1 is the irradiance E = L sr, and

        rate = E p^2 lambda / (h c).

    With a `sensitivity`, light has the constant spectrum that a camera sees as 1 in each channel, and its photons are
    weighed by the quantum efficiency over its largest value among all channels, which `SensorModel.quantum_efficiency`
    is then. Losses in the lens and beside the pixel's aperture are in the image.

    Parameters
    ----------
    pixel_pitch : float
        Side p of a pixel in mm, as in `Sensor`; an image is already averaged over the pixel's area, so a fill factor
        below 1 belongs into the quantum efficiency unless the exposure has it.
    wavelength : float, optional
        Wavelength in vacuum, nm, of light of a single one; or give a `sensitivity`.
    sensitivity : Sensitivity, optional
        Responses of the channels over the wavelength, as of a `PlenopticCamera`.
    radiance : float, optional
        Radiance L of 1 scene unit, W/(m^2 sr), all of it at `wavelength`.
    spectral_radiance : float, optional
        Radiance of 1 scene unit, W/(m^2 sr nm), the same at all wavelengths of `sensitivity`.
    luminance : float, optional
        Luminance of 1 scene unit, cd/m^2, in place of a radiance: that of white paper is its illuminance in lux over
        pi.

    Returns
    -------
    float or tuple of float
        1/s; of each channel of a sensitivity that has three.

    Raises
    ------
    InvalidValueError
        If an argument is not above 0, the wavelength invalid or invisible, a response negative or a line, or if not
        one of `wavelength` and `sensitivity`, and one measure of light that goes with it, is given.

    References
    ----------
    EMVA Standard 1288, release 3.1 (2016), section 2.1: linear signal model. Luminous efficacy: 683 lm/W (SI, 2019)
    times V, by the fit of `sensitivities.cie_1931` within 0.01. A single wavelength at the ends of V is farther
    off: 14 % at 450 nm, 3 % at 650 nm, 5 % at 700 nm, a factor of 3 at 750 nm; give its radiance.

    Examples
    --------
    >>> import plenoptic as pl
    >>> round(pl.sensor.photon_rate(radiance=1.0, pixel_pitch=0.010, wavelength=550.0))
    276876411

    White paper in 500 lux, seen in colours; its image is pi sin^2 of the half angle of the cone on the sensor:

    >>> sensitivity = pl.sensitivities.colour_camera()
    >>> rates = pl.sensor.photon_rate(luminance=500 / 3.1416, pixel_pitch=0.004, sensitivity=sensitivity)
    >>> [round(1e-6 * rate, 1) for rate in rates]
    [6.4, 7.7, 6.2]
    """
    if (wavelength is None) == (sensitivity is None):
        raise InvalidValueError("give either the wavelength of light that has a single one, or a sensitivity")
    name, unit = ("radiance", "W/(m^2 sr)") if sensitivity is None else ("spectral_radiance", "W/(m^2 sr nm)")
    power, other = (radiance, spectral_radiance) if sensitivity is None else (spectral_radiance, radiance)
    if other is not None or (power is None) == (luminance is None):
        with_ = "wavelength" if sensitivity is None else "sensitivity"
        raise InvalidValueError(f"with a {with_}, light is either {name}, in {unit}, or luminance, in cd/m^2")
    visible = cie_1931()
    if sensitivity is None:
        nanometres = np.array([wavelength_in_nm(wavelength)])  # type: ignore[arg-type]
        efficiency = float(visible.at(nanometres)[0, 1])
    else:
        nanometres, efficiency = _photon_weights(sensitivity), float(visible.integral[1])
    if power is None:
        if not efficiency > 0:
            raise InvalidValueError(f"light of {nanometres[0]:g} nm is invisible; give its radiance, in {unit}")
        power = positive(luminance, "luminance", "cd/m^2") / (EFFICACY * efficiency)  # type: ignore[arg-type]
    watts = positive(power, name, unit) * (1e-3 * length_in_mm(pixel_pitch, "pixel_pitch")) ** 2
    rates = (watts / (PLANCK * LIGHT_SPEED) * 1e-9 * nanometres).tolist()
    return rates[0] if len(rates) == 1 else tuple(rates)


def _photon_weights(sensitivity: Sensitivity) -> Floats:
    """Integral of each channel's quantum efficiency, over its largest, times the wavelength, nm^2."""
    check_kind(sensitivity, "sensitivity", Sensitivity, "pl.sensitivities.colour_camera()")
    if sensitivity.response is None or (sensitivity.response < 0).any():
        kind = "lines" if sensitivity.response is None else "negative responses"
        raise InvalidValueError(f"the sensitivity has {kind}; photons need quantum efficiencies over the wavelength")
    return np.asarray(sensitivity.integral / (sensitivity.response / sensitivity.wavelengths[:, None]).max())


def dark_current_at(
    temperature: float, *, rate: float, reference_temperature: float, doubling_temperature: float
) -> float:
    """Dark current at a temperature, from that at another: rate 2^((T - T_ref) / T_d), in electrons per second.

    Parameters
    ----------
    temperature : float
        Temperature T of the sensor, degrees Celsius.
    rate : float
        Dark current at the reference temperature, electrons per second.
    reference_temperature : float
        T_ref, degrees Celsius.
    doubling_temperature : float
        T_d in kelvin, the step that doubles the dark current; about 6 to 8 K near room temperature for silicon.

    Raises
    ------
    InvalidValueError
        If the rate is negative, the step not above 0, or a number not finite.

    References
    ----------
    EMVA Standard 1288, release 3.1 (2016), section 3.2: temperature dependence of the dark current.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.sensor.dark_current_at(34.0, rate=10.0, reference_temperature=20.0, doubling_temperature=7.0)
    40.0
    """
    reference_rate = not_negative(rate, "rate", "electrons/s")
    steps = finite(temperature, "temperature") - finite(reference_temperature, "reference_temperature")
    doublings = steps / positive(doubling_temperature, "doubling_temperature", "K")
    if not doublings < 1000:
        raise InvalidValueError(
            f"the rate doubles {doublings:.3g} times: temperatures and doubling_temperature are in K"
        )
    return float(reference_rate * 2.0**doublings)
