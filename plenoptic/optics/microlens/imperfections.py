"""Deviations of individual microlenses from their design: random from a seed, or listed."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.values import LARGEST_LENGTH, Floats, Given, finite, frozen_array, seed_number, set_field, value
from plenoptic.errors import InvalidValueError

_MAX_SPREAD = 0.2


@value
class MicrolensDeviations:
    """Deviations of individual microlenses; all others are as designed.

    Parameters
    ----------
    index : (n, 2) array of int
        Lattice indices (i, j) of the lenses, each once; in FREE lattices (number, 0).
    shift : (n, 2) array, optional
        Displacement of the lens in mm, with its `aperture` if it has one; None: no displacement.
    decentre : (n, 2) array, optional
        Displacement of the optical axis within the opening in mm.
    focal_length_factor : (n,) array, optional
        Focal length over its design value, above 0; inf is a missing lens: flat glass.
    transmission : (n,) array, optional
        0 (dark) to 1.

    Raises
    ------
    InvalidValueError
        If arrays differ in length, lenses are listed twice, or numbers are out of range.

    Examples
    --------
    >>> import plenoptic as pl
    >>> dark = pl.optics.MicrolensDeviations(index=[(0, 0), (3, -1)], transmission=[0.0, 0.5])
    >>> len(dark)
    2
    """

    index: Given[NDArray[np.int64], ArrayLike]
    shift: Given[Floats | None, ArrayLike | None] = Given(default=None)
    decentre: Given[Floats | None, ArrayLike | None] = Given(default=None)
    focal_length_factor: Given[Floats | None, ArrayLike | None] = Given(default=None)
    transmission: Given[Floats | None, ArrayLike | None] = Given(default=None)

    def __post_init__(self) -> None:
        set_field(self, "index", frozen_array(self.index, name="index", shape=(None, 2), dtype=np.int64))
        n = len(self.index)
        if len(np.unique(self.index, axis=0)) != n:
            raise InvalidValueError("index lists a microlens twice; give each lens one row")
        for name, shape in (
            ("shift", (n, 2)),
            ("decentre", (n, 2)),
            ("focal_length_factor", (n,)),
            ("transmission", (n,)),
        ):
            values = getattr(self, name)
            if values is None:
                continue
            array = frozen_array(values, name=name, shape=shape)
            if np.isnan(array).any() or (name != "focal_length_factor" and not np.isfinite(array).all()):
                raise InvalidValueError(f"{name} holds a number that is not finite; correct it")
            set_field(self, name, array)
        if self.focal_length_factor is not None and not (self.focal_length_factor > 0).all():
            raise InvalidValueError(f"focal_length_factor is {self.focal_length_factor.min():g}; it must be above 0")
        if self.transmission is not None and not ((self.transmission >= 0) & (self.transmission <= 1)).all():
            raise InvalidValueError(
                "transmission holds a number outside 0 to 1; it is the fraction of the light that passes"
            )

    def __len__(self) -> int:
        return len(self.index)


@value
class MicrolensImperfections:
    """Random deviations of microlenses from their design; those of a lens depend on the seed and its lattice index.

    Parameters
    ----------
    pitch_jitter : float
        Standard deviation along x and y of the position of each lens, with its opening, in mm.
    decentre : float
        Standard deviation along x and y of the optical axis of each lens within its opening, in mm.
    focal_length_spread : float
        Standard deviation of the relative focal length, at most 0.2.
    missing : float
        Fraction of lenses that are flat glass.
    dark : float
        Fraction of lenses that are opaque, including clear gaps of their cells.
    seed : int
        The same seed gives the same array.

    Raises
    ------
    InvalidValueError
        If a number is out of range.

    Notes
    -----
    Deviations are normal, truncated at 4 standard deviations. A displaced lens is clipped by its design cell. Without
    an `aperture` it fills that cell, and only its axis moves.

    Examples
    --------
    >>> import plenoptic as pl
    >>> spoiled = pl.MicrolensImperfections(pitch_jitter=0.002, dark=0.1, seed=7)
    >>> found = spoiled.deviations([(0, 0), (1, 0)])
    >>> found == spoiled.deviations([(0, 0), (1, 0)]), found.shift.shape
    (True, (2, 2))
    """

    pitch_jitter: float = 0.0
    decentre: float = 0.0
    focal_length_spread: float = 0.0
    missing: float = 0.0
    dark: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        limits = {"pitch_jitter": LARGEST_LENGTH, "decentre": LARGEST_LENGTH, "focal_length_spread": _MAX_SPREAD}
        for name, limit in (*limits.items(), ("missing", 1.0), ("dark", 1.0)):
            number = finite(getattr(self, name), name)
            if not 0 <= number <= limit:
                raise InvalidValueError(f"{name} is {number:g}; it must be from 0 to {limit:g}")
            set_field(self, name, number)
        if self.missing + self.dark > 1:
            raise InvalidValueError(f"missing and dark add up to {self.missing + self.dark:g}; at most 1 is possible")
        set_field(self, "seed", seed_number(self.seed))

    def deviations(self, index: ArrayLike) -> MicrolensDeviations:
        """Deviations of lenses with lattice indices (n, 2)."""
        index = frozen_array(index, name="index", shape=(None, 2), dtype=np.int64)
        state = _uniform(index, self.seed, 0)
        factor = 1.0 + self.focal_length_spread * _normal(index, self.seed, 1)
        missing = state < self.missing
        return MicrolensDeviations(
            index=index,
            shift=None if self.pitch_jitter == 0 else self.pitch_jitter * _normal_pairs(index, self.seed, 2),
            decentre=None if self.decentre == 0 else self.decentre * _normal_pairs(index, self.seed, 4),
            focal_length_factor=None
            if self.focal_length_spread == 0 and self.missing == 0
            else np.where(missing, np.inf, np.maximum(factor, 1e-3)),
            transmission=None if self.dark == 0 else np.where(state >= 1.0 - self.dark, 0.0, 1.0),
        )


Imperfections: TypeAlias = MicrolensImperfections | MicrolensDeviations
"""Imperfections of an array, random or listed."""


def deviations_of(imperfections: Imperfections, index: NDArray[np.int64]) -> MicrolensDeviations:
    """Deviations of the lenses with lattice indices (n, 2), in that order."""
    if isinstance(imperfections, MicrolensImperfections):
        return imperfections.deviations(index)
    rows = {tuple(pair): k for k, pair in enumerate(imperfections.index.tolist())}
    row = np.array([rows.get(tuple(pair), -1) for pair in index.tolist()], dtype=np.int64).reshape(-1)
    is_listed = row >= 0

    def column(values: Floats | None, design: float) -> Floats | None:
        if values is None or not len(values):
            return None
        mask = is_listed if values.ndim == 1 else is_listed[:, None]
        return np.where(mask, values[row], design)

    return MicrolensDeviations(
        index=index,
        shift=column(imperfections.shift, 0.0),
        decentre=column(imperfections.decentre, 0.0),
        focal_length_factor=column(imperfections.focal_length_factor, 1.0),
        transmission=column(imperfections.transmission, 1.0),
    )


def largest_offset(imperfections: Imperfections | None) -> float:
    """Largest possible distance in mm of an optical axis from its design position."""
    if imperfections is None:
        return 0.0
    if isinstance(imperfections, MicrolensImperfections):
        return 4.0 * math.sqrt(2.0) * (imperfections.pitch_jitter + imperfections.decentre)
    shifts = [part for part in (imperfections.shift, imperfections.decentre) if part is not None and len(part)]
    return sum(float(np.hypot(*part.T).max()) for part in shifts)


def extreme_factors(imperfections: Imperfections | None) -> tuple[float, float]:
    """Smallest and largest possible focal length over that of the design; inf is flat glass."""
    if isinstance(imperfections, MicrolensImperfections):
        spread = 4.0 * imperfections.focal_length_spread
        return max(1.0 - spread, 1e-3), math.inf if imperfections.missing else 1.0 + spread
    factors = None if imperfections is None else imperfections.focal_length_factor
    if factors is None or not len(factors):
        return 1.0, 1.0
    return min(1.0, float(factors.min())), max(1.0, float(factors.max()))


def _mix(x: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Finaliser of splitmix64 (G. Steele, D. Lea, C. Flood, OOPSLA 2014, doi 10.1145/2660193.2660195)."""
    with np.errstate(over="ignore"):
        x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        return np.asarray(x ^ (x >> np.uint64(31)))


def _uniform(index: NDArray[np.int64], seed: int, stream: int) -> Floats:
    """Random numbers in (0, 1) for lenses (n, 2), functions of seed, stream and index."""
    state = np.full(len(index), (seed * 0x9E3779B97F4A7C15 + stream) % (1 << 64), dtype=np.uint64)
    state = _mix(state)  # or stream s of lens (i, j) would be stream 0 of lens (i ^ s, j)
    for k in range(2):
        state = _mix(state ^ index[:, k].view(np.uint64))
        with np.errstate(over="ignore"):
            state = state + np.uint64(0x9E3779B97F4A7C15)
    return (_mix(state) >> np.uint64(11)).astype(np.float64) * 2.0**-53 + 2.0**-54


def _normal(index: NDArray[np.int64], seed: int, stream: int) -> Floats:
    """Standard normal numbers, truncated at 4 (G. Box, M. Muller, Ann. Math. Stat. 29, 1958)."""
    radius = np.sqrt(-2.0 * np.log(_uniform(index, seed, 2 * stream)))
    angle = 2 * math.pi * _uniform(index, seed, 2 * stream + 1)
    return np.asarray(np.clip(radius * np.cos(angle), -4.0, 4.0))


def _normal_pairs(index: NDArray[np.int64], seed: int, stream: int) -> Floats:
    return np.stack([_normal(index, seed, stream), _normal(index, seed, stream + 1)], axis=1)
