"""What `check()` reports: each finding is provoked, and published lenses show theirs."""

import math
import os
import pickle
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import plenoptic as pl
from plenoptic import CircularStop, ConstantMedium, LensStack, ModelGlass, Surface, load_lens
from plenoptic.errors import InvalidValueError
from plenoptic.optics import AIR, Finding, FindingKind
from plenoptic.optics.lens.checks.check import findings

SHARED = Path(os.environ["PLENOPTIC_SHARED"])
TABLES = {path.stem.split()[-1].split("_")[-1]: path for path in sorted((SHARED / "lenses").glob("*.csv"))}
GLASS = ConstantMedium(1.5)
STOP = CircularStop(3.0, 1.0)
REFERENCE = load_lens("double-gauss-100mm-f2")


def singlet(front: Surface, back: Surface, stop: CircularStop = STOP) -> LensStack:
    return LensStack([stop, front, back])


def kinds(lens: LensStack, wavelength: float = 587.6) -> list[tuple[str, tuple[int, ...]]]:
    return [(finding.kind.name, tuple(finding.elements)) for finding in findings(lens, wavelength)]


# ---- clean lenses ----


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
    assert REFERENCE.check() == ()


# ---- published lenses ----

PUBLISHED = {
    "p352": [("OVERLAP", (7, 8))],  # Mandler
    "p306": [("OVERLAP", (5, 6))],  # Merte: the surface behind the stop reaches through it
    "p160": [("OVERLAP", (3, 4)), ("OVERLAP", (5, 6)), ("OVERLAP", (16, 17))],  # Momiyama
    "p166": [("EQUATOR", (1,)), ("EQUATOR", (3,))],
    "p268": [("EQUATOR", (1,))],  # Asoma
    "p316": [("GLASS", (3, 6))],  # Altman: F4 twice, once with 1.817
    "p338": [("GLASS", (4,)), ("GLASS", (8,))],  # Hopkins: V-numbers of another range of wavelengths
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


# ---- each kind ----


def test_surfaces_that_cross():
    # Two spheres of radius 10, 2 mm apart: they cross where 2 (10 - sqrt(100 - r^2)) = 2, r = sqrt(19).
    lens = singlet(Surface(10.0, 2.0, GLASS, semi_diameter=8.0), Surface(-10.0, semi_diameter=8.0))
    (found,) = findings(lens)
    assert (found.kind, found.elements) == (FindingKind.OVERLAP, (1, 2))
    assert "cross 4.36 mm from the axis: at 8 mm there is -6 mm of glass" in found.message
    assert math.sqrt(19.0) == pytest.approx(4.36, abs=0.005)


@pytest.mark.slow
def test_aspheres_cross_by_their_shape():
    back = Surface(math.inf, semi_diameter=8.0, aspheric=(0.0, -5e-4))
    assert ("OVERLAP", (1, 2)) in kinds(singlet(Surface(math.inf, 2.0, GLASS, semi_diameter=8.0), back))
    assert kinds(singlet(Surface(math.inf, 5.0, GLASS, semi_diameter=8.0), back)) == []


def test_lenses_that_touch_and_balls_are_no_finding():
    # Equal radii in contact, and a biconvex lens that touches a plane.
    plane, end = Surface(math.inf, 2.0, GLASS, semi_diameter=5.0), Surface(math.inf, semi_diameter=5.0)
    stack = [STOP, Surface(20.0, 4.0, GLASS, semi_diameter=5.0), Surface(-20.0, 0.0, semi_diameter=5.0)]
    meniscus = [Surface(-20.0, 2.0, GLASS, semi_diameter=5.0), Surface(-20.0, semi_diameter=5.0)]
    ball = [Surface(5.0, 10.0, GLASS, semi_diameter=5.0, depth=5.0), Surface(-5.0, semi_diameter=5.0, depth=5.0)]
    flat = [Surface(5.0, 7.5, GLASS, semi_diameter=5.0, depth=7.5), Surface(math.inf, semi_diameter=4.0)]
    small = CircularStop(1.0, 0.0)
    for elements in ([*stack, plane, end], [*stack, *meniscus], [small, *ball], [small, *flat]):
        assert kinds(LensStack(elements)) == [], elements


def test_edges_that_are_thin():
    # Half a sag of 1.26794919 (10 - sqrt(100 - 25) less 0.072) on each side.
    sag = 10.0 - math.sqrt(75.0)
    for edge, expected in ((0.06, []), (0.04, [("THIN_EDGE", (1, 2))]), (-0.01, [("OVERLAP", (1, 2))])):
        front = Surface(10.0, 2 * sag + edge, GLASS, semi_diameter=5.0)
        assert kinds(singlet(front, Surface(-10.0, semi_diameter=5.0))) == expected


def test_a_smaller_surface_may_go_on_to_the_edge():
    # As in the Metrogon (p187): with a flat bevel the first lens would be -0.1 mm thick at its edge.
    front = Surface(16.44, 4.4, GLASS, semi_diameter=15.5)
    found = kinds(singlet(front, Surface(19.72, semi_diameter=14.6)))
    assert not {"OVERLAP", "THIN_EDGE"} & {kind for kind, _ in found}
    # A plane cannot: at 10 mm the front is 5.4 mm behind its vertex.
    assert ("OVERLAP", (1, 2)) in kinds(
        singlet(Surface(12.0, 4.0, GLASS, semi_diameter=10.0), Surface(math.inf, semi_diameter=5.0))
    )


def test_a_surface_that_reaches_through_a_stop():
    # 5.36 mm of sag at 10 mm, 5 mm behind the stop, whose opening ends at 3 mm.
    behind = Surface(-12.0, 2.0, GLASS, semi_diameter=10.0), Surface(-14.0, semi_diameter=10.0)
    (found,) = [f for f in findings(LensStack([CircularStop(3.0, 1.0), *behind])) if f.elements == (0, 1)]
    assert found.kind is FindingKind.OVERLAP
    assert "reaches 4.37 mm through the plane of stop 0" in found.message
    before = Surface(14.0, 2.0, GLASS, semi_diameter=10.0), Surface(12.0, 1.0, semi_diameter=10.0)
    assert ("OVERLAP", (1, 2)) in kinds(LensStack([*before, CircularStop(3.0)]))


def test_near_the_equator():
    for size, expected in ((9.8, []), (9.95, [("EQUATOR", (1,))])):
        front = Surface(10.0, 14.0, GLASS, semi_diameter=size)
        assert kinds(singlet(front, Surface(math.inf, semi_diameter=9.0), CircularStop(1.0))) == expected


def test_steep_aspheres():
    # A slope of 4 a r^3 = 2 at the rim is 63.4 degrees; a sphere of that slope is no finding.
    back = Surface(math.inf, semi_diameter=5.0)
    asphere = Surface(math.inf, 4.0, GLASS, semi_diameter=5.0, aspheric=(0.0, 2.0 / 4 / 125))
    (found,) = findings(singlet(asphere, back, CircularStop(1.0)))
    assert (found.kind, found.elements) == (FindingKind.STEEP, (1,))
    assert "63.4 degrees 5 mm from the axis" in found.message
    sphere = Surface(5.5, 4.0, GLASS, semi_diameter=5.0)
    assert kinds(singlet(sphere, back, CircularStop(1.0))) == []


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
        lens = LensStack([STOP, *plates, Surface(math.inf, semi_diameter=5.0)])
        wavelength = 900.0 if infrared in media else 587.6
        assert kinds(lens, wavelength) == expected, media


def test_an_iris_far_outside():
    # A focal length of 100 mm.
    front, back = Surface(50.0, 4.0, GLASS, semi_diameter=10.0), Surface(math.inf, semi_diameter=10.0)
    assert kinds(singlet(front, back, CircularStop(3.0, 90.0))) == []
    assert kinds(singlet(front, back, CircularStop(3.0, 110.0))) == [("IRIS_FAR", (0,))]


def test_an_image_inside_the_last_rim():
    # In the glass the light meets 18 mm behind the front; the rear hollow shifts that to 1 / (1.5 / 2 - 0.5 / 4) = 1.6
    # mm behind its vertex, and its rim reaches 4 - sqrt(4^2 - 3.9^2) = 3.11 mm.
    lens = LensStack([CircularStop(1.0), Surface(6.0, 16.0, GLASS, semi_diameter=3.0), Surface(4.0, semi_diameter=3.9)])
    found = findings(lens)
    (inside,) = [finding for finding in found if finding.kind is FindingKind.IMAGE_INSIDE]
    assert "1.6 mm behind" in inside.message
    assert "3.111 mm" in inside.message


def test_an_iris_that_is_not_filled():
    front, back = Surface(50.0, 4.0, GLASS, semi_diameter=5.0), Surface(math.inf, semi_diameter=5.0)
    assert kinds(singlet(front, back, CircularStop(5.2, 1.0))) == []  # 96 %
    (found,) = findings(singlet(front, back, CircularStop(10.0, 1.0)))
    assert (found.kind, found.elements) == (FindingKind.IRIS_NOT_FILLED, (0, 1))
    assert "fills 50 % of the iris's semi-diameter, 10 mm" in found.message
    # Of a polygon, what counts is the distance of its edges.
    assert kinds(LensStack([pl.PolygonStop(6, 5.2 / math.cos(math.pi / 6), thickness=1.0), front, back])) == []


def test_a_beam_that_is_totally_reflected():
    # Parallel light in glass of 1.5 meets the rear sphere at sin i = r / 10: beyond 10 / 1.5 mm it cannot leave.
    front, back = Surface(math.inf, 12.0, GLASS, semi_diameter=9.0), Surface(-10.0, semi_diameter=9.0)
    found = findings(singlet(front, back, CircularStop(8.0, 1.0)))
    beams = [finding for finding in found if "beam from infinity" in finding.message]
    assert [(finding.kind, finding.elements) for finding in beams] == [(FindingKind.TOTAL_REFLECTION, (2,))]
    assert f"fill {100 * 10 / 1.5 / 8:.0f} %" in beams[0].message
    assert not any("beam" in f.message for f in findings(singlet(front, back, CircularStop(6.0, 1.0))))


def test_chief_rays_that_are_totally_reflected():
    # From a stop in glass, 20 mm before a plane: beyond arcsin(1 / 1.5) = 41.8 degrees nothing leaves.
    inside = [CircularStop(1.0, 20.0), Surface(math.inf, semi_diameter=100.0)]
    found = findings(LensStack([Surface(math.inf, 20.0, GLASS, semi_diameter=100.0), *inside]))
    assert [(f.kind.name, f.elements) for f in found] == [("TOTAL_REFLECTION", (0,)), ("TOTAL_REFLECTION", (2,))]
    # Rays are tried in steps of 88 / 512 = 0.17 degrees.
    assert "at more than 41.9 degrees" in found[0].message
    # Where a rim in front lets 0.3 rad in glass through and no more, they are not asked for.
    assert kinds(LensStack([Surface(math.inf, 20.0, GLASS, semi_diameter=20.0 * math.tan(0.3)), *inside])) == []


def test_a_lens_that_passes_nothing():
    assert FindingKind.NO_LIGHT in [f.kind for f in findings(REFERENCE.moved(5, shift=(0, 60.0, 0)))]
    assert FindingKind.NO_LIGHT not in [f.kind for f in findings(REFERENCE.moved(5, shift=(0, 10.0, 0)))]


def test_an_objective_that_collimates_is_lit_from_its_front_focus():
    # 2 x f = 100 mm, 150 mm apart: f = 200 mm, and the rear focus lies 100 mm before the last lens, the front one
    # 100 mm behind the first. Light from infinity would fill the iris at the last lens to a half of its opening.
    lens = [Surface(50.0, 3.0, GLASS, semi_diameter=10.0), Surface(math.inf, 148.0, semi_diameter=10.0)]
    objective = LensStack([*lens, *lens, CircularStop(9.0)])
    assert kinds(objective) == []


# ---- the values ----


def test_findings_are_values():
    finding = Finding(FindingKind.GLASS, [3, 6], "the glass differs")
    assert finding == Finding(7 - 3, (3, 6), "the glass differs")
    assert pickle.loads(pickle.dumps(finding)) == finding
    assert (str(finding), finding.elements) == ("the glass differs", (3, 6))
    assert repr(finding) == "Finding(kind=<FindingKind.GLASS: 4>, elements=(3, 6), message='the glass differs')"
    for make, text in (
        (lambda: Finding(99, (), ""), "kind is 99"),
        (lambda: Finding(FindingKind.GLASS, (-1,), ""), "elements is -1"),
        (lambda: Finding(FindingKind.GLASS, (), 5), "message is 5"),
        (lambda: findings(REFERENCE, 2000.0), "wavelength 2000 nm is outside"),
        (lambda: findings("double-gauss-100mm-f2"), "lens is a"),
    ):
        with pytest.raises(InvalidValueError, match=text):
            make()


@st.composite
def any_lens(draw: st.DrawFn) -> LensStack:
    size = st.one_of(st.floats(0.1, 50.0), st.floats(1e-15, 1e15))
    gaps = st.one_of(st.floats(0.0, 100.0), st.floats(0.0, 1e15))
    elements: list[Surface | CircularStop] = []
    for _ in range(draw(st.integers(0, 5))):
        if draw(st.integers(0, 3)) == 0:
            elements.append(CircularStop(draw(size), draw(gaps)))
            continue
        radius = draw(st.one_of(st.just(math.inf), size, size.map(lambda r: -r)))
        medium = draw(st.sampled_from([AIR, GLASS, ModelGlass(1.8, 25.0, "SF5")]))
        conic = draw(st.one_of(st.just(0.0), st.floats(-5.0, 3.0)))
        rim = min(draw(size), draw(st.floats(0.1, 1.0)) * abs(radius) / math.sqrt(max(1.0 + conic, 1e-3)))
        terms = draw(st.one_of(st.just(()), st.tuples(st.floats(-1e-3, 1e-3), st.floats(-1e-3, 1e-3))))
        try:
            elements.append(Surface(radius, draw(gaps), medium, semi_diameter=rim, conic=conic, aspheric=terms))
        except InvalidValueError:
            elements.append(Surface(math.inf, 1.0, medium, semi_diameter=1.0))
    elements += [CircularStop(draw(size), draw(gaps)), Surface(100.0, semi_diameter=10.0)]
    lens = LensStack(elements)
    move = st.floats(-1.5, 1.5)
    return lens.moved(0, shift=(0, draw(move), 0), tilt=(draw(move), 0, 0)) if draw(st.booleans()) else lens


@given(lens=any_lens())
def test_any_lens_can_be_checked(lens: LensStack):
    for finding in findings(lens):
        assert isinstance(finding.kind, FindingKind)
        assert all(0 <= i < len(lens.elements) for i in finding.elements)
        assert ";" in finding.message  # what is wrong; what to do


def test_elements_moved_through_each_other_are_found():
    moves = (slice(0, 2), (0, 0, 20), (0, 0, 0)), (slice(0, 2), (0, 30, 0), (0, 0, 0))
    small = (slice(0, 2), (0, 0, 0), (0.004, 0, 0)), (slice(0, 5), (0.3, 0, 0), (0, 0, 0))
    for which, shift, tilt in (*moves, *small):
        found = {kind for kind, _ in kinds(REFERENCE.moved(which, shift=shift, tilt=tilt))}
        assert ("OVERLAP" in found) == ((which, shift, tilt) in moves), (which, shift, tilt)
    assert "OVERLAP" in {kind for kind, _ in kinds(load_lens("singlet-100mm-f4").moved([1, 2], shift=(0, 0, -30)))}
