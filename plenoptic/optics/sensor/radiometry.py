"""Photon rate from radiance, and dark current at another temperature than that of the data sheet."""

from __future__ import annotations

from plenoptic.core.values import finite, length_in_mm, not_negative, positive, wavelength_in_nm
from plenoptic.errors import InvalidValueError

PLANCK = 6.62607015e-34
"""J s; exact (SI, 2019)."""
LIGHT_SPEED = 299792458.0
"""m/s; exact (SI)."""


def photon_rate(*, radiance: float, pixel_pitch: float, wavelength: float) -> float:
    """Photons on a pixel per second for an image value of 1, for `SensorModel`.

    An image is radiance in scene units times steradian, so a value of 1 is the irradiance E = `radiance` sr, and

        rate = E p^2 lambda / (h c).

    Parameters
    ----------
    radiance : float
        Radiance of 1 scene unit, W/(m^2 sr), all of it at `wavelength`.
    pixel_pitch : float
        Side p of a pixel in mm, as in `Sensor`; an image is already averaged over the pixel's area, so a fill factor
        below 1 belongs into the quantum efficiency unless the exposure has it.
    wavelength : float
        Wavelength in vacuum, nm. For colours, take one rate for each channel.

    Raises
    ------
    InvalidValueError
        If an argument is not above 0, or the wavelength is invalid.

    References
    ----------
    EMVA Standard 1288, release 3.1 (2016), section 2.1: linear signal model.

    Examples
    --------
    >>> import plenoptic as pl
    >>> round(pl.sensor.photon_rate(radiance=1.0, pixel_pitch=0.010, wavelength=550.0))
    276876411
    """
    watts = positive(radiance, "radiance", "W/(m^2 sr)") * (1e-3 * length_in_mm(pixel_pitch, "pixel_pitch")) ** 2
    return watts * (1e-9 * wavelength_in_nm(wavelength)) / (PLANCK * LIGHT_SPEED)


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
