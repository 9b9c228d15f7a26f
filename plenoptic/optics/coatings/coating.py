"""Coatings of surfaces: films of given materials, or a measured reflectance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.values import (
    Floats,
    Given,
    check_has,
    finite,
    frozen_array,
    plain_array,
    set_field,
    value,
    wavelength_in_nm,
)
from plenoptic.errors import InvalidValueError, PrescriptionError
from plenoptic.optics.glass.absorption import rising_wavelengths, table_column
from plenoptic.optics.glass.media import ConstantMedium, Medium, check_medium, wavelength_within

_THICKEST = 1e5
"""Largest thickness of a film in nm: thicker layers are elements with two surfaces, whose light does not interfere."""


@value
class FilmMaterial:
    """Material of a film by its index n and its extinction coefficient k: one that absorbs, or a metal.

    Parameters
    ----------
    index : (n,) array or float
        Refractive index, above 0; metals have less than 1.
    extinction : (n,) array or float, optional
        Extinction coefficient k of the complex index n + i k, at least 0.
    wavelengths : (n,) array, optional
        Rising wavelengths of the table in nm, between which both are interpolated linearly. None: one number for all.

    Raises
    ------
    InvalidValueError
        If a number is out of range, or the lengths differ.

    Examples
    --------
    >>> import plenoptic as pl
    >>> chromium = pl.optics.FilmMaterial([2.62, 3.18, 3.13], [3.01, 3.33, 3.31], [486.0, 551.0, 590.0])
    >>> chromium.complex_index(551.0)
    (3.18+3.33j)
    """

    index: Given[Floats, ArrayLike]
    extinction: Given[Floats, ArrayLike] = Given(default=0.0)
    wavelengths: Given[Floats | None, ArrayLike | None] = Given(default=None)

    def __post_init__(self) -> None:
        if self.wavelengths is not None:
            set_field(self, "wavelengths", rising_wavelengths(self.wavelengths, "wavelengths"))
        count = 1 if self.wavelengths is None else len(self.wavelengths)
        for name, low in (("index", 1e-6), ("extinction", 0.0)):
            checked = table_column(getattr(self, name), name, count)
            if not ((checked >= low) & (checked < math.inf)).all():
                raise InvalidValueError(f"{name} has {checked.min():g}; it must be finite and at least {low:g}")
            set_field(self, name, checked)

    def complex_index(self, wavelength: float) -> complex:
        """Complex index n + i k at a wavelength in nm; an InvalidValueError outside the table."""
        if self.wavelengths is None:
            return complex(self.index[0], self.extinction[0])
        nm = wavelength_within(wavelength, (self.wavelengths[0], self.wavelengths[-1]), "a film material")
        n, k = (float(np.interp(nm, self.wavelengths, column)) for column in (self.index, self.extinction))
        return complex(n, k)


Film: TypeAlias = Medium | FilmMaterial
"""Material of a film."""


def _check_film(material: object, name: str) -> None:
    if not isinstance(material, FilmMaterial):
        check_medium(material, name)


def film_index(material: Film, wavelength: float) -> complex:
    """Complex index of the material of a film at a wavelength in nm."""
    if isinstance(material, FilmMaterial):
        return material.complex_index(wavelength)
    return complex(material.index(wavelength))


@value
class Coating:
    """Thin films on a surface, whose light interferes.

    Parameters
    ----------
    layers : sequence of (medium, float), optional
        Material and thickness in nm of each film, from the medium of the lower index (air) to the glass, so that both
        faces of an element have the same coating. In a lens, indices are compared at 587.6 nm (at the wavelength of the
        light if a medium has none there); between equal ones films go from front to back. Materials are media or a
        `FilmMaterial`. Without layers, the surface is bare: Fresnel's reflection.

    Raises
    ------
    PrescriptionError
        If a thickness is not above 0 and at most 1e5 nm, or a material is none.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.optics.surface_powers(pl.optics.Coating(), 1.0, 1.5, 1.0, 550.0).reflectance.round(12).tolist()
    0.04
    >>> v_coat = pl.optics.Coating([(pl.glass("MgF2"), 130.0), (pl.optics.ConstantMedium(2.1), 15.0)])
    >>> pl.optics.surface_powers(v_coat, 1.0, 1.5168, 1.0, 550.0).reflectance.round(4).tolist()
    0.0005
    """

    layers: Sequence[tuple[Film, float]] = ()

    def __post_init__(self) -> None:
        check_has(
            self.layers, "layers", "sequence of (medium, thickness in nm)", "[(pl.glass('MgF2'), 99.6)]", "__len__"
        )
        films = []
        for i, layer in enumerate(self.layers):
            try:
                material, thickness = layer
            except (TypeError, ValueError):
                raise PrescriptionError(f"layer {i} is {layer!r}; it must be (medium, thickness in nm)") from None
            _check_film(material, f"the material of layer {i}")
            nm = finite(thickness, f"the thickness of layer {i}")
            if not 0.0 < nm <= _THICKEST:
                raise PrescriptionError(
                    f"the thickness of layer {i} is {nm:g} nm; it must be above 0 and at most {_THICKEST:g}: films are "
                    "given in nm, and thicker layers as elements with two surfaces"
                )
            films.append((material, nm))
        set_field(self, "layers", tuple(films))

    def films(self, wavelength: float) -> list[tuple[complex, float]]:
        """Complex index and thickness in nm of each film from the medium of the lower index, at a wavelength in nm."""
        return [(film_index(material, wavelength), thickness) for material, thickness in self.layers]


MAGNESIUM_FLUORIDE = ConstantMedium(1.38)
"""Index of evaporated magnesium fluoride in the visible; the crystal `pl.glass("MgF2")` differs by 0.3 %."""


@value
class SingleLayer:
    """One film that is a quarter of a wavelength thick: the classical coating against reflections.

    Parameters
    ----------
    medium : Medium or FilmMaterial, optional
        Magnesium fluoride of index 1.38 by default.
    wavelength : float, optional
        Wavelength in nm at which the film is a quarter of a wavelength thick, at normal incidence.

    Raises
    ------
    InvalidValueError
        If the wavelength is none; a PrescriptionError for a material that is none.

    Examples
    --------
    On glass of index 1.9 = 1.38^2 nothing is reflected:

    >>> import plenoptic as pl
    >>> single = pl.optics.SingleLayer(wavelength=550.0)
    >>> pl.optics.surface_powers(single, 1.0, [1.5168, 1.9044], 1.0, 550.0).reflectance.round(4).tolist()
    [0.0128, 0.0]
    """

    medium: Film = MAGNESIUM_FLUORIDE
    wavelength: float = 550.0

    def __post_init__(self) -> None:
        _check_film(self.medium, "medium")
        set_field(self, "wavelength", wavelength_in_nm(self.wavelength))
        self.films(self.wavelength)

    def films(self, wavelength: float) -> list[tuple[complex, float]]:
        """Complex index and thickness in nm of the film, at a wavelength in nm."""
        thickness = self.wavelength / (4.0 * film_index(self.medium, self.wavelength).real)
        return [(film_index(self.medium, wavelength), thickness)]


@value
class Reflectance:
    """A coating by its reflectance, as makers state it; all other light is transmitted.

    Parameters
    ----------
    reflectance : float, (n,) or (n, angles) array
        From 0 to 1: one number for all light, one for each wavelength, or one for each wavelength and angle. The same
        from both sides; above the critical angle it is 1.
    wavelengths : (n,) array, optional
        Rising wavelengths in nm, between which the table is interpolated linearly. None: the same for all.
    angles : (angles,) array, optional
        Rising angles of incidence in the medium of the lower index, radians; linear in their cosine between them, since
        reflectances are even in the angle, and constant beyond the first and the last. None: the same at all angles.

    Raises
    ------
    InvalidValueError
        If a number is out of range, or the shapes do not fit.

    Examples
    --------
    >>> import plenoptic as pl
    >>> half_percent = pl.optics.Reflectance(0.005)
    >>> broadband = pl.optics.Reflectance([0.012, 0.004, 0.008], wavelengths=[400.0, 550.0, 700.0])
    >>> pl.optics.surface_powers(broadband, 1.0, 1.5, 1.0, 475.0).transmittance.round(4).tolist()
    0.992
    """

    reflectance: Given[Floats, ArrayLike]
    wavelengths: Given[Floats | None, ArrayLike | None] = Given(default=None)
    angles: Given[Floats | None, ArrayLike | None] = Given(default=None)

    def __post_init__(self) -> None:
        if self.wavelengths is not None:
            set_field(self, "wavelengths", rising_wavelengths(self.wavelengths, "wavelengths"))
        if self.angles is not None:
            angles = frozen_array(self.angles, name="angles", shape=(None,))
            if not angles.size or (np.diff(angles) <= 0).any() or not 0.0 <= angles[0] <= angles[-1] <= math.pi / 2:
                raise InvalidValueError("angles must rise from 0 or more to at most pi / 2: give radians")
            set_field(self, "angles", angles)
        rows = 1 if self.wavelengths is None else len(self.wavelengths)
        columns = 1 if self.angles is None else len(self.angles)
        table = plain_array(self.reflectance, "reflectance")
        if table.ndim == 0 or table.ndim == (self.wavelengths is not None) + (self.angles is not None) < 2:
            table = np.broadcast_to(table.reshape(-1, 1) if self.angles is None else table, (rows, columns))
        table = frozen_array(table, name="reflectance", shape=(rows, columns))
        if not ((table >= 0.0) & (table <= 1.0)).all():
            raise InvalidValueError(f"reflectance is from {table.min():g} to {table.max():g}; it must be from 0 to 1")
        set_field(self, "reflectance", table)

    def at(self, cosine: Floats, wavelength: float) -> Floats:
        """Reflectance at cosines of the angle in the medium of the lower index and a wavelength in nm."""
        table = np.asarray(self.reflectance)
        row = table[0]
        if self.wavelengths is not None:
            nm = wavelength_within(wavelength, (self.wavelengths[0], self.wavelengths[-1]), "the reflectance")
            (rows,) = np.nonzero(np.equal(self.wavelengths, nm))  # one of the table's needs no interpolation
            row = table[rows[0]] if len(rows) else np.array([np.interp(nm, self.wavelengths, c) for c in table.T])
        if self.angles is None:
            return np.full(np.shape(cosine), row[0])
        return np.asarray(np.interp(-np.asarray(cosine), -np.cos(self.angles), row))


SurfaceCoating: TypeAlias = SingleLayer | Coating | Reflectance
"""Coating of a surface."""
