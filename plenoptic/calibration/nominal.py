"""Nominal data of a camera, as printed on it."""

from __future__ import annotations

from plenoptic.core.values import checked_field, length_in_mm, positive, value


@value
class NominalCamera:
    """Nominal data of a camera, from which a calibration starts.

    Parameters
    ----------
    focal_length : float
        Of the main lens in mm; the calibrated one is within 8 %.
    f_number : float
        Of the main lens: that of the twin, if no radius of the micro images tells another.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.calibration.NominalCamera(focal_length=50.0, f_number=4.0)
    NominalCamera(focal_length=50.0, f_number=4.0)
    """

    focal_length: float = checked_field(length_in_mm)
    f_number: float = checked_field(positive)
