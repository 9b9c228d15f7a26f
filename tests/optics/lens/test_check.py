"""What `check()` reports: each finding is provoked, and published lenses show theirs."""

import math
import os
from pathlib import Path

import pytest

import plenoptic as pl
from plenoptic import CircularStop, ConstantMedium, LensStack, ModelGlass, Surface, load_lens
from plenoptic.optics import FindingKind
from plenoptic.optics.lens.checks.check import findings

SHARED = Path(os.environ["PLENOPTIC_SHARED"])
TABLES = {path.stem.split()[-1].split("_")[-1]: path for path in sorted((SHARED / "lenses").glob("*.csv"))}
GLASS = ConstantMedium(1.5)
STOP = CircularStop(3.0, 1.0)
REFERENCE = load_lens("double-gauss-100mm-f2")


def kinds(lens: LensStack, wavelength: float = 587.6) -> list[tuple[str, tuple[int, ...]]]:
    return [(finding.kind.name, tuple(finding.elements)) for finding in findings(lens, wavelength)]


def test_most_bundled_lenses_are_clean():
    for name in pl.lens_names():
        if name[:7] not in ("fisheye", "asphere"):
            assert findings(load_lens(name)) == (), name
    # The fisheye goes to the equator twice. Printed so: 234.0 of 235.825 mm, and 110.1 of 111.094 mm.
    found = findings(load_lens("fisheye-100mm-f8"))
    assert [(f.kind, f.elements) for f in found] == [(FindingKind.EQUATOR, (1,)), (FindingKind.EQUATOR, (3,))]
    assert "99.2 %" in str(found[0])
    # Model and wavelength make no difference to a clean lens.
    for model in pl.LensModel:
        assert findings(REFERENCE.with_model(model), 450.0) == (), model
    assert REFERENCE.check() == () and str(REFERENCE.check()) == "no findings: nothing is implausible"
    # They print as sentences, one a line.
    assert str(found) == f"{found[0].message}\n{found[1].message}" == f"{found!r}"


PUBLISHED = {
    "p352": [("OVERLAP", (7, 8))],  # Mandler
    "p306": [("OVERLAP", (5, 6))],  # Merte: the surface behind the stop reaches through it
    "p160": [("OVERLAP", (3, 4)), ("OVERLAP", (5, 6)), ("OVERLAP", (16, 17))],  # Momiyama
    "p166": [("EQUATOR", (1,)), ("EQUATOR", (3,))],
    "p268": [("EQUATOR", (1,))],  # Asoma
    "p316": [("GLASS", (3, 6))],  # Altman: F4 twice, once with 1.817
    "p338": [("GLASS", (0,)), ("GLASS", (4,)), ("GLASS", (8,))],  # Hopkins: V-numbers of another range of wavelengths
}


@pytest.mark.skipif(not TABLES, reason="needs the shared lens tables")
def test_published_lenses_show_what_is_known_of_them():
    for page, path in TABLES.items():
        found = kinds(load_lens(path))
        if page == "p316":  # a bundled F4 would show the misprint by itself
            found = [item for item in found if item != ("GLASS", (6,))]
        assert found == PUBLISHED.get(page, []), page
    (mandler,) = findings(load_lens(TABLES["p352"]))
    # 4.94 mm apart on the axis, radii -86.39 and -34.48, at 22 mm.
    room = 4.94 - (34.48 - math.sqrt(34.48**2 - 22**2)) + (86.39 - math.sqrt(86.39**2 - 22**2))
    assert f"{room:.3g} mm of air" in str(mandler)
    (merte,) = findings(load_lens(TABLES["p306"]))
    through = (38.5 - math.sqrt(38.5**2 - 22.4**2)) - 7.0
    assert f"{through:.3g} mm through" in str(merte)


def glass(radius: float, gap: float, size: float, **shape) -> Surface:
    return Surface(radius, gap, GLASS, semi_diameter=size, **shape)


def air(radius: float, size: float, gap: float = 0.0, **shape) -> Surface:
    return Surface(radius, gap, semi_diameter=size, **shape)


def found_in(*elements, wavelength=587.6) -> list[tuple[str, tuple[int, ...]]]:
    return kinds(LensStack(elements), wavelength)


def test_surfaces_that_cross_or_come_close():
    # Two spheres of radius 10, 2 mm apart: they cross where 2 (10 - sqrt(100 - r^2)) = 2, r = sqrt(19) = 4.36.
    (found,) = findings(LensStack([STOP, glass(10.0, 2.0, 8.0), air(-10.0, 8.0)]))
    assert (found.kind, found.elements) == (FindingKind.OVERLAP, (1, 2))
    assert "cross 4.36 mm from the axis: at 8 mm there is -6 mm of glass" in found.message
    # Edges that are thin: half a sag of 1.26794919 (10 - sqrt(100 - 25) less 0.072) on each side.
    sag = 10.0 - math.sqrt(75.0)
    for edge, expected in ((0.06, []), (0.04, [("THIN_EDGE", (1, 2))]), (-0.01, [("OVERLAP", (1, 2))])):
        assert found_in(STOP, glass(10.0, 2 * sag + edge, 5.0), air(-10.0, 5.0)) == expected, edge
    # A smaller surface may go on to the edge, as in the Metrogon (p187): with a flat bevel the first lens would be
    # -0.1 mm thick at its edge.
    found = found_in(STOP, glass(16.44, 4.4, 15.5), air(19.72, 14.6))
    assert not {"OVERLAP", "THIN_EDGE"} & {kind for kind, _ in found}
    # A plane cannot: at 10 mm the front is 5.4 mm behind its vertex.
    assert ("OVERLAP", (1, 2)) in found_in(STOP, glass(12.0, 4.0, 10.0), air(math.inf, 5.0))
    # Aspheres cross by their shape.
    back = air(math.inf, 8.0, aspheric=(0.0, -5e-4))
    assert ("OVERLAP", (1, 2)) in found_in(STOP, glass(math.inf, 2.0, 8.0), back)
    assert found_in(STOP, glass(math.inf, 5.0, 8.0), back) == []


def test_lenses_that_touch_and_balls_are_no_finding():
    # Equal radii in contact, a biconvex lens that touches a plane, a ball and a hyper-hemisphere.
    biconvex, small = [STOP, glass(20.0, 4.0, 5.0), air(-20.0, 5.0)], CircularStop(1.0, 0.0)
    assert found_in(*biconvex, glass(math.inf, 2.0, 5.0), air(math.inf, 5.0)) == []
    assert found_in(*biconvex, glass(-20.0, 2.0, 5.0), air(-20.0, 5.0)) == []
    assert found_in(small, glass(5.0, 10.0, 5.0, depth=5.0), air(-5.0, 5.0, depth=5.0)) == []
    assert found_in(small, glass(5.0, 7.5, 5.0, depth=7.5), air(math.inf, 4.0)) == []


def test_a_surface_that_reaches_through_a_stop():
    # 5.36 mm of sag at 10 mm, 5 mm behind the stop, whose opening ends at 3 mm.
    lens = LensStack([CircularStop(3.0, 1.0), glass(-12.0, 2.0, 10.0), air(-14.0, 10.0)])
    (found,) = [f for f in findings(lens) if f.elements == (0, 1)]
    assert found.kind is FindingKind.OVERLAP and "reaches 4.37 mm through the plane of stop 0" in found.message
    assert ("OVERLAP", (1, 2)) in found_in(glass(14.0, 2.0, 10.0), air(12.0, 10.0, 1.0), CircularStop(3.0))


def test_surfaces_near_the_equator_and_steep_aspheres():
    for size, expected in ((9.8, []), (9.95, [("EQUATOR", (1,))])):
        assert found_in(CircularStop(1.0), glass(10.0, 14.0, size), air(math.inf, 9.0)) == expected, size
    # A slope of 4 a r^3 = 2 at the rim is 63.4 degrees; a sphere of that slope is no finding.
    asphere, back = glass(math.inf, 4.0, 5.0, aspheric=(0.0, 2.0 / 4 / 125)), air(math.inf, 5.0)
    (found,) = findings(LensStack([CircularStop(1.0), asphere, back]))
    assert (found.kind, found.elements) == (FindingKind.STEEP, (1,))
    assert "63.4 degrees 5 mm from the axis" in found.message
    assert found_in(CircularStop(1.0), glass(5.5, 4.0, 5.0), back) == []


def test_glasses_that_differ_from_their_name():
    mine = ModelGlass(1.617, 36.6, "MINE")
    infrared = pl.Sellmeier((1.5,), (0.01,), "INFRARED", (800.0, 2000.0))
    for *media, expected in (
        (ModelGlass(1.5168, 64.2, "N-BK7"), ModelGlass(1.673, 32.2, "SF5"), []),
        (ModelGlass(1.5368, 64.2, "N-BK7"), GLASS, [("GLASS", (1,))]),
        (ModelGlass(1.5168, 56.0, "N-BK7"), GLASS, [("GLASS", (1,))]),
        (mine, ModelGlass(1.817, 36.6, "MINE"), [("GLASS", (1, 2))]),
        (mine, ModelGlass(1.617, 46.6, "MINE"), [("GLASS", (1, 2))]),
        (mine, ModelGlass(1.618, 36.4, "MINE"), []),
        (ModelGlass(1.617, 36.6), ModelGlass(1.817, 36.6), []),
        (infrared, GLASS, []),
    ):
        plates = [Surface(50.0, 4.0, medium, semi_diameter=5.0) for medium in media]
        found = found_in(STOP, *plates, air(math.inf, 5.0), wavelength=900.0 if infrared in media else 587.6)
        assert found == expected, media


def test_an_iris_far_outside_and_an_image_inside_the_last_rim():
    # A focal length of 100 mm.
    for away, expected in ((90.0, []), (110.0, [("IRIS_FAR", (0,))])):
        assert found_in(CircularStop(3.0, away), glass(50.0, 4.0, 10.0), air(math.inf, 10.0)) == expected, away
    # In the glass the light meets 18 mm behind the front; the rear hollow shifts that to 1 / (1.5 / 2 - 0.5 / 4) = 1.6
    # mm behind its vertex, and its rim reaches 4 - sqrt(4^2 - 3.9^2) = 3.11 mm.
    found = findings(LensStack([CircularStop(1.0), glass(6.0, 16.0, 3.0), air(4.0, 3.9)]))
    (inside,) = [finding for finding in found if finding.kind is FindingKind.IMAGE_INSIDE]
    assert "1.6 mm behind" in inside.message and "3.111 mm" in inside.message


def test_an_iris_that_is_not_filled():
    lens = glass(50.0, 4.0, 5.0), air(math.inf, 5.0)
    assert found_in(CircularStop(5.2, 1.0), *lens) == []  # 96 %
    (found,) = findings(LensStack([CircularStop(10.0, 1.0), *lens]))
    assert (found.kind, found.elements) == (FindingKind.IRIS_NOT_FILLED, (0, 1))
    assert "fills 50 % of the iris's semi-diameter, 10 mm" in found.message
    # Of a polygon, what counts is the distance of its edges.
    assert found_in(pl.PolygonStop(6, 5.2 / math.cos(math.pi / 6), thickness=1.0), *lens) == []
    # An objective that collimates is lit from its front focus. 2 x f = 100 mm, 150 mm apart: f = 200 mm, and the rear
    # focus lies 100 mm before the last lens, the front one 100 mm behind the first. Light from infinity would fill the
    # iris at the last lens to a half of its opening.
    half = glass(50.0, 3.0, 10.0), air(math.inf, 10.0, 148.0)
    assert found_in(*half, *half, CircularStop(9.0)) == []


def test_beams_and_chief_rays_that_are_totally_reflected():
    # Parallel light in glass of 1.5 meets the rear sphere at sin i = r / 10: beyond 10 / 1.5 mm it cannot leave.
    lens = glass(math.inf, 12.0, 9.0), air(-10.0, 9.0)
    beams = [f for f in findings(LensStack([CircularStop(8.0, 1.0), *lens])) if "beam from infinity" in f.message]
    assert [(finding.kind, finding.elements) for finding in beams] == [(FindingKind.TOTAL_REFLECTION, (2,))]
    assert f"fill {100 * 10 / 1.5 / 8:.0f} %" in beams[0].message
    assert not any("beam" in f.message for f in findings(LensStack([CircularStop(6.0, 1.0), *lens])))
    # From a stop in glass, 20 mm before a plane: beyond arcsin(1 / 1.5) = 41.8 degrees nothing leaves.
    inside = CircularStop(1.0, 20.0), air(math.inf, 100.0)
    found = findings(LensStack([glass(math.inf, 20.0, 100.0), *inside]))
    assert [(f.kind.name, f.elements) for f in found] == [("TOTAL_REFLECTION", (0,)), ("TOTAL_REFLECTION", (2,))]
    # Rays are tried in steps of 88 / 512 = 0.17 degrees.
    assert "at more than 41.9 degrees" in found[0].message
    # Where a rim in front lets 0.3 rad in glass through and no more, they are not asked for.
    assert found_in(glass(math.inf, 20.0, 20.0 * math.tan(0.3)), *inside) == []


def test_elements_moved_through_each_other_are_found():
    moves = (slice(0, 2), (0, 0, 20), (0, 0, 0)), (slice(0, 2), (0, 30, 0), (0, 0, 0))
    small = (slice(0, 2), (0, 0, 0), (0.004, 0, 0)), (slice(0, 5), (0.3, 0, 0), (0, 0, 0))
    for which, shift, tilt in (*moves, *small):
        found = {kind for kind, _ in kinds(REFERENCE.moved(which, shift=shift, tilt=tilt))}
        assert ("OVERLAP" in found) == ((which, shift, tilt) in moves), (which, shift, tilt)
    assert "OVERLAP" in {kind for kind, _ in kinds(load_lens("singlet-100mm-f4").moved([1, 2], shift=(0, 0, -30)))}
    # A lens may pass nothing.
    for shift, expected in ((60.0, True), (10.0, False)):
        found = kinds(REFERENCE.moved(5, shift=(0, shift, 0)))
        assert ("NO_LIGHT" in {kind for kind, _ in found}) == expected, shift
