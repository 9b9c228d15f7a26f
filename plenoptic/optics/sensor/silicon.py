"""Reflectance of silicon sensors."""

from __future__ import annotations

import numpy as np

from plenoptic.core.values import finite
from plenoptic.optics.glass.media import AIR, Medium, check_medium, wavelength_within

_SILICON = (
    (400, 5.613, 0.296),
    (420, 5.119, 0.176),
    (440, 4.812, 0.107),
    (460, 4.587, 0.0714),
    (480, 4.419, 0.0550),
    (500, 4.294, 0.0442),
    (550, 4.077, 0.0280),
    (600, 3.940, 0.0199),
    (700, 3.772, 0.0105),
    (800, 3.675, 0.0054),
    (900, 3.614, 0.0022),
    (1100, 3.542, 0.0),
)
"""Wavelength in nm, index and extinction coefficient of silicon at 300 K."""


def silicon_reflectance(wavelength: float, *, cover: Medium | None = None) -> float:
    """Reflectance of bare silicon at normal incidence, alone or below a cover glass on it.

    A sensor with a coating against reflections, or with microlenses on its pixels, reflects less: measure it, or take
    this as the upper limit. Both faces of the cover glass are bare, and its multiple reflections are added up.

    Parameters
    ----------
    wavelength : float
        400 to 1100 nm; the table of steps of 20 to 200 nm is interpolated linearly.
    cover : Medium, optional
        Glass without a gap to the silicon; None: silicon in air.

    Raises
    ------
    InvalidValueError
        If the wavelength is out of range; a PrescriptionError for a cover that is no medium.

    References
    ----------
    M. A. Green, Sol. Energy Mater. Sol. Cells 92, 1305 (2008), doi:10.1016/j.solmat.2008.06.009: index and extinction.

    Examples
    --------
    >>> import plenoptic as pl
    >>> round(pl.sensor.silicon_reflectance(550.0), 3)
    0.367
    >>> round(pl.sensor.silicon_reflectance(550.0, cover=pl.glass("N-BK7")), 3)
    0.236
    """
    table, index, extinction = np.transpose(_SILICON)
    nm = wavelength_within(finite(wavelength, "wavelength"), (float(table[0]), float(table[-1])), "silicon")
    silicon = complex(np.interp(nm, table, index), np.interp(nm, table, extinction))
    medium = AIR if cover is None else cover
    check_medium(medium, "cover")
    n = medium.index(nm)
    front, rear = ((n - 1.0) / (n + 1.0)) ** 2, abs((silicon - n) / (silicon + n)) ** 2
    return float(front + (1.0 - front) ** 2 * rear / (1.0 - front * rear))
