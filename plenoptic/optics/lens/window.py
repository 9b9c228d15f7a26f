"""Windows before a lens: flat and dome ports of a housing."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

from plenoptic.core.values import check_kind, coefficients, coordinate, length_in_mm
from plenoptic.errors import PrescriptionError
from plenoptic.optics.glass.media import Medium, check_medium
from plenoptic.optics.lens.checks.check import overlaps
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.surfaces.surface import Surface

_FIELD = 2.0
"""Tangent of the angle against the axis, 63 degrees, up to which a window without a stated size lets rays of the
entrance pupil pass."""
_DOME_FIELD = 0.9
"""The same for domes: largest semi-diameter over the radius."""


def window(
    lens: LensStack,
    thickness: float,
    medium: Medium,
    *,
    distance: float | None = None,
    tilt: Sequence[float] = (0.0, 0.0),
    radius: float | None = None,
    outside: Medium | None = None,
    semi_diameter: float | None = None,
) -> LensStack:
    """The lens behind a window: the flat port or the dome of a housing, the wall of a tank.

    The window is two surfaces before the elements of the lens. Windows behind each other are set one by one, the
    nearest to the lens first. The specification of the lens file is left out, since it describes the lens alone.

    Parameters
    ----------
    lens : LensStack
    thickness : float
        mm.
    medium : Medium
        Its glass, such as ``pl.glass("N-BK7")``.
    distance : float, optional
        Gap on the axis from the window to the first element of the lens, mm, at least 0. None, for domes only: the
        centre of the dome is the centre of the entrance pupil at 587.6 nm.
    tilt : (2,) sequence of float, optional
        About x, then y, in radians, about the point of the axis on the inner face.
    radius : float, optional
        Radius of the outer face of a dome in mm, above the thickness; the inner face has the same centre. None: flat.
    outside : Medium, optional
        Medium in front of the window, such as ``pl.glass("water")``; None: the `front_medium` of the lens, which is
        the medium behind the window.
    semi_diameter : float, optional
        Half of the free diameter of the outer face in mm; that of the inner face of a dome is in proportion to its
        radius. None: rays of the entrance pupil pass up to 63 degrees from the axis.

    Returns
    -------
    LensStack

    Raises
    ------
    PrescriptionError
        If a number is out of range, a flat window has no distance, the window would cut the lens, or the model of the
        lens is NONE.

    Examples
    --------
    >>> import plenoptic as pl
    >>> lens, glass, water = pl.load_lens("double-gauss-100mm-f2"), pl.glass("N-BK7"), pl.glass("water")
    >>> port = pl.optics.window(lens, 10.0, glass, distance=30.0, tilt=(0.1, 0.0), outside=water)
    >>> port
    <LensStack 'double-gauss-100mm-f2': 12 surfaces, 1 stop, 104.08 mm long, 2 elements out of place>
    >>> dome = pl.optics.window(lens, 5.0, glass, radius=120.0, outside=water)
    >>> round(float(dome.vertices[0]) + 120.0 - pl.paraxial.cardinal_points(lens).entrance_pupil, 9)
    0.0
    """
    check_kind(lens, "lens", LensStack, 'pl.load_lens("double-gauss-100mm-f2")')
    if lens.model is LensModel.NONE:
        raise PrescriptionError(
            "the model of the lens is NONE, which refracts no light; take lens.with_model(pl.LensModel.EXACT)"
        )
    thick, front = length_in_mm(thickness, "thickness"), lens.front_medium if outside is None else outside
    check_medium(medium, "medium")
    check_medium(front, "outside")
    outer = math.inf if radius is None else length_in_mm(radius, "radius")
    if not thick < outer:
        raise PrescriptionError(f"thickness {thick:g} mm reaches the centre of the dome of radius {outer:g} mm")
    gap = _gap(lens, outer - thick) if distance is None else coordinate(distance, "distance")
    if gap < 0:
        raise PrescriptionError(f"distance is {gap:g} mm; it must be at least 0")
    size = (
        _free_size(lens, thick + gap, outer) if semi_diameter is None else length_in_mm(semi_diameter, "semi_diameter")
    )
    inner_size = size if radius is None else size * (outer - thick) / outer
    faces = [
        Surface(outer, thick, medium, semi_diameter=size),
        Surface(outer - thick, gap, lens.front_medium, semi_diameter=inner_size),
    ]
    behind = dataclasses.replace(
        lens, elements=[*faces, *lens.elements], iris=lens.iris_index + 2, front_medium=front, specification=None
    )
    angles = coefficients(tilt, "tilt", "two angles in radians, about x and y")
    if len(angles) != 2:
        raise PrescriptionError(f"tilt is {tilt!r}; it must be two angles in radians, about x and y")
    if angles != (0.0, 0.0):
        behind = behind.moved(slice(0, 2), tilt=(*angles, 0.0), pivot=float(behind.vertices[1]))
    for finding in overlaps(behind):
        if finding.elements == (1, 2):
            raise PrescriptionError(f"the window cuts the lens: {finding.message}")
    return behind


def _gap(lens: LensStack, inner_radius: float) -> float:
    """Distance from the vertex of a dome around the entrance pupil to the first element, mm."""
    if math.isinf(inner_radius):
        raise PrescriptionError("distance is missing: a flat window needs its distance from the lens in mm")
    pupil, first = cardinal_points(lens).entrance_pupil, float(lens.vertices[0])
    gap = first - (pupil - inner_radius)
    if not 0.0 <= gap < math.inf:
        raise PrescriptionError(
            f"a dome of inner radius {inner_radius:g} mm around the entrance pupil at z = {pupil:g} mm would cut the "
            f"lens, which begins at z = {first:g} mm; take a larger radius, or name a distance"
        )
    return gap


def _free_size(lens: LensStack, depth: float, radius: float) -> float:
    """Semi-diameter in mm of the outer face at a distance before the lens that lets the field `_FIELD` pass."""
    points = cardinal_points(lens)
    pupil = points.entrance_pupil if math.isfinite(points.entrance_pupil) else 0.0
    size = _FIELD * max(depth + pupil - float(lens.vertices[0]), 0.0) + max(
        points.entrance_pupil_semi_diameter, lens.elements[0].semi_diameter
    )
    return min(size, _DOME_FIELD * radius)
