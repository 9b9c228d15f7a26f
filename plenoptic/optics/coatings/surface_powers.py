"""Reflectance, transmittance and absorptance of a surface, bare or coated."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.values import Floats, broadcast, finite, result, wavelength_in_nm
from plenoptic.errors import InvalidValueError, PrescriptionError
from plenoptic.optics.coatings.coating import Reflectance, SurfaceCoating
from plenoptic.optics.coatings.thin_films import FilmPowers, film_powers
from plenoptic.optics.glass.media import D_LINE, Medium, refractive_indices


@result
class SurfacePowers:
    """Fractions of the light that a surface reflects, transmits and absorbs. Made by `surface_powers`.

    Attributes
    ----------
    reflectance_s, reflectance_p, transmittance_s, transmittance_p : array
        For light polarised perpendicular (s) and parallel (p) to the plane of incidence.

    Examples
    --------
    See `surface_powers`.
    """

    reflectance_s: Floats
    reflectance_p: Floats
    transmittance_s: Floats
    transmittance_p: Floats

    @property
    def reflectance(self) -> Floats:
        """Reflectance of unpolarised light."""
        return np.asarray(0.5 * (self.reflectance_s + self.reflectance_p))

    @property
    def transmittance(self) -> Floats:
        """Transmittance of unpolarised light."""
        return np.asarray(0.5 * (self.transmittance_s + self.transmittance_p))

    @property
    def absorptance_s(self) -> Floats:
        """Absorptance of the coating for s."""
        return np.asarray(1.0 - self.reflectance_s - self.transmittance_s)

    @property
    def absorptance_p(self) -> Floats:
        """Absorptance of the coating for p."""
        return np.asarray(1.0 - self.reflectance_p - self.transmittance_p)

    @property
    def absorptance(self) -> Floats:
        """Absorptance of the coating for unpolarised light; 0 to rounding where no film absorbs."""
        return np.asarray(0.5 * (self.absorptance_s + self.absorptance_p))


def check_coating(coating: object) -> None:
    """Raise PrescriptionError if an object is neither a coating nor None."""
    if not (coating is None or isinstance(coating, SurfaceCoating)):
        raise PrescriptionError(
            f"coating is {coating!r}; it must be pl.optics.SingleLayer(), pl.optics.Coating(layers), "
            "pl.optics.Reflectance(0.005) or None"
        )


def checked_reflectance(value: float, name: str) -> float:
    """`value` as a float, or an error that names it if it is not from 0 to 1."""
    reflectance = finite(value, name)
    if not 0.0 <= reflectance <= 1.0:
        raise InvalidValueError(f"{name} is {reflectance:g}; its reflectance must be from 0 to 1")
    return reflectance


def surface_powers(
    coating: SurfaceCoating | None, n_from: ArrayLike, n_to: ArrayLike, cosine: ArrayLike, wavelength: ArrayLike
) -> SurfacePowers:
    """Reflectance, transmittance and absorptance of a surface between two media, with its coating.

    Parameters
    ----------
    coating : SingleLayer, Coating, Reflectance or None
        None: bare, as `Coating()`.
    n_from, n_to : array
        Refractive indices in front of the surface and behind it, in the direction of the light.
    cosine : array
        Cosine of the angle of incidence in the first medium, 0 to 1.
    wavelength : array
        nm. All four are broadcast to one shape, that of the result.

    Raises
    ------
    InvalidValueError
        If a number is out of range, or a material has no index at a wavelength.

    Notes
    -----
    Films are described from the medium of the lower index to the other one, whatever the direction of the light, and
    between equal indices from the first one; a lens has its own order (`Coating`). Above the critical angle the
    reflectance is 1 less the absorptance. Transmittances are the same in both directions.

    References
    ----------
    M. Born and E. Wolf, Principles of Optics, 7th ed. (1999), sections 1.5.3 and 1.6.

    Examples
    --------
    Brightest reflections of glass, and its polarising angle, arctan 1.5:

    >>> import numpy as np, plenoptic as pl
    >>> powers = pl.optics.surface_powers(None, 1.0, 1.5, np.cos([0.0, np.arctan(1.5), 1.55]), 550.0)
    >>> powers.reflectance_s.round(4).tolist(), powers.reflectance_p.round(4).tolist()
    ([0.04, 0.1479, 0.9283], [0.04, 0.0, 0.8458])
    """
    return ordered_powers(coating, n_from, n_to, cosine, wavelength, None)


def ordered_powers(
    coating: SurfaceCoating | None,
    n_from: ArrayLike,
    n_to: ArrayLike,
    cosine: ArrayLike,
    wavelength: ArrayLike,
    in_order: ArrayLike | None,
) -> SurfacePowers:
    """`surface_powers` of light that meets the films in the order of the coating (`in_order`), or reversed.

    None: in order where the index does not fall.
    """
    check_coating(coating)
    first, last, cos, nm = broadcast(n_from=n_from, n_to=n_to, cosine=cosine, wavelength=wavelength)
    if not ((cos >= 0.0) & (cos <= 1.0)).all():
        raise InvalidValueError("cosine must be from 0 to 1: it is that of the angle against the surface normal")
    for name, index in (("n_from", first), ("n_to", last)):
        if not ((index >= 1.0) & (index < np.inf)).all():
            raise InvalidValueError(f"{name} must be finite and at least 1: a lens refracts, and metals are films only")
    waves, inverse = np.unique(nm, return_inverse=True)
    inverse, powers = inverse.reshape(nm.shape), np.empty((4, *nm.shape))
    for i, wave in enumerate(waves.tolist()):
        at = inverse == i
        for order in (True, False):
            chosen = at & ((first <= last if in_order is None else in_order) == np.bool_(order))
            if chosen.any():
                powers[:, chosen] = _at_wavelength(
                    coating, first[chosen], last[chosen], cos[chosen], wavelength_in_nm(wave), in_order=order
                )
    return SurfacePowers(*powers)


def is_from_front(media: Sequence[Medium], wavelength: float) -> bool:
    """True if the films of a surface in a lens are described from the medium in front of it, the first of two.

    That of the lower index at 587.6 nm, or at the wavelength in nm of the light if one has no index there; the first
    one if both are equal.
    """
    try:
        front, behind = refractive_indices(media, D_LINE)
    except ValueError:  # media of other packages raise their own
        front, behind = refractive_indices(media, wavelength)
    return bool(front <= behind)


def _at_wavelength(
    coating: SurfaceCoating | None, n_from: Floats, n_to: Floats, cosine: Floats, wavelength: float, *, in_order: bool
) -> FilmPowers:
    """Powers of light that meets the films in their order or reversed."""
    if isinstance(coating, Reflectance):
        sine2 = (1.0 - cosine) * (1.0 + cosine) * np.maximum(n_from / n_to, 1.0) ** 2
        reflected = np.where(sine2 < 1.0, coating.at(np.sqrt(np.maximum(1.0 - sine2, 0.0)), wavelength), 1.0)
        return FilmPowers(reflected, reflected, 1.0 - reflected, 1.0 - reflected)
    films = [] if coating is None else coating.films(wavelength)
    if not in_order:
        films = films[::-1]
    indices = [np.full(cosine.shape, index) for index, _ in films]
    phases = [np.full(cosine.shape, 2.0 * np.pi * thickness / wavelength) for _, thickness in films]
    return film_powers((n_from, n_to), indices, phases, cosine)
