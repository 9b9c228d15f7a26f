"""Conditioning of rays at each element of a lens: amplification of their errors, and cost of their intersections."""

from __future__ import annotations

import enum
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.lost_rays import Lost, by_cause, in_words, lost_rays
from plenoptic.core.rays import RayBundle
from plenoptic.core.values import Floats, check_kind, flag, result
from plenoptic.optics.element_record import ASPHERE, CONIC, FREEFORM, IDEAL, SPHERE
from plenoptic.optics.lens.lens_record import LensRecord, lens_record
from plenoptic.optics.lens.stack import LensStack

CHUNK = 64
"""Blocks of 256 rays that are traced together; ten elements need 8 MB of records."""


class Condition(enum.IntEnum):
    """Cause of amplified errors of a ray. See `conditioning`."""

    INCIDENCE = 0
    """1 / cos i: distance of two parallel rays on the surface over their distance from each other. Large at grazing
    incidence."""
    REFRACTION = 1
    """d i' / d i = n cos i / (n' cos i'): derivative of the angle of refraction by the angle of incidence. Infinite at
    the critical angle of total reflection."""
    CANCELLATION = 2
    """Sum of the lengths that enter an intersection, over the size of the element: 10^d if d of the 15.7 decimal digits
    of float64 are lost."""


class Worst(NamedTuple):
    """Largest condition number of a lens."""

    element: int
    """Index in `LensStack.elements`."""
    condition: Condition
    number: float


@result
class Conditioning:
    r"""Conditioning of rays at each element; made by `conditioning`. `print` shows a table.

    Origins and directions of rays have errors, at least the rounding errors of float64. At an intersection, a lateral
    error e of the ray becomes e / cos i along the surface. An error a of its direction becomes a n cos i / (n' cos i')
    behind the surface, in the plane of incidence. With eps = 2.2e-16,

        \|error of the point\| <= 4 eps incidence cancellation size

    for one element and a ray with relative errors of eps; ten times that if cos i < 0.01. `size` is the semi-diameter,
    or the radius of curvature of a surface with a depth. Cancellation adds up the lengths that are rounded to eps of
    their own size. These are the distance from the element's vertex to the ray's origin, from there to the
    intersection, and the terms of the surface equation. At the first and last element the distance from the lens origin
    counts too.

    Columns are [largest, median] over the rays that pass the element, nan if no ray does. For numbers of steps they are
    [largest, mean] over the rays that reach the element.

    Attributes
    ----------
    elements : (n,) array of int
        Indices in `LensStack.elements`, in the order of the intersections. Models other than EXACT have fewer.
    kinds : tuple of str
        "plane", "sphere", "conic", "asphere", "stop" or "ideal lens".
    rays : int
        Rays traced.
    reached : (n,) array of int
        Rays that reach the element.
    incidence, refraction, cancellation : (n, 2) array
        Condition numbers, see `Condition`; refraction at an ideal lens is cos^2 i' / cos^2 i.
    newton : (n, 2) array
        Steps of Newton's method on an asphere; 0 for planes, spheres and conics.
    search : (n, 2) array
        Steps of the search for the first intersection with an asphere, for rays that may have more than one.
    searched : (n,) array of int
        Rays for which the search was needed.
    lost : tuple of (str, int or None, int)
        Cause, index of the element (None for no element) and number of rays, as in `RenderStats.lost`.

    Examples
    --------
    >>> import plenoptic as pl
    >>> lens = pl.load_lens("singlet-100mm-f4")
    >>> rays = pl.RayBundle([[0, 3.0, -100.0], [0, 30, -100]], [[0, 0, 1.0], [0, 0, 1]])
    >>> condition = pl.optics.conditioning(lens, rays)
    >>> condition
    <Conditioning of 2 rays at 3 elements: worst at element 0, cancellation 16>
    >>> condition.lost
    (('clipped', 0, 1),)
    """

    elements: NDArray[np.int64]
    kinds: tuple[str, ...]
    rays: int
    reached: NDArray[np.int64]
    incidence: Floats
    refraction: Floats
    cancellation: Floats
    newton: Floats
    search: Floats
    searched: NDArray[np.int64]
    lost: Lost = ()

    @property
    def digits_lost(self) -> Floats:
        """(n, 2): largest and median number of decimal digits lost by cancellation, out of the 15.7 of float64."""
        return np.asarray(np.log10(np.maximum(self.cancellation, 1.0)))

    @property
    def worst(self) -> Worst | None:
        """Element and kind of the largest condition number; None if no ray passes any element."""
        largest = np.stack([self.incidence[:, 0], self.refraction[:, 0], self.cancellation[:, 0]])
        if np.isnan(largest).all():
            return None
        kind, row = np.unravel_index(np.nanargmax(largest), largest.shape)
        return Worst(int(self.elements[row]), Condition(int(kind)), float(largest[kind, row]))

    @property
    def lost_by_cause(self) -> dict[str, int]:
        """Number of lost rays for each cause, over all elements."""
        return by_cause(self.lost)

    def lost_at(self, element: int | None) -> dict[str, int]:
        """Number of rays lost at an element, for each cause; `element` None counts rays that are lost at no element.

        Examples
        --------
        >>> import plenoptic as pl
        >>> rays = pl.RayBundle([[0, 30.0, -100.0]], [[0, 0, 1.0]])
        >>> pl.optics.conditioning(pl.load_lens("singlet-100mm-f4"), rays).lost_at(0)
        {'clipped': 1}
        """
        return {cause: count for cause, at, count in self.lost if at == element}

    def __repr__(self) -> str:
        worst = self.worst
        worst_text = "" if worst is None else f": worst at element {worst.element}, {_element_name(worst)}"
        return f"<Conditioning of {self.rays} rays at {len(self.elements)} elements{worst_text}>"

    def __str__(self) -> str:
        rows = [_HEAD, *(self._row(i) for i in range(len(self.elements)))]
        if lost_before := self.lost_at(None):
            rows.append(("", "before the lens", *([""] * 7), in_words(lost_before)))
        widths = [max(len(row[column]) for row in rows) for column in range(len(_HEAD) - 1)]
        lines = ["  ".join([*map(str.rjust, row[:-1], widths), row[-1]]).rstrip() for row in rows]
        worst = self.worst
        if worst is not None:
            lines.append("largest / median of all rays; digits lost: logarithm of the cancellation")
            lines.append(f"worst: {_element_name(worst)} at element {worst.element}")
        return "\n".join(lines)

    def _row(self, i: int) -> tuple[str, ...]:
        asphere, last = self.kinds[i] == "asphere", self.elements[i] not in self.elements[i + 1 :]
        pairs = [_pair(numbers[i]) for numbers in (self.incidence, self.refraction, self.digits_lost)]
        return (
            str(self.elements[i]),
            self.kinds[i],
            str(self.reached[i]),
            *pairs,
            _pair(self.newton[i]) if asphere else "",
            _pair(self.search[i]) if self.searched[i] else "",
            str(self.searched[i]) if asphere else "",
            in_words(self.lost_at(int(self.elements[i]))) if last else "",
        )


_HEAD = ("element", "kind", "rays", "1 / cos i", "n cos i / (n' cos i')", "digits lost", "Newton", "search", "searched",
         "lost")  # fmt: skip


def _pair(numbers: Floats) -> str:
    return "" if np.isnan(numbers).any() else " / ".join(f"{number:.3g}" for number in numbers)


def _element_name(worst: Worst) -> str:
    return f"{worst.condition.name.lower()} {worst.number:.3g}"


def conditioning(lens: LensStack, rays: RayBundle, *, reverse: bool = False) -> Conditioning:
    """Amplification of ray errors at each element of a lens, with the cost of its intersections in steps and rays.

    Needs about fifty times the time of tracing, and 40 bytes for each ray and element: use thousands of rays. They are
    traced by `lens.model`.

    Parameters
    ----------
    lens : LensStack
    rays : RayBundle
        In the lens frame. Positions of the origins along the rays matter here: distant points have larger rounding
        errors.
    reverse : bool, optional
        Trace towards the scene, as `LensStack.trace_reverse`.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2")
    >>> y = np.linspace(-12.0, 12.0, 101)
    >>> rays = pl.RayBundle(np.stack([0 * y, y, 0 * y - 50.0], axis=1), [[0, 0, 1.0]] * 101)
    >>> condition = pl.optics.conditioning(lens, rays)
    >>> bool(condition.incidence.max() < 2), bool(condition.digits_lost.max() < 1)
    (True, True)
    >>> condition.worst.element, condition.worst.condition.name
    (0, 'CANCELLATION')
    """
    check_kind(lens, "lens", LensStack, 'pl.load_lens("double-gauss-100mm-f2")')
    check_kind(rays, "rays", RayBundle, "pl.RayBundle([[0, 0, -100]], [[0, 0, 1]])")
    reverse = flag(reverse, "reverse")
    return conditioning_of(probe_rays(lens_record(lens, rays.wavelength, reverse=reverse), blocks_of(rays), len(rays)))


class ProbeRecords(NamedTuple):
    """Conditioning of each ray; arrays (elements, rays) in the order of travel, nan if the ray does not pass the
    element.
    """

    lens: LensRecord
    incidence: Floats
    refraction: Floats
    cancellation: Floats
    newton: Floats
    """As `search`: nan only if the ray does not reach the element."""
    search: Floats
    codes: NDArray[np.int64]
    """(rays,): status behind the lens, as in `ray_blocks`."""


def blocks_of(rays: RayBundle) -> Floats:
    """Rays in the memory layout of kernels; see `ray_blocks`. Lost rays fill up the last block."""
    from plenoptic.core.kernels.ray_blocks import BLOCK, CAUSES, MISSED, RAY

    n = len(rays)
    rows = np.zeros((RAY // BLOCK, -(-n // BLOCK) * BLOCK))
    rows[7] = MISSED
    rows[0:3, :n], rows[3:6, :n], rows[6, :n] = rays.origin.T, rays.direction.T, rays.weight
    rows[7, :n] = np.where(rays.status == 0, 0.0, rays.status + CAUSES * (rays.lost_at + 1.0))
    return np.ascontiguousarray(rows.reshape(RAY // BLOCK, -1, BLOCK).transpose(1, 0, 2)).reshape(-1)


def probe_rays(lens: LensRecord, blocks: Floats, n: int, waves: NDArray[np.int64] | None = None) -> ProbeRecords:
    """Trace the first n rays of a bundle in place and record their conditioning; see `fill_conditions`."""
    from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, STATUS
    from plenoptic.optics.lens.kernels.conditioning_probes import (
        INCIDENCE,
        NEWTON,
        PROBE_ROWS,
        REFRACTION,
        ROUNDED_LENGTH,
        STEPS,
    )
    from plenoptic.optics.lens.kernels.trace import fill_conditions

    elements, whole = len(lens.rows), blocks.size // RAY
    columns = np.empty((PROBE_ROWS, elements, whole, BLOCK))
    for first in range(0, whole, CHUNK):
        end = min(first + CHUNK, whole)
        probes = np.empty((end - first, elements, PROBE_ROWS, BLOCK))
        part = None if waves is None else waves[first * BLOCK : end * BLOCK]
        fill_conditions(blocks[first * RAY : end * RAY], probes, lens.completed, part)
        columns[:, :, first:end] = probes.transpose(2, 1, 0, 3)
    rays = columns.reshape(PROBE_ROWS, elements, -1)[:, :, :n]
    codes = blocks.reshape(-1, RAY)[:, STATUS:].reshape(-1)[:n].astype(np.int64)
    cancellation = rays[ROUNDED_LENGTH] / sizes(lens)[:, None]
    return ProbeRecords(lens, rays[INCIDENCE], rays[REFRACTION], cancellation, rays[NEWTON], rays[STEPS], codes)


def sizes(lens: LensRecord) -> Floats:
    """Semi-diameters in mm; for elements limited by depth or unlimited, the radius or focal length."""
    squared, curvature = lens.rows["semi_diameter2"], lens.rows["curvature"]
    with np.errstate(divide="ignore"):
        return np.asarray(np.where(np.isfinite(squared), np.sqrt(squared), 1.0 / np.abs(curvature)))


def kinds(lens: LensRecord) -> tuple[str, ...]:
    """Name of the element of each row."""
    names = {CONIC: "conic", ASPHERE: "asphere", FREEFORM: "freeform", IDEAL: "ideal lens"}
    of_spheres = ("sphere" if c else "plane" for c in lens.rows["curvature"])
    shapes = zip(lens.rows["kind"].tolist(), of_spheres, strict=True)
    return tuple(sphere if kind == SPHERE else names.get(kind, "stop") for kind, sphere in shapes)


def largest_and(typical: Callable[[Floats], Any], numbers: Floats) -> Floats:
    """(n, 2) from (n, rays): the largest number and the mean or median, without nan; nan if all are nan."""
    passing = (row[~np.isnan(row)] for row in numbers)
    pairs = [(row.max(), typical(row)) if len(row) else (math.nan, math.nan) for row in passing]
    return np.array(pairs).reshape(-1, 2)


def conditioning_of(records: ProbeRecords) -> Conditioning:
    """Conditioning for each element, from the records of rays."""
    is_hit = ~np.isnan(records.newton)
    return Conditioning(
        elements=records.lens.rows["surface_index"].copy(),
        kinds=kinds(records.lens),
        rays=len(records.codes),
        reached=is_hit.sum(axis=1),
        incidence=largest_and(np.median, records.incidence),
        refraction=largest_and(np.median, records.refraction),
        cancellation=largest_and(np.median, records.cancellation),
        newton=largest_and(np.mean, records.newton),
        search=largest_and(np.mean, records.search),
        searched=(records.search > 0).sum(axis=1),
        lost=lost_rays(np.bincount(records.codes)),
    )
