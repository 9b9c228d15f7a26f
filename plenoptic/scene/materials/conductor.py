"""Mirrors and metals."""

from __future__ import annotations

from typing import Any

import numpy as np

from plenoptic.core.values import checked_field, set_field, value
from plenoptic.errors import InvalidValueError, SceneError
from plenoptic.scene.materials.material_records import SMOOTH, Index, MaterialRow
from plenoptic.scene.textures.color import Colour, as_colour, as_fraction

_LARGEST = 1e30


@value
class Conductor:
    """A mirror, or a metal whose surface is rough.

    The surface consists of small mirrors whose normals have the GGX (Trowbridge-Reitz) distribution, hidden from each
    other by Smith's height-correlated function. Light is followed to the first of them: the light of a real surface
    after a second reflection is missing (a table is in docs/validation.md). Both sides reflect.

    Parameters
    ----------
    reflectance : float or (float, float, float)
        Share that each small mirror reflects, in [0, 1], at all angles; a factor where there is an `index`.
    alpha : float
        Width of the distribution of normals, in [0, 1]: 0 is a mirror (as are values below 0.0001), 0.1 brushed, 0.5
        matt. glTF's roughness is its square root.
    index : complex, (complex, complex, complex) or None
        Refractive index n + i k, k at least 0, at all wavelengths or for red, green and blue. None: all angles alike.

    Raises
    ------
    InvalidValueError
        Not numbers.
    SceneError
        A reflectance or alpha outside [0, 1]; an index that absorbs less than nothing, or with n not above 0.

    Notes
    -----
    B. Walter et al., "Microfacet models for refraction through rough surfaces", EGSR 2007; E. Heitz, J. Comput. Graph.
    Tech. 3(2), 48 (2014). Directions are drawn by visible normals: J. Dupuy and A. Benyoub, Comput. Graph. Forum 42(8)
    (2023).

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.Conductor(0.9, alpha=0.1)
    Conductor(reflectance=0.9, alpha=0.1)
    >>> gold = pl.Conductor(index=(0.18 + 3.4j, 0.42 + 2.35j, 1.37 + 1.77j), alpha=0.2)
    """

    reflectance: Colour = checked_field(as_colour, default=1.0, at_most=1.0)
    alpha: float = checked_field(as_fraction, default=0.0)
    index: Index | None = None

    def __post_init__(self) -> None:
        if self.index is not None:
            set_field(self, "index", _as_index(self.index))

    def row(self) -> MaterialRow:
        """Row of the material's numbers; missing ones keep their default."""
        index = 0.0 if self.index is None else self.index
        return MaterialRow(self.reflectance, roughness=self.alpha, metal_index=index, specular=self.alpha < SMOOTH)


def _as_index(index: Any) -> Index:
    try:
        parts = np.asarray(index, dtype=np.complex128)
    except (TypeError, ValueError):
        parts = np.empty(0, dtype=np.complex128)
    if parts.shape not in ((), (3,)):
        raise InvalidValueError(f"index is {index!r}; it must be one complex number n + k j, or one each for r, g, b")
    listed = [complex(part) for part in parts.ravel()]
    if not all(0 < part.real <= _LARGEST and 0 <= part.imag <= _LARGEST for part in listed):
        raise SceneError(f"index is {index!r}; it must have n above 0 and k of 0 or more, both at most {_LARGEST:g}")
    return listed[0] if parts.shape == () else (listed[0], listed[1], listed[2])
