"""Zemax files as other programs and years write them, against two by two matrices and rays traced here by hand."""

import dataclasses
import math

import numpy as np
import pytest

import plenoptic as pl
from plenoptic import CircularStop, LensStack, RayBundle, Surface, load_lens, save_lens
from plenoptic.errors import FileWarning, InvalidValueError, PrescriptionError
from plenoptic.optics import AIR, RingStop
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points

HEAD = "MODE SEQ; UNIT MM; ENPD 2.6; FTYP 0 0 1 1; XFLN 0; YFLN 0; WAVM 1 0.5875618 1; PWAV 1"
FAR, D = "SURF 0; DISZ INFINITY", 587.5618
REL = 1e-12
"""Of some ten roundings."""


def load(folder, *lines: str, head: str = HEAD, first: str = FAR, **options: object) -> LensStack:
    """Of surfaces without their SURF; lines are separated by semicolons."""
    begin = int(first[5]) + 1 if first else 1
    blocks = [f"SURF {i}; {block}" for i, block in enumerate([*lines[:-1], ""], start=begin)]
    text = "; ".join(filter(None, [head, first, *blocks, lines[-1]]))
    (folder / "lens.zmx").write_text(text.replace("; ", "\n"), encoding="utf-8")
    return load_lens(folder / "lens.zmx", **options)


def blank(nd: float, vd: float = 0.0) -> str:
    return f"GLAS ___BLANK 1 0 {nd} {vd}"


def focal_length(*surfaces: tuple[float, float, float]) -> float:
    """Of (curvature, gap, index behind), by a ray of height 1: n' u' = n u - (n' - n) c y."""
    y, nu, n = 1.0, 0.0, 1.0
    for curvature, gap, behind in surfaces:
        nu -= (behind - n) * curvature * y
        y, n = y + gap * nu / behind, behind
    return -1.0 / nu


def heights_that_pass(lens: LensStack, heights: np.ndarray, angle: float = 0.0, z: float = 0.0) -> np.ndarray:
    """Heights in the plane z of rays at an angle in the plane x = 0, of those that pass."""
    start = np.stack([0 * heights, heights - (z + 50.0) * math.tan(angle), 0 * heights - 50.0], axis=1)
    rays = RayBundle(start, np.tile([0.0, math.sin(angle), math.cos(angle)], (len(heights), 1)))
    return heights[lens.trace(rays).status == 0]


@pytest.mark.parametrize("angle, distance", [(0.0, 20.0), (10.0, 20.0), (20.0, 20.0), (20.0, 5.0), (35.0, 8.0)])
def test_rims_without_a_diameter_let_the_whole_beam_of_each_field_through(tmp_path, angle, distance):
    """Brute force: rays that fill the stop at the field's angle all pass, and the first rim is no larger."""
    head = HEAD.replace("ENPD 2.6", "ENPD 10").replace("YFLN 0", f"YFLN {angle}")
    surfaces = f"STOP; DISZ {distance}", f"CURV 0.02; DISZ 4; {blank(1.5)}", "CURV -0.01; DISZ 96"
    lens = load(tmp_path, *surfaces, "", head=head)
    grid = np.linspace(-4.99, 4.99, 61)
    inside = np.array([(x, y) for x in grid for y in grid if math.hypot(x, y) <= 4.99])
    slope = math.tan(math.radians(angle))
    start = np.column_stack([inside[:, 0], inside[:, 1] - 50.0 * slope, np.full(len(inside), -50.0)])
    rays = RayBundle(start, np.tile([0.0, slope, 1.0] / np.hypot(slope, 1.0), (len(inside), 1)))
    assert (lens.trace(rays).status == 0).all()
    stop, front, back = lens.elements
    smaller = LensStack([stop, dataclasses.replace(front, semi_diameter=0.99 * front.semi_diameter), back])
    assert (smaller.trace(rays).status != 0).any()


FRONT, BACK = "CURV 0.4385; DISZ 0.7; GLAS ___BLANK 1 0 1.545 56; DIAM 1.38", "CURV 0.05; DISZ 3; DIAM 1.38"


@pytest.mark.parametrize(
    "mirror, disc, size",
    [("", 30, 100), ("; DIAM 100", 30, 100), ("; DIAM 20", 30, 100), ("; DIAM 50", 60, 100), ("; CLAP 0 80", 30, 80)],
)
def test_an_obscuration_stops_its_disc_and_nothing_else(tmp_path, mirror, disc, size):
    on_mirror = f"STOP; CURV -0.001; CONI -1; DISZ -500; GLAS MIRROR; OBSC 0 {disc}{mirror}"
    lens = load(tmp_path, "DISZ 300", on_mirror, "", head=HEAD.replace("ENPD 2.6", "ENPD 200"))
    passing = heights_that_pass(lens, np.arange(0.5, 130.0))
    assert passing.min() == disc + 0.5 and passing.max() == size - 0.5 and len(passing) == size - disc
    ring = lens.elements[0]
    assert isinstance(ring, RingStop) and ring.semi_diameter >= 1.1 * size * (1 - REL)


def test_an_obscuration_in_front_of_a_telescope_has_no_rim(tmp_path):
    disc, mirror = "DISZ 300; OBSC 0 30", "STOP; CURV -0.001; CONI -1; DISZ -500; GLAS MIRROR; DIAM 100"
    for head in (HEAD.replace("ENPD 2.6", "ENPD 200"), "UNIT MM; FLOA"):
        passing = heights_that_pass(load(tmp_path, disc, mirror, "", head=head), np.arange(0.5, 130.0))
        assert passing.min() == 30.5 and passing.max() == 99.5


@pytest.mark.parametrize("behind", [0.4759, 0.1, 0.25, 0.4, 0.55])
def test_a_stop_may_lie_behind_the_vertex_before_which_it_stands(tmp_path, behind):
    lens = load(tmp_path, f"STOP; DISZ {-behind}; DIAM 1.375", FRONT, BACK, "")
    points = cardinal_points(lens, 587.5618)
    by_hand = focal_length((0.4385, 0.7, 1.545), (0.05, 3.0, 1.0))
    assert points.efl == pytest.approx(by_hand, rel=REL) == pytest.approx(4.658030, abs=5e-7)
    assert lens.vertices.tolist() == pytest.approx([0.0, -behind, 0.7 - behind])
    # The entrance pupil is the stop; rays pass where they would cross its plane, also obliquely.
    assert (points.entrance_pupil, points.entrance_pupil_semi_diameter) == pytest.approx((0.0, 1.3))
    grid = np.arange(-1.495, 1.5, 0.01)
    for angle in (0.0, math.radians(10.0)):
        passing = heights_that_pass(lens, grid, angle)
        assert passing.tolist() == grid[np.abs(grid) <= 1.3].tolist()
    assert not any(f.kind is pl.optics.FindingKind.OVERLAP for f in lens.check())
    for name in ("again.json", "again.zmx"):
        save_lens(lens, tmp_path / name)
        again = load_lens(tmp_path / name)
        assert again.vertices == pytest.approx(lens.vertices) and again.stop == lens.stop


def test_surfaces_follow_one_another(tmp_path):
    with pytest.raises(PrescriptionError, match=r"element 3 lies 0.5 mm in front of the surface before it"):
        load(tmp_path, FRONT, "CURV 0.05; DISZ 1.5; DIAM 1.38", "STOP; DISZ -2; DIAM 1", FRONT, BACK, "")


LENS = "CURV 0.02; DISZ 4; {}; DIAM 6", "CURV -0.02; DISZ 40; DIAM 6"


@pytest.mark.parametrize(
    "glass, nd, vd",
    [
        ("GLAS Untitled 1 2 1.6073 59.5001", 1.6073, 59.5001), ("GLAS N-BK7 1 0 1.6073 59.5", 1.6073, 59.5),
        ("GLAS 517642 1 0 1.7 30", 1.7, 30.0), ("GLAS ___blank 1 0 1.5", 1.5, math.inf),
        ("GLAS 517642 0 0 1.5 40", 1.517, 64.2), ("GLAS 517.642", 1.517, 64.2), ("GLAS 003193 0 0", 2.003, 19.3),
        ("GLAS 923209", 1.923, 20.9), ("GLAS 434950", 1.434, 95.0),
    ],
)  # fmt: skip
def test_model_glasses_and_codes_count_by_their_numbers(tmp_path, glass, nd, vd):
    lens = load(tmp_path, f"STOP; {LENS[0].format(glass)}", LENS[1], "")
    by_hand = focal_length((0.02, 4.0, nd), (-0.02, 40.0, 1.0))
    assert cardinal_points(lens, 587.5618).efl == pytest.approx(by_hand, rel=REL)
    assert pl.optics.abbe_number(lens.gap_media[2]) == pytest.approx(vd, rel=1e-9)


def test_glass_numbers_that_are_missing_are_an_error(tmp_path):
    for glass, message in (("GLAS Untitled 1 0", "GLAS has 3 entries"), ("GLAS 51764 0 0", "no glass '51764'"),
                           ("GLAS Untitled 1 0 0.5 30", "nd is 0.5")):  # fmt: skip
        with pytest.raises(PrescriptionError, match=message):
            load(tmp_path, f"STOP; {LENS[0].format(glass)}", LENS[1], "")
    mine = load(tmp_path, f"STOP; {LENS[0].format('GLAS 517642')}", LENS[1], "", glasses={"517642": pl.glass("SF6")})
    assert mine.gap_media[2] == pl.glass("SF6")


@pytest.mark.parametrize(
    "first, second",
    [
        ("GLAS MIRROR", "GLAS MIRROR"), (blank(-1.0), ""), ("GLAS Metal 1 0 -1", blank(1.0)),
        (blank(-1.0, 50.0), blank(1.0, 50.0)), ("GLAS X 1 0 -1.0 0", "GLAS X 1 0 1 0"),
    ],
)  # fmt: skip
def test_mirrors_may_be_a_change_of_the_sign_of_the_index(tmp_path, first, second):
    """A Cassegrain telescope: 1 / f = 2 / R1 + 2 / R2 - ... by the ray of height 1, with -2 c for a mirror."""
    primary, secondary = f"STOP; CURV -0.002; DISZ -150; DIAM 40; {first}", f"CURV -0.003; DISZ 250; DIAM 20; {second}"
    lens = load(tmp_path, primary, secondary, "")
    height = 1.0 - 150.0 * 0.004
    assert cardinal_points(lens).efl == pytest.approx(1.0 / (0.004 - 0.006 * height), rel=1e-9)
    assert [type(element) for element in lens.elements] == [CircularStop, Surface, Surface]


def test_glass_in_the_backward_space_and_wrong_indices(tmp_path):
    mangin = ("STOP; CURV -0.01; DISZ 5; DIAM 20; " + blank(1.5), "CURV -0.008; DISZ -5; DIAM 20; " + blank(-1.5),
              "CURV -0.01; DISZ -50; DIAM 20; " + blank(-1.0))  # fmt: skip
    usual = (mangin[0], mangin[1].replace(blank(-1.5), "GLAS MIRROR"), mangin[2].replace(blank(-1.0), ""))
    lens = load(tmp_path, *mangin, "")
    # By hand, unfolded: refraction, -2 n c of the mirror, and refraction by the same surface from behind.
    y, u = 1.0, -0.5 * -0.01
    y += 5.0 * u / 1.5
    u += 2.0 * 1.5 * -0.008 * y
    y += 5.0 * u / 1.5
    u -= (1.0 - 1.5) * 0.01 * y
    assert cardinal_points(lens).efl == pytest.approx(-1.0 / u, rel=REL)
    assert cardinal_points(load(tmp_path, *usual[:2], usual[2].strip("; "), "")).efl == pytest.approx(-1 / u, rel=REL)
    with pytest.raises(PrescriptionError, match="surface 2 has another sign and another value"):
        load(tmp_path, mangin[0], mangin[1].replace("-1.5", "-1.6"), mangin[2], "")


@pytest.mark.parametrize("first, shift", [("SURF 1; DISZ INFINITY", 1), ("", 0), ("SURF 0; DISZ INFINITY", 0)])
def test_files_may_begin_with_surface_1(tmp_path, first, shift):
    text = f"STOP; {LENS[0].format(blank(1.6))}", LENS[1]
    lens = load(tmp_path, *text, f"MNUM 2 1; CRVT {2 + shift} 2 -0.03", first=first, configuration=2)
    assert cardinal_points(lens).efl == pytest.approx(focal_length((0.02, 4.0, 1.6), (-0.03, 40.0, 1.0)), rel=REL)
    assert lens.specification.z_object == -math.inf
    with pytest.raises(PrescriptionError, match="SURF is '3'; the next surface has number 0"):
        load(tmp_path, *text, "", first="SURF 3; DISZ INFINITY")


@pytest.mark.parametrize("gap, index", [(0.5, 1.6), (40.0, 1.5), (0.0, 1.5), (2.0, 2.0), (7.0, 1.33)])
def test_a_sensor_may_be_glued_to_the_last_glass(tmp_path, gap, index):
    lens = load(tmp_path, "STOP; DISZ 1; DIAM 2", LENS[0].format(blank(1.5)), "CURV -0.02; DISZ 30; DIAM 6",
                f"DISZ {gap}; DIAM 6; {blank(index)}", "DIAM 5")  # fmt: skip
    assert lens.rear_medium.index(587.6) == pytest.approx(index) and lens.front_medium == AIR
    assert lens.specification.z_image == pytest.approx(35.0 + gap)
    # A paraxial ray of height y meets the sensor where it does inside the glass.
    y, u = 1e-3, -0.5 * 0.02 * 1e-3
    y += 4.0 * u / 1.5
    u += -0.5 * 0.02 * y
    y += 30.0 * u + gap * u / index
    ray = lens.trace(RayBundle([[0.0, 1e-3, -1.0]], [[0.0, 0.0, 1.0]]))
    assert ray.at_z(lens.specification.z_image)[0, 1] == pytest.approx(y, rel=1e-6)


TERMS, PARMS = "XDAT 1 3; XDAT 2 2.0; XDAT 3 0; XDAT 4 -0.016; XDAT 5 0.0064", "PARM 2 -0.001; PARM 3 0.0001"


@pytest.mark.parametrize(
    "shape",
    [
        f"TYPE XASPHERE; {TERMS}", f"TYPE XASPHERE; {PARMS}", f"{TERMS}; TYPE XASPHERE; PARM 1 0",
        f"TYPE XASPHERE; XDAT 1 0; XDAT 2 1; {PARMS}", f"TYPE EVENASPH; {PARMS}",
        "TYPE XOSPHERE; XDAT 1 6; XDAT 2 2; XDAT 3 0; XDAT 4 0; XDAT 6 -0.016; XDAT 8 0.0064",
    ],
)  # fmt: skip
@pytest.mark.parametrize("unit, mm", [("MM", 1.0), ("CM", 10.0)])
def test_extended_aspheres_are_sums_of_powers(tmp_path, shape, unit, mm):
    lens = load(tmp_path, "STOP; DISZ 0.1; DIAM 1.3", f"{shape}; {FRONT}", BACK, "", head=HEAD.replace("MM", unit))

    def sag(y):
        root = math.sqrt(1.0 - (0.4385 * y) ** 2)
        slope = 0.4385 * y / root - 4e-3 * y**3 + 6e-4 * y**5
        return 0.4385 * y * y / (1.0 + root) - 1e-3 * y**4 + 1e-4 * y**6, slope

    # A meridional ray by hand: parallel to the axis onto the asphere, then onto the sphere by bisection.
    (z, slope), angle = sag(0.8), 0.0
    incidence = math.atan(slope)
    angle = math.asin(math.sin(incidence) / 1.545) - incidence
    low, high = 0.0, 3.0
    for _ in range(200):
        middle = 0.5 * (low + high)
        y, at = 0.8 + middle * math.sin(angle), z + middle * math.cos(angle)
        low, high = (middle, high) if at < 0.7 + 20.0 - math.sqrt(400.0 - y * y) else (low, middle)
    normal = math.asin(y / 20.0)
    angle = math.asin(1.545 * math.sin(angle + normal)) - normal
    landing = y + (3.7 - at) * math.tan(angle)
    assert landing == pytest.approx(0.18465623, abs=5e-9)
    ray = lens.trace(RayBundle([[0.0, 0.8 * mm, -1.0]], [[0.0, 0.0, 1.0]], 587.5618))
    assert ray.at_z(float(lens.vertices[-1]) + 3.0 * mm)[0, 1] == pytest.approx(landing * mm, rel=1e-12)


@pytest.mark.parametrize("unit, mm", [("MM", 1.0), ("CM", 10.0), ("IN", 25.4)])
@pytest.mark.parametrize("conic, c", [(0.0, 0.4385), (-1.3, -0.3), (0.6, 0.0)])
@pytest.mark.parametrize(
    "shape",
    [
        "TYPE XOSPHERE; XDAT 1 7; XDAT 2 2; XDAT 3 0; XDAT 4 0.008; XDAT 5 0.016; XDAT 6 -0.016; XDAT 9 0.0128",
        "XDAT 9 1e-4; XDAT 6 -1e-3; XDAT 4 2e-3; XDAT 5 2e-3; XDAT 2 1; XDAT 1 7; TYPE XOSPHERE",
        "TYPE ODDASPHE; PARM 2 2e-3; PARM 3 2e-3; PARM 4 -1e-3; PARM 7 1e-4",
    ],
)
def test_odd_powers_against_a_ray_by_hand(tmp_path, shape, conic, c, unit, mm):
    surface = f"{shape}; CURV {c}; CONI {conic}; DISZ 0.7; {blank(1.545)}; DIAM 1.38"
    head = HEAD.replace("MM", unit).replace("2.6", "2.0")
    lens = load(tmp_path, "STOP; DISZ 0.1; DIAM 1.3", surface, "DISZ 3; DIAM 1.5", "", head=head)
    y = 0.8
    root = math.sqrt(1.0 - (1.0 + conic) * (c * y) ** 2)
    z = c * y * y / (1.0 + root) + 2e-3 * y**2 + 2e-3 * y**3 - 1e-3 * y**4 + 1e-4 * y**7
    slope = c * y / root + 4e-3 * y + 6e-3 * y**2 - 4e-3 * y**3 + 7e-4 * y**6
    angle = math.asin(math.sin(math.atan(slope)) / 1.545) - math.atan(slope)
    landing = y + (0.7 - z) * math.tan(angle) + 3.0 * math.tan(math.asin(1.545 * math.sin(angle)))
    turned = 0.6, 0.8  # the surface is one of revolution
    ray = lens.trace(RayBundle([[mm * y * t for t in turned] + [-1.0]], [[0.0, 0.0, 1.0]], 587.5618))
    at_image = ray.at_z(float(lens.vertices[-1]) + 3.0 * mm)[0, :2]
    assert at_image == pytest.approx([mm * landing * t for t in turned], rel=1e-12, abs=1e-13 * mm)
    # Only the r^2 term counts for paraxial rays.
    assert cardinal_points(lens, D).efl == pytest.approx(mm / (0.545 * (c + 4e-3)), rel=1e-12)


@pytest.mark.parametrize(
    "shape, message",
    [
        ("TYPE XOSPHERE; XDAT 1 3; XDAT 2 1; XDAT 3 1e-3; XDAT 4 0; XDAT 5 1e-3", r"a term of r \(XDAT 3\), a cone"),
        ("TYPE ODDASPHE; PARM 1 1e-3", r"ODDASPHE has a term of r \(PARM 1\), a cone"),
        ("TYPE XOSPHERE; PARM 2 1e-3", "PARM of an XOSPHERE is not read"),
        ("TYPE XASPHERE; XDAT 1 3; XDAT 2 1; XDAT 3 0", "all terms from XDAT 3 on"),
        ("TYPE XASPHERE; XDAT 1 1; XDAT 3 1e-3", "norm radius 0"),
        ("TYPE XASPHERE; XDAT 1 1.5; XDAT 2 1; XDAT 3 1e-3", "1.5 terms"),
        ("TYPE XASPHERE; PARM 9 1e-3", "PARM 9 is 0.001"),
        ("TYPE XASPHERE; XDAT 1 200; XDAT 2 1e-9; XDAT 3 1; XDAT 202 1", "aspheric"),
    ],
)
def test_extended_aspheres_that_are_incomplete_or_cones_are_refused(tmp_path, shape, message):
    with pytest.raises(PrescriptionError, match=rf"lens.zmx, line \d+: .*{message}"):
        load(tmp_path, "STOP; DISZ 0.1; DIAM 1.3", f"{shape}; {FRONT}", BACK, "")


ZOOM = ("CURV 0.02; DISZ 4; GLAS ___BLANK 1 0 1.5168 64.2; DIAM 8", "CURV -0.02; DISZ 5; DIAM 8",
        "STOP; DISZ 0.5; DIAM 3", "CURV -0.05; DISZ 1; GLAS ___BLANK 1 0 1.62 36; DIAM 5",
        "CURV 0.03; DISZ 30; DIAM 5; FLAP 0 5 0")  # fmt: skip
GAPS = "MNUM 3 1; MOFF 0 1; THIC   2   1 5 0 0 0 1 1 1 0 0; THIC   2   2 15 0 0 0 1; THIC   2   3 25 0 0 0 1"


def zoom_focal_length(gap: float, curvature: float = -0.05, index: float = 1.62) -> float:
    rows = ((0.02, 4.0, 1.5168), (-0.02, gap + 0.5, 1.0), (curvature, 1.0, index), (0.03, 30.0, 1.0))
    return focal_length(*rows)


def test_a_configuration_is_chosen_by_its_number(tmp_path):
    with pytest.warns(FileWarning, match=r"all but one of 3 configurations \(MNUM; choose by configuration=\)"):
        assert cardinal_points(load(tmp_path, *ZOOM, GAPS), D).efl == pytest.approx(zoom_focal_length(5.0), rel=REL)
    for number, gap, printed in ((1, 5.0, -44.7077), (2, 15.0, -82.0927), (3, 25.0, -501.2016)):
        lens = load(tmp_path, *ZOOM, GAPS, configuration=number)
        focus = cardinal_points(lens, 587.5618).efl
        assert focus == pytest.approx(zoom_focal_length(gap), rel=REL) == pytest.approx(printed, abs=5e-5)
        # ENPD holds in all of them.
        assert cardinal_points(lens, D).entrance_pupil_semi_diameter == pytest.approx(1.3, rel=REL)


def near(number: float) -> object:
    return pytest.approx(number, rel=REL)


@pytest.mark.parametrize(
    "operand, value, expected",
    [
        ("CRVT 4 2 -0.04", lambda lens: cardinal_points(lens, D).efl, near(zoom_focal_length(5.0, -0.04))),
        ("GLSS 4 2 UNOBTAINIUM", None, None),
        ("GLSS 4 2 SF6", lambda lens: lens.gap_media[4], pl.glass("SF6")),
        ("CONN 5 2 -1.5", lambda lens: lens.elements[4].conic, -1.5),
        ("SDIA 5 2 4.5 0 0", lambda lens: lens.elements[4].semi_diameter, 4.5),
        ("APER 0 2 1.3", lambda lens: cardinal_points(lens, D).entrance_pupil_semi_diameter, near(0.65)),
        ("YFIE 1 2 7", lambda lens: lens.specification.fields[0, 1], near(-math.radians(7.0))),
        ("THIC 5 2 33.5", lambda lens: lens.specification.z_image, near(35.0)),
        ("PRAM 1 2 1E-4 0 2 0", lambda lens: lens.elements[0].aspheric, (0.0, 1e-4)),
        ("THIC 0 2 200", lambda lens: lens.specification.z_object, near(-209.0)),
    ],
)  # fmt: skip
def test_operands_replace_numbers_of_one_configuration(tmp_path, operand, value, expected):
    lines = f"MNUM 2 1; {operand}; {operand.replace(' 2 ', ' 1 ', 1)}" if value is None else f"MNUM 2 1; {operand}"
    if value is None:
        with pytest.raises(PrescriptionError, match="no glass"):
            load(tmp_path, *ZOOM, lines, configuration=2)
        return
    surfaces = ("TYPE EVENASPH; PARM 2 0; " + ZOOM[0], *ZOOM[1:])
    lens, other = (load(tmp_path, *surfaces, lines, configuration=number) for number in (2, 1))
    assert value(lens) == expected and value(other) != expected


def test_configurations_that_are_not_there_and_operands_that_are_not_read(tmp_path):
    for number, message in ((4, r"configuration is 4; lens.zmx has 3 \(MNUM\)"), (0, "configuration is 0"),
                            ("a", "configuration"), (2, "THIC is of surface 9, which is not in the file")):  # fmt: skip
        with pytest.raises(InvalidValueError, match=message):
            load(tmp_path, *ZOOM, f"{GAPS}; THIC 9 2 1", configuration=number)
    with pytest.raises(InvalidValueError, match="configuration is 2; lens.zmx has 1"):
        load(tmp_path, *ZOOM, "", configuration=2)
    with pytest.raises(InvalidValueError, match="only .seq, .txt and .zmx files have several"):
        load_lens("singlet-100mm-f4", configuration=1)
    said = r"configuration data of other kinds \(WAVE\), solves \(surfaces {} as in configuration 1\)"
    for old, new, number in (
        ("DISZ 30", "DISZ 30; MAZH 0 0.7", 5),
        ("DISZ 1;", "DISZ 1; EDGE 2 0;", 4),
        ("CURV -0.05", "CURV -0.05 2 1.5", 4),
    ):
        solved = [block.replace(old, new) for block in ZOOM]
        with pytest.warns(FileWarning, match=f"left out are {said.format(number)}"):
            load(tmp_path, *solved, f"{GAPS}; WAVE 1 2 0.6; FVCY 1 2 0; LTTL 0 2 Tele", configuration=2)


def focus(*rows: tuple[float, float, float]) -> float:
    """Distance from the last surface to the paraxial focus."""
    y, nu, n = 1.0, 0.0, 1.0
    for i, (curvature, gap, behind) in enumerate(rows):
        nu -= (behind - n) * curvature * y
        y, n = (y + gap * nu / behind, behind) if i < len(rows) - 1 else (y, behind)
    return -y / nu


@pytest.mark.parametrize(
    "solves, behind_stop, rear",
    [
        ({3: "TCOM 2 40"}, lambda gap: 40.0 - gap, 0.03),
        ({3: "TOLE 1 46"}, lambda gap: 42.0 - gap, 0.03),
        ({3: "PZUP 2 -0.5 15"}, lambda gap: 15.0 - 0.5 * gap, 0.03),
        ({3: "PZUP 2.0 1 0 0", 5: 'CURV 0.03 4 4.0 -1. 0 ""'}, lambda gap: gap, 0.04),
    ],
)
def test_solves_follow_the_configuration(tmp_path, solves, behind_stop, rear):
    blocks = [f"{block}; {solves.get(i, '')}".strip("; ") for i, block in enumerate(ZOOM, start=1)]
    blocks[4] = (blocks[4].replace("CURV 0.03; ", "") if 5 in solves else blocks[4]) + "; MAZH 0 0"
    for number, gap in ((2, 15.0), (3, 25.0)):
        lens = load(tmp_path, *blocks, f"{GAPS}; CRVT 4 {number} -0.04", configuration=number)
        after = behind_stop(gap)
        assert np.diff(lens.vertices)[1:3] == pytest.approx([gap, after], rel=REL)
        rows = ((0.02, 4.0, 1.5168), (-0.02, gap + after, 1.0), (-0.04, 1.0, 1.62), (rear, 0.0, 1.0))
        assert cardinal_points(lens, D).efl == pytest.approx(focal_length(*rows), rel=1e-11)
        assert lens.specification.z_image - lens.vertices[-1] == pytest.approx(focus(*rows), rel=1e-10)
    # The file's numbers are those of the configuration that was active, and those of operands hold.
    assert np.diff(load(tmp_path, *blocks, GAPS, configuration=1).vertices)[2] == 0.5
    fixed = load(tmp_path, *blocks, f"{GAPS}; THIC 3 2 0.7; THIC 5 2 31", configuration=2)
    assert (np.diff(fixed.vertices)[2], fixed.specification.z_image - fixed.vertices[-1]) == pytest.approx((0.7, 31.0))


def test_solves_of_later_surfaces_are_refused(tmp_path):
    blocks = [block.replace("DISZ 0.5", "DISZ 0.5; TCOM 4 40") for block in ZOOM]
    with pytest.raises(PrescriptionError, match="line .*TCOM of surface 3 refers to 4; it must be a surface before"):
        load(tmp_path, *blocks, GAPS, configuration=2)


def test_the_focus_of_a_near_object_by_a_solve(tmp_path):
    solved = (*ZOOM[:-1], f"{ZOOM[-1]}; MAZH 0 0")
    lens = load(tmp_path, *solved, "MNUM 2 1; THIC 0 2 300; THIC 2 2 25", configuration=2)
    y, nu, n = 300.0, 1.0, 1.0  # the axial ray of the object
    for curvature, gap, behind in ((0.02, 4.0, 1.5168), (-0.02, 25.5, 1.0), (-0.05, 1.0, 1.62), (0.03, 0.0, 1.0)):
        nu -= (behind - n) * curvature * y
        y, n = y + gap * nu / behind, behind
    assert lens.specification.z_image - lens.vertices[-1] == pytest.approx(-y / nu, rel=1e-11)
