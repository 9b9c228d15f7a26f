"""Checks of a lens for implausible properties of its prescription."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.progress.bar import CallProgress
from plenoptic.core.values import Floats, check_kind, positive
from plenoptic.errors import InvalidValueError
from plenoptic.optics.glass.bundled import glass
from plenoptic.optics.glass.media import D_LINE, Medium, abbe_number
from plenoptic.optics.lens.checks.finding import Finding, FindingKind, Findings
from plenoptic.optics.lens.checks.rays import condition_findings, ray_findings
from plenoptic.optics.lens.elements import Element, is_glass
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points
from plenoptic.optics.lens.placement import to_lens_axes
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.surfaces.surface import Surface

_PLACES = 257
"""Number of distances from the axis at which the gap between two surfaces is tested."""
_THIN = 0.01
_TILTED = 1e-3
"""Largest slopes that Gaussian optics may neglect, at the vertex and at the rim."""
_NEAR_EQUATOR = 0.99
_AZIMUTHS = np.linspace(0.0, 2.0 * math.pi, 24, endpoint=False)
_OTHER_SIZE = 0.01
_STEEPEST = math.tan(math.radians(60.0))
_INDEX_TOLERANCE, _ABBE_TOLERANCE = 0.01, 0.10


def findings(lens: LensStack, wavelength: float = 587.6) -> Findings:
    """Findings about a lens; see `FindingKind` for the checks.

    Findings are no errors: the lens can be traced. Rays of `wavelength` in nm are traced through all surfaces, whatever
    `LensStack.model`. The order is by kind, then by element.
    """
    check_kind(lens, "lens", LensStack, 'pl.load_lens("double-gauss-100mm-f2")')
    wave = positive(wavelength, "wavelength", "nm")
    lens.indices(wave)
    with CallProgress("checking", kind="lens", show=True), np.errstate(all="ignore"):  # numbers may over- or underflow
        by_prescription = (_edges, _collisions, _stop_planes, _shapes, _glass_numbers, _aperture)
        all_findings = [finding for check in by_prescription for finding in check(lens)]
        all_findings += [*_positions(lens, wave), *ray_findings(lens, wave)]
        reflecting = {i for each in all_findings if each.kind is FindingKind.TOTAL_REFLECTION for i in each.elements}
        all_findings += condition_findings(lens, wave, leave_out=reflecting)
    return Findings(sorted(all_findings, key=lambda finding: (finding.kind, finding.elements)))


def overlaps(lens: LensStack) -> Iterator[Finding]:
    """Findings about neighbouring elements that cross, without tracing."""
    return (each for check in (_edges, _collisions) for each in check(lens) if each.kind is FindingKind.OVERLAP)


def _surfaces(lens: LensStack) -> list[tuple[int, Surface]]:
    return [(i, element) for i, element in enumerate(lens.elements) if isinstance(element, Surface)]


def _sag_around(surface: Surface, r: ArrayLike) -> Floats:
    """Sag at distances from the axis, (azimuths, n); a surface of revolution has one azimuth."""
    r = np.atleast_1d(r)
    if surface.freeform is None:
        return surface.sag(r)[None]
    return surface.sag(np.outer(np.cos(_AZIMUTHS), r), np.outer(np.sin(_AZIMUTHS), r))


def _rim_depth(surface: Surface) -> Floats:
    """Axial position of the rim relative to the vertex, (azimuths,)."""
    if surface.depth is not None:
        return np.array([math.copysign(surface.depth, surface.radius)])
    return np.asarray(_sag_around(surface, surface.semi_diameter)[:, 0])


def _edges(lens: LensStack) -> Iterator[Finding]:
    """Neighbouring surfaces that cross, and lenses with thin edges."""
    z = lens.vertices
    for (i, front), (j, rear) in pairwise(_surfaces(lens)):
        between = "glass" if is_glass(lens, i + 1) else "air"
        if front.from_behind.placement != rear.placement:
            continue  # tested by _collisions
        gap = float(z[j] - z[i])
        r = np.linspace(0.0, min(front.semi_diameter, rear.semi_diameter), _PLACES)
        room = (gap + _sag_around(rear, r) - _sag_around(front.from_behind, r)).min(axis=0)
        closes = room < -1e-9 * (gap + r[-1])  # surfaces may touch
        if closes.any():
            k = int(np.argmax(closes))
            crossing = r[k] - (r[k] - r[k - 1]) * room[k] / (room[k] - room[k - 1]) if k else 0.0
            deepest = int(np.argmin(room))
            message = (
                f"surfaces {i} and {j} cross {crossing:.3g} mm from the axis: at {r[deepest]:.4g} mm there is "
                f"{room[deepest]:.3g} mm of {between} between them; reduce a semi-diameter"
            )
            yield Finding(FindingKind.OVERLAP, (i, j), message)
        elif between == "glass":
            yield from _thin_edge(i, front.from_behind, j, rear, gap)


def _thin_edge(i: int, front: Surface, j: int, rear: Surface, gap: float) -> Iterator[Finding]:
    outermost = max(front.semi_diameter, rear.semi_diameter)
    # Beyond the smaller surface the edge is a flat bevel or continues the sag: take the thicker one.
    edge = float((gap + _rim_depth(rear) - _rim_depth(front)).min())
    if outermost <= min(front.equator, rear.equator):
        edge = max(edge, gap + float((_sag_around(rear, outermost) - _sag_around(front, outermost)).min()))
    smallest = 0.0 if front.depth is not None or rear.depth is not None else _THIN * outermost
    if edge < smallest:
        kind = FindingKind.THIN_EDGE if edge >= 0 else FindingKind.OVERLAP
        message = (
            f"the lens between surfaces {i} and {j} is {edge:.3g} mm thick at its edge, {outermost:.4g} mm from the "
            f"axis, where it should be at least {smallest:.3g} mm; reduce a semi-diameter or make it thicker"
        )
        yield Finding(kind, (i, j), message)


def _collisions(lens: LensStack) -> Iterator[Finding]:
    """Neighbours that intersect and are decentred or tilted against each other, on a grid over the first one."""
    for i, j in pairwise(range(len(lens.elements))):
        first, second = lens.elements[i], lens.elements[j]
        if first.placement == second.placement:
            continue
        rear_view = first.from_behind if isinstance(first, Surface) else first
        points = _points_on(rear_view) + np.array([0.0, 0.0, lens.vertices[i]])
        local = _axes_of(second, points, float(lens.vertices[j]))
        r = np.hypot(local[:, 0], local[:, 1])
        inside = r <= (second.semi_diameter if isinstance(second, Surface) else math.inf)
        if isinstance(second, Surface):
            ahead = _sag_at(second, local[:, 0], local[:, 1]) - local[:, 2]
        else:
            # A stop blocks outside its opening.
            inside, ahead = ~second.contains(local[:, 0], local[:, 1]), -local[:, 2]
        if not inside.any():
            if isinstance(second, Surface):
                yield Finding(FindingKind.OVERLAP, (i, j), f"elements {i} and {j} lie side by side; move one back")
        elif float(ahead[inside].min()) < -1e-9 * float(np.abs(points).max()):
            message = (
                f"element {i} reaches up to {-float(ahead[inside].min()):.3g} mm through element {j}, one of which is "
                "out of place; reduce its shift or tilt"
            )
            yield Finding(FindingKind.OVERLAP, (i, j), message)


def _sag_at(surface: Surface, x: Floats, y: Floats) -> Floats:
    """Sag in mm at points; beyond the semi-diameter the sag of the rim."""
    r = np.hypot(x, y)
    within = np.minimum(r, surface.semi_diameter)
    if surface.freeform is None:
        return surface.sag(within)
    scale = within / np.where(r > 0, r, 1.0)
    return dataclasses.replace(surface, freeform=None).sag(within) + surface.freeform.sag(scale * x, scale * y)


def _points_on(element: Element) -> Floats:
    """Points (n, 3) on a surface or on the plane of a stop, in the lens's axes, relative to the element's nominal
    vertex.
    """
    across = np.linspace(-1.0, 1.0, 41) * element.semi_diameter
    x, y = (g.ravel() for g in np.meshgrid(across, across))
    inside = np.hypot(x, y) <= element.semi_diameter
    x, y = x[inside], y[inside]
    z = _sag_at(element, x, y) if isinstance(element, Surface) else np.zeros_like(x)
    return to_lens_axes(element.placement, np.column_stack([x, y, z]))


def _axes_of(element: Element, points: Floats, z: float) -> Floats:
    """Points of the lens frame in the axes of an element with nominal vertex at z."""
    local = points - [0.0, 0.0, z]
    if element.placement is not None:
        local = (local - element.placement.shift) @ element.placement.rotation
    return np.asarray(local)


def _stop_planes(lens: LensStack) -> Iterator[Finding]:
    """Surfaces that intersect the plane of a neighbouring stop outside its opening."""
    z = lens.vertices
    for i, j in pairwise(range(len(lens.elements))):
        first, second = lens.elements[i], lens.elements[j]
        # A stop behind the vertex of the next surface clips rays as they would go on without that surface.
        if isinstance(first, Surface) == isinstance(second, Surface) or z[j] < z[i]:
            continue
        stop, surface, side = (second, first, -1.0) if isinstance(first, Surface) else (first, second, 1.0)
        if not isinstance(surface, Surface) or surface.semi_diameter <= stop.semi_diameter:
            continue
        surface = surface.from_behind if side < 0 else surface
        r = np.linspace(stop.semi_diameter, surface.semi_diameter, _PLACES)
        room = (float(z[j] - z[i]) + side * _sag_around(surface, r)).min(axis=0)
        if room.min() < 0:
            at, plane = (i, j) if side < 0 else (j, i)
            message = (
                f"surface {at}, of semi-diameter {surface.semi_diameter:.4g} mm, reaches {-room.min():.3g} mm through "
                f"the plane of stop {plane}, whose opening ends at {stop.semi_diameter:.4g} mm; reduce the "
                "semi-diameter or move the stop"
            )
            yield Finding(FindingKind.OVERLAP, (i, j), message)


def _shapes(lens: LensStack) -> Iterator[Finding]:
    """Surfaces that extend nearly to their equator, and steep aspheres."""
    for i, surface in _surfaces(lens):
        if surface.depth is None and surface.semi_diameter > _NEAR_EQUATOR * surface.equator:
            message = (
                f"surface {i} has a semi-diameter of {surface.semi_diameter:.5g} mm, "
                f"{100 * surface.semi_diameter / surface.equator:.1f} % of its equator's {surface.equator:.5g} mm, "
                "where it runs parallel to the axis; reduce it"
            )
            yield Finding(FindingKind.EQUATOR, (i,), message)
        if surface.freeform is not None:
            yield from _vertex(i, surface)
        if surface.aspheric or surface.freeform is not None:
            r = np.linspace(0.0, surface.semi_diameter, _PLACES)
            azimuths = _AZIMUTHS if surface.freeform is not None else np.zeros(1)
            gradient = surface.gradient(np.outer(np.cos(azimuths), r), np.outer(np.sin(azimuths), r))
            slopes = np.hypot(*gradient).max(axis=0)
            if slopes.max() > _STEEPEST:
                at = surface.semi_diameter * float(np.argmax(slopes)) / (_PLACES - 1)
                message = (
                    f"the aspheric surface {i} has a slope of {math.degrees(math.atan(slopes.max())):.1f} degrees "
                    f"{at:.4g} mm from the axis; above 60 degrees it can hardly be made: check its coefficients"
                )
                yield Finding(FindingKind.STEEP, (i,), message)


def _vertex(i: int, surface: Surface) -> Iterator[Finding]:
    """Surfaces with tilt or astigmatism at the vertex, which Gaussian data neglect."""
    assert surface.freeform is not None
    shape = surface.freeform.vertex
    tilt, split = math.hypot(shape.dx, shape.dy), math.hypot(0.5 * (shape.dxx - shape.dyy), shape.dxy)
    if tilt > _TILTED or split * surface.semi_diameter > _TILTED:
        message = (
            f"surface {i} is tilted by {1e3 * math.atan(tilt):.3g} mrad at its vertex, where its curvatures differ by "
            f"up to {split:.3g} 1/mm from their mean; Gaussian data assume an untilted surface of the mean "
            "curvature: check with real rays"
        )
        yield Finding(FindingKind.VERTEX, (i,), message)


def _glass_numbers(lens: LensStack) -> Iterator[Finding]:
    """Glasses that differ from the bundled glass of the same name, or from each other."""
    by_name: dict[str, list[tuple[int, float, float]]] = {}
    for i, surface in _surfaces(lens):
        name = getattr(surface.medium, "name", "")
        if isinstance(name, str) and name:
            numbers = _nd_vd(surface.medium)
            if numbers is not None and numbers not in [entry[1:] for entry in by_name.get(name, [])]:
                by_name.setdefault(name, []).append((i, *numbers))
    for name, entries in by_name.items():
        bundled = _nd_vd(name)
        sources: list[tuple[str, tuple[int, ...], tuple[float, float]]]
        sources = [(f"behind surface {i}", (i,), (nd, vd)) for i, nd, vd in entries]
        sources += [("as the bundled one of that name", (), bundled)] if bundled is not None else []
        for (place, first, (nd, vd)), (other_place, second, (other_nd, other_vd)) in combinations(sources, 2):
            if _differ((nd, vd), (other_nd, other_vd)):
                message = (
                    f"the glass {name[:40]} has n_d {nd:.4f} and V_d {vd:.2f} {place}, and {other_nd:.4f} and "
                    f"{other_vd:.2f} {other_place}; it may be a misprint, or another glass"
                )
                yield Finding(FindingKind.GLASS, first + second, message)


def _nd_vd(medium: Medium | str) -> tuple[float, float] | None:
    """Index nd and Abbe number of a medium, or of a bundled glass by name; None if unknown, or for the infrared."""
    try:
        material = glass(medium) if isinstance(medium, str) else medium
        return material.index(D_LINE), abbe_number(material)
    except InvalidValueError:
        return None


def _differ(one: tuple[float, float], other: tuple[float, float]) -> bool:
    dispersive = math.isfinite(one[1]) and math.isfinite(other[1])
    return abs(one[0] - other[0]) > _INDEX_TOLERANCE or (
        dispersive and abs(one[1] - other[1]) > _ABBE_TOLERANCE * other[1]
    )


def _positions(lens: LensStack, wavelength: float) -> Iterator[Finding]:
    """An iris far outside the lens, and an image inside it."""
    points, z = cardinal_points(lens, wavelength), lens.vertices
    (first, _), (last, rear) = _surfaces(lens)[0], _surfaces(lens)[-1]
    outside = max(float(z[first]), -float(z[last]))
    reach = max(float(z[last] - z[first]), abs(points.efl))
    if outside > reach:
        message = (
            f"the iris, element {lens.iris_index}, lies {outside:.4g} mm outside the lens, farther than the lens is "
            f"long and than its focal length, {points.efl:.4g} mm; check the gap"
        )
        yield Finding(FindingKind.IRIS_FAR, (lens.iris_index,), message)
    rim = float(_rim_depth(rear.from_behind).max())
    if 0 < points.bfl < rim:
        message = (
            f"the image of a far object lies {points.bfl:.4g} mm behind the vertex of the last surface, {last}, whose "
            f"rim reaches {rim:.4g} mm; reduce its semi-diameter"
        )
        yield Finding(FindingKind.IMAGE_INSIDE, (last,), message)


def _aperture(lens: LensStack) -> Iterator[Finding]:
    """An iris whose size differs from that in the lens file."""
    specification, size, iris = lens.specification, lens.stop.semi_diameter, (lens.iris_index,)
    if specification is None:
        return
    stated, stated_pupil = specification.stop_semi_diameter, specification.entrance_pupil_diameter
    message = f"the iris has a semi-diameter of {size:.4g} mm, but its file states "
    if stated is not None and abs(size - stated) > _OTHER_SIZE * stated:
        remedy = "which its system aperture overrides; load_lens(path, stop_size=pl.optics.StopSize.DIAMETER) uses it"
        yield Finding(FindingKind.APERTURE, iris, f"{message}{stated:.4g} mm, {remedy}")
    if stated_pupil is not None:
        points = cardinal_points(lens, specification.wavelengths[0])
        pupil, length = 2.0 * points.entrance_pupil_semi_diameter, abs(points.efl)
        if abs(pupil - stated_pupil) > _OTHER_SIZE * stated_pupil:
            request = f"an entrance pupil of {stated_pupil:.4g} mm (f/{length / stated_pupil:.3g}); its diameter is "
            remedy = "lens.with_stop() sets another iris"
            yield Finding(
                FindingKind.APERTURE, iris, f"{message}{request}{pupil:.4g} mm (f/{length / pupil:.3g}); {remedy}"
            )
