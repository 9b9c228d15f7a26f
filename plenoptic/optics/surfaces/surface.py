"""A surface of a lens: a plane, a sphere, a conic or an even asphere, with an optional freeform term."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.values import (
    SMALLEST_LENGTH,
    Floats,
    broadcast,
    coefficients,
    finite,
    length_in_mm,
    numbers,
    set_field,
    value,
)
from plenoptic.errors import PrescriptionError
from plenoptic.optics.coatings.coating import Reflectance, SurfaceCoating
from plenoptic.optics.coatings.surface_powers import check_coating
from plenoptic.optics.element_record import ASPHERE, CONIC, FREEFORM, SPHERE, ElementRow
from plenoptic.optics.glass.media import AIR, Medium, check_medium
from plenoptic.optics.lens.placement import Placement, set_place
from plenoptic.optics.surfaces.freeform_registry import FREEFORM_TERMS, FreeformTerm
from plenoptic.optics.surfaces.mirror import Mirror
from plenoptic.optics.surfaces.radius import signed_radius
from plenoptic.optics.surfaces.sag_bounds import asphere_bounds

STEEPEST_ASPHERE = 100.0
"""Largest slope of a rim, 89.4 degrees. Real slopes are far smaller; steep rims need many steps of intersection
search."""

EQUATOR_TOLERANCE = 1e-12
"""Tolerance with which the equator itself belongs to the surface."""


@value
class Surface:
    r"""A surface of revolution, with an optional freeform term and the gap and the medium that follow it.

    .. math:: z = \frac{c r^2}{1 + \sqrt{1 - (1 + k) c^2 r^2}} + \sum_i a_i r^{2 i + 2}

    Parameters
    ----------
    radius : float
        Radius of curvature 1/c in mm; positive when the centre lies at +z (convex towards the scene). `math.inf` is
        a plane; so is -inf, which is stored as inf.
    thickness : float, optional
        Axial gap to the next element in mm, at least 0.
    medium : Medium, optional
        Medium of that gap; `optics.MIRROR`: the surface reflects, see `optics.Mirror`.
    semi_diameter : float
        Half of the free diameter in mm, above 0 and not beyond the equator of the sphere or ellipsoid. Keyword only,
        required.
    conic : float, optional
        Conic constant k: 0 a sphere, -1 a paraboloid, below -1 a hyperboloid, otherwise an ellipsoid.
    aspheric : sequence of float, optional
        Coefficients a_0, a_1, ... of r^2, r^4, r^6 and so on, in mm^-1, mm^-3, mm^-5: the first is mostly 0.
    depth : float, optional
        For a sphere or ellipsoid that extends beyond its equator (hyper-hemispheres, balls): distance of its rim from
        the vertex along the axis, in mm. `semi_diameter` is then that of the equator. None: the surface ends at the
        semi-diameter, on the vertex's side of the equator.
    freeform : ZernikeSag, BiconicSag or OddPowerSag, optional
        Freeform term: a sag that is added to the conic or asphere. None: no term. A biconic or a cylinder is a
        BiconicSag on a plane.
    placement : Placement, optional
        Decentre and tilt; see `LensStack.moved`. None: centred.
    coating : SingleLayer, Coating or Reflectance, optional
        Coating against reflections; see `coated`. None: bare glass. In a lens without any coating no light is lost. On
        a mirror, the `Reflectance` of its metal; None: it reflects all light.

    Raises
    ------
    InvalidValueError
        PrescriptionError for a radius of 0 or nan, a negative gap, a semi-diameter or depth beyond the surface, a
        medium without an index, or films on a mirror; its base class for numbers that are not finite.

    Examples
    --------
    >>> import plenoptic as pl
    >>> front = pl.Surface(58.95, thickness=7.52, medium=pl.ModelGlass(1.670, 47.1), semi_diameter=25.2)
    >>> front.curvature == 1 / 58.95
    True
    >>> mirror_like = pl.Surface(100.0, semi_diameter=30.0, conic=-1.0, aspheric=(0.0, 1e-8))
    >>> round(float(mirror_like.sag(10.0)), 6)            # 10^2 / 200 + 1e-8 10^4
    0.5001
    >>> pl.Surface(10.0, semi_diameter=12.0)
    Traceback (most recent call last):
    ...
    plenoptic.errors.PrescriptionError: semi_diameter 12 mm exceeds the radius of curvature 10 mm; ...
    """

    radius: float
    thickness: float = 0.0
    medium: Medium = AIR
    semi_diameter: float = dataclasses.field(kw_only=True)
    conic: float = dataclasses.field(default=0.0, kw_only=True)
    aspheric: Sequence[float] = dataclasses.field(default=(), kw_only=True)
    depth: float | None = dataclasses.field(default=None, kw_only=True)
    freeform: FreeformTerm | None = dataclasses.field(default=None, kw_only=True)
    placement: Placement | None = dataclasses.field(default=None, kw_only=True)
    coating: SurfaceCoating | None = dataclasses.field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        set_field(self, "radius", signed_radius(self.radius, "radius"))
        set_place(self)
        if self.thickness < 0:
            raise PrescriptionError(
                f"thickness is {self.thickness:g} mm; the gap to the next element must be at least 0: "
                "list the elements in the order of the light path"
            )
        set_field(self, "conic", finite(self.conic, "conic"))
        set_field(self, "aspheric", self._checked_coefficients())
        if self.semi_diameter > self.equator:
            limit = "radius of curvature" if self.conic == 0 else "semi-axis of the ellipsoid,"
            raise PrescriptionError(
                f"semi_diameter {self.semi_diameter:g} mm exceeds the {limit} {self.equator:g} mm; "
                f"reduce it to {self.equator:g} or less"
            )
        if not (self.freeform is None or isinstance(self.freeform, FREEFORM_TERMS)):
            kinds = " or ".join(kind.__name__ for kind in FREEFORM_TERMS) or "None"
            raise PrescriptionError(f"freeform is {self.freeform!r}; it must be {kinds}")
        if self.freeform is not None and not np.isfinite(self.freeform.bounds(self.semi_diameter)).all():
            raise PrescriptionError(
                f"freeform {self.freeform!r} has no finite sag and slope up to the semi-diameter "
                f"{self.semi_diameter:g} mm; correct it"
            )
        if self.depth is not None:
            set_field(self, "depth", self._checked_depth(self.depth))
        check_medium(self.medium, "medium")
        check_coating(self.coating)
        if isinstance(self.medium, Mirror) and not (self.coating is None or isinstance(self.coating, Reflectance)):
            raise PrescriptionError(
                f"coating of a mirror is {self.coating!r}; it must be a pl.optics.Reflectance, that of its metal"
            )

    def _checked_coefficients(self) -> tuple[float, ...]:
        terms = list(coefficients(self.aspheric, "aspheric", "a sequence of coefficients, of r^2 first"))
        while terms and terms[-1] == 0:
            terms.pop()
        if not terms:
            return ()
        edge, powers = self.semi_diameter, 2.0 * np.arange(len(terms)) + 2.0
        with np.errstate(over="ignore", invalid="ignore"):
            slopes = (edge * np.linspace(0.0, 1.0, 65)[:, None]) ** (powers - 1.0) @ (powers * terms)
        slope = float(np.abs(slopes).max())
        if not slope <= STEEPEST_ASPHERE:
            raise PrescriptionError(
                f"aspheric {tuple(terms)} gives slopes of {slope:.3g} at the semi-diameter {edge:g} mm; they must "
                f"be at most {STEEPEST_ASPHERE:g}: the first coefficient is that of r^2, in 1/mm"
            )
        return tuple(terms)

    def _checked_depth(self, depth: float) -> float:
        rim = length_in_mm(depth, "depth")
        pole = abs(self.radius) / (1.0 + self.conic) if self.conic > -1 else math.inf
        if self.aspheric or self.freeform is not None or not math.isfinite(pole):
            raise PrescriptionError(
                f"depth is {rim:g} mm on a surface without equator; spheres and ellipsoids have one: leave it out"
            )
        if not (pole <= rim <= 2 * pole) or self.semi_diameter != self.equator:
            raise PrescriptionError(
                f"depth is {rim:g} mm and semi_diameter {self.semi_diameter:g} mm; a surface that goes beyond its "
                f"equator has a depth from {pole:g} to {2 * pole:g} and a semi_diameter of {self.equator:g}"
            )
        return rim

    @property
    def curvature(self) -> float:
        """Reciprocal of the radius in 1/mm, 0 for a plane."""
        return 1.0 / self.radius

    @property
    def vertex_curvature(self) -> float:
        """Curvature at the vertex in 1/mm for paraxial rays, including the r^2 term.

        For a freeform surface the mean over all directions.
        """
        freeform = 0.0 if self.freeform is None else self.freeform.vertex.curvature
        return self.curvature + (2.0 * self.aspheric[0] if self.aspheric else 0.0) + freeform

    def signed_index(self, behind: float) -> float:
        """Index behind the surface in the sign convention of refraction formulas: negative for a mirror in a medium."""
        return -behind if isinstance(self.medium, Mirror) else behind

    @property
    def from_behind(self) -> Surface:
        """The surface as described in the frame behind it: a mirror reflected in its own plane, others unchanged."""
        if not isinstance(self.medium, Mirror):
            return self
        term, placement = self.freeform, self.placement
        if placement is not None:
            unfolding, flip = self.medium.unfolding, np.diag([1.0, 1.0, -1.0])
            shift, rotation = np.asarray(placement.shift), np.asarray(placement.rotation)
            placement = Placement(unfolding @ shift, unfolding @ rotation @ flip)
        return dataclasses.replace(
            self,
            radius=-self.radius,
            aspheric=tuple(-a for a in self.aspheric),
            freeform=None if term is None else term.inverted,
            placement=placement,
        )

    def rescale(self, factor: float) -> Surface:
        """The surface with all lengths times a factor above 0; the gap and the placement stay."""
        # The limits of the semi-diameter must not be missed by rounding.
        bare = Surface(factor * self.radius, semi_diameter=SMALLEST_LENGTH, conic=self.conic)
        return dataclasses.replace(
            self,
            radius=bare.radius,
            semi_diameter=bare.equator if self.depth is not None else min(factor * self.semi_diameter, bare.equator),
            aspheric=tuple(a / factor ** (2 * i + 1) for i, a in enumerate(self.aspheric)),
            depth=None if self.depth is None else factor * self.depth,
            freeform=None if self.freeform is None else self.freeform.rescale(factor),
        )

    def row(self) -> ElementRow:
        """Record of the surface for kernels."""
        max_depth, semi_diameter2 = 1.0 + EQUATOR_TOLERANCE, self.semi_diameter * self.semi_diameter
        if self.depth is not None:
            # Only the depth limits a surface that extends beyond its equator.
            max_depth = abs(self.curvature) * (1.0 + self.conic) * self.depth + EQUATOR_TOLERANCE
            semi_diameter2 = math.inf
        row = ElementRow(SPHERE, semi_diameter2, self.curvature, max_depth, self.conic)
        if self.aspheric or self.freeform is not None:
            terms = tuple(self.aspheric) or (0.0,)
            bounds = asphere_bounds(self.curvature, self.conic, terms, self.semi_diameter)
            row = row._replace(kind=ASPHERE, aspheric=(*bounds, *terms))
            if self.freeform is None:
                return row
            freeform_bounds = self.freeform.bounds(self.semi_diameter)
            return row._replace(kind=FREEFORM, freeform=(*freeform_bounds, *self.freeform.numbers()))
        return row if self.conic == 0 or self.curvature == 0 else row._replace(kind=CONIC)

    @property
    def osculating(self) -> Surface:
        """Osculating sphere or plane at the vertex."""
        if not self.conic and not self.aspheric and self.freeform is None:
            return self
        radius = 1.0 / self.vertex_curvature if self.vertex_curvature else math.inf
        size = min(self.semi_diameter, abs(radius))
        return Surface(
            radius, self.thickness, self.medium, semi_diameter=size, placement=self.placement, coating=self.coating
        )

    @property
    def equator(self) -> float:
        """Distance from the axis in mm beyond which the sphere or ellipsoid has no points; inf for other conics."""
        return abs(self.radius) / math.sqrt(1.0 + self.conic) if self.conic > -1 else math.inf

    def sag(self, r: ArrayLike, y: ArrayLike | None = None) -> Floats:
        """Sag z in mm from the vertex plane, of the shape of `r`; that of a sphere has the sign of the curvature.

        `r` is the distance from the axis in mm, or x if `y` is given or the surface is freeform; `y` is 0 if omitted.
        PrescriptionError beyond the equator; the semi-diameter is no limit.

        Examples
        --------
        >>> import plenoptic as pl
        >>> round(float(pl.Surface(5.0, semi_diameter=4.0).sag(3.0)), 12)
        1.0
        """
        x, across = broadcast(r=r, y=0.0 if y is None else y)
        distance = np.abs(x) if y is None else np.hypot(x, across)
        if not np.all(distance <= self.equator):
            raise PrescriptionError(
                f"r reaches {np.max(distance):g} mm, where the surface of radius {self.radius:g} mm has no "
                f"point; stay within {self.equator:g} mm"
            )
        height = self._conic_sag(distance)
        for i, a in enumerate(self.aspheric):
            height = height + a * distance ** (2 * i + 2)
        return height if self.freeform is None else height + self.freeform.sag(x, across)

    def _conic_sag(self, distance: Floats) -> Floats:
        # The radius, in place of the curvature, is exact at the equator, too. Separate roots, and all lengths over 4,
        # which is exact, avoid overflow of squares and sums.
        size, out = abs(self.radius) / 4, distance / 4
        if math.isinf(size):
            return np.zeros_like(distance)
        if self.conic > -1:
            scaled = np.minimum(out * math.sqrt(1.0 + self.conic), size)
            depth = size + np.sqrt(size - scaled) * np.sqrt(size + scaled)
        else:
            depth = size + np.hypot(size, out * math.sqrt(-1.0 - self.conic))
        return np.asarray(np.copysign(distance * (out / depth), self.radius))

    def slope(self, r: ArrayLike) -> Floats:
        """Slope dz/dr, the tangent of the angle to the vertex plane, at distances r from the axis in mm.

        Of the shape of `r`, infinite at the equator and a PrescriptionError beyond it; without the freeform term.

        Examples
        --------
        >>> import plenoptic as pl
        >>> round(float(pl.Surface(5.0, semi_diameter=4.0).slope(3.0)), 12)
        0.75
        """
        distance = numbers(r, "r")
        dataclasses.replace(self, freeform=None).sag(distance)
        steep = distance * self.curvature
        with np.errstate(divide="ignore"):
            angle = np.asarray(steep / np.sqrt(np.maximum(1.0 - (1.0 + self.conic) * steep * steep, 0.0)))
        for i, a in enumerate(self.aspheric):
            angle = angle + (2 * i + 2) * a * distance ** (2 * i + 1)
        return angle

    def gradient(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """(2, ...) derivatives of the sag with respect to x and y at points (x, y), mm.

        Examples
        --------
        >>> import plenoptic as pl
        >>> pl.Surface(5.0, semi_diameter=4.0).gradient(0.0, 3.0).round(12).tolist()
        [0.0, 0.75]
        """
        along = np.stack(broadcast(x=x, y=y))
        r = np.hypot(*along)
        slope = self.slope(r) / np.where(r > 0, r, 1.0) * along
        return np.asarray(slope if self.freeform is None else slope + self.freeform.gradient(*along))
