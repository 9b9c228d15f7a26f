"""What Zemax files say of aperture, fields, wavelengths and image, in constructs whose answers are closed forms."""

import dataclasses
import math
import warnings

import numpy as np
import pytest

import plenoptic as pl
from plenoptic import LensStack, load_lens, save_lens
from plenoptic.errors import PrescriptionError

DIAMETER = pl.optics.StopSize.DIAMETER
APERTURE = pl.optics.FindingKind.APERTURE
FAR = "DISZ INFINITY"
STOP, IMAGE = "STOP; DISZ 5; DIAM 10 1 0 0 1", "CURV 0"
F = 78.0
GLASS = "GLAS ___BLANK 1 0 1.5 0"
LENS = (f"CURV 0; DISZ 4; {GLASS}; DIAM 20", f"CURV {-2 / F!r}; DISZ {F!r}; DIAM 20")
"""A plano-convex lens of focal length F, whose rear principal plane is its last vertex."""


def load(folder, head: str, *surfaces: str, first: str = FAR, image: str = IMAGE, **options: object) -> LensStack:
    """Of lines that are separated by semicolons."""
    blocks = [f"SURF {i}; {block}" for i, block in enumerate([first, *surfaces, image])]
    path = folder / "lens.zmx"
    path.write_text("\n".join("; ".join(["UNIT MM", *filter(None, [head]), *blocks]).split("; ")), encoding="utf-16")
    return load_lens(path, **options)


def f_number(lens: LensStack) -> float:
    points = pl.paraxial.cardinal_points(lens, 587.6)
    return abs(points.efl) / (2 * points.entrance_pupil_semi_diameter)


def about_aperture(lens: LensStack) -> list[str]:
    return [str(finding) for finding in lens.check() if finding.kind is APERTURE]


def test_the_entrance_pupil_counts_and_not_the_diameter_of_the_stop(tmp_path):
    lens = load(tmp_path, "ENPD 10", STOP, *LENS)
    assert f_number(lens) == pytest.approx(7.8, rel=1e-12)
    (found,) = about_aperture(lens)
    assert "semi-diameter of 5 mm, but its file states 10 mm" in found and "StopSize.DIAMETER" in found
    by_stop = load(tmp_path, "ENPD 10", STOP, *LENS, stop_size=DIAMETER)
    assert f_number(by_stop) == pytest.approx(3.9, rel=1e-12)
    (found,) = about_aperture(by_stop)
    assert "an entrance pupil of 10 mm (f/7.8); its diameter is 20 mm (f/3.9)" in found
    # Where both agree nothing is said, and nothing of a stop that its user has chosen.
    assert about_aperture(load(tmp_path, "ENPD 20", STOP, *LENS)) == []
    assert about_aperture(lens.with_stop(pl.CircularStop(1.0))) == []


def test_the_f_number_is_that_of_the_file(tmp_path):
    """The stop lies behind a lens, which magnifies it, and says another size, that of another f-number."""
    for number in (2.37, 0.91):
        front = (f"CURV 0.02; DISZ 6; {GLASS}; DIAM 49", "CURV 0; DISZ 3; DIAM 49")
        lens = load(tmp_path, f"FNUM {number} 0", *front, STOP, *LENS)
        assert f_number(lens) == pytest.approx(number, rel=1e-12), number
        floating = load(tmp_path, f"FNUM {number} 0", *front, STOP, *LENS, stop_size=DIAMETER)
        assert f_number(floating) == pytest.approx(number * lens.stop.semi_diameter / 10.0, rel=1e-12), number
    # A system that floats by its stop does.
    for head in ("FLOA", "", "ENPD 10; FLOA"):
        lens = load(tmp_path, head, STOP, *LENS)
        assert lens.stop.semi_diameter == 10.0 and about_aperture(lens) == [], head


def test_the_cone_of_a_near_object_may_be_given(tmp_path):
    near = "DISZ 100"
    lens = load(tmp_path, "OBNA 0.1 0", STOP, *LENS, first=near)
    assert lens.stop.semi_diameter == pytest.approx(100.0 * math.tan(math.asin(0.1)), rel=1e-12)
    lens = load(tmp_path, "OBNA 4 1", STOP, *LENS, first=near)
    assert lens.stop.semi_diameter == pytest.approx(100.0 * math.tan(math.radians(4.0)), rel=1e-12)
    # Working f-number: 1 / (2 u'), with the height y of the marginal ray in the lens u' = y / f - u = y / f - y / s.
    lens = load(tmp_path, "FNUM 8 1", STOP, *LENS, first=near)
    away = 100.0 + 5.0 + 4.0 / 1.5
    assert lens.stop.semi_diameter == pytest.approx(100.0 / away / 16.0 / (1.0 / F - 1.0 / away), rel=1e-12)
    # An entrance pupil, at the stop, is met by the marginal ray of any object.
    assert load(tmp_path, "ENPD 10", STOP, *LENS, first=near).stop.semi_diameter == pytest.approx(5.0, rel=1e-12)


def test_an_aperture_on_the_stop_ends_the_beam(tmp_path):
    lens = load(tmp_path, "ENPD 30", f"{STOP}; CLAP 0 6", *LENS)
    assert lens.stop.semi_diameter == 6.0 and "entrance pupil of 30 mm" in about_aperture(lens)[0]
    for radius, size in ((6, 6.0), (12, 10.0)):
        floating = load(tmp_path, "FLOA", f"{STOP}; CLAP 0 {radius}", *LENS)
        assert floating.stop.semi_diameter == size and about_aperture(floating) == []
    assert load(tmp_path, "ENPD 8", f"{STOP}; CLAP 0 6", *LENS).stop.semi_diameter == pytest.approx(4.0, rel=1e-12)
    # The surface of the stop lets the beam through.
    front, back = LENS
    lens = load(tmp_path, "ENPD 24", f"STOP; {front.replace('DIAM 20', 'DIAM 8')}", back)
    assert [element.semi_diameter for element in lens.elements] == pytest.approx([12.0, 12.0, 20.0], rel=1e-12)


def test_a_stop_that_does_not_follow_is_refused_with_a_way_out(tmp_path):
    collimated = (*LENS, STOP)
    with pytest.raises(PrescriptionError, match=r"line 2: ENPD 10 .*at infinity; give stop_size=pl"):
        load(tmp_path, "ENPD 10", *collimated)
    assert load(tmp_path, "ENPD 10", *collimated, stop_size=DIAMETER).stop.semi_diameter == 10.0
    # In front of such a lens, the numerical aperture of a near object says it all the same.
    telecentric = load(tmp_path, "OBNA 0.1 0", *collimated, first="DISZ 50")
    assert telecentric.stop.semi_diameter == pytest.approx(F * math.tan(math.asin(0.1)), rel=1e-9)
    # A stop placed by rule says that the pupil is another.
    assert "entrance pupil of 10 mm (f/7.8)" in about_aperture(load(tmp_path, "ENPD 10", *LENS))[0]


SYSTEM = (
    "ENPD 10; FTYP 0 0 3 2 0 0 0; XFLN 0 0 3 0 0 0; YFLN 0 -5 4 0 0 0; "
    "WAVM 1 0.4861 1; WAVM 2 0.5876 1; WAVM 3 0.55 1; WAVM 4 0.55 1; PWAV 2"
)


def test_fields_wavelengths_and_image_are_handed_out(tmp_path):
    lens = load(tmp_path, SYSTEM, STOP, *LENS, "DISZ 1.5", image="CURV -0.01")
    told = lens.specification
    assert told.wavelengths == pytest.approx((587.6, 486.1), rel=1e-12)
    x, y = math.tan(math.radians(3.0)), math.tan(math.radians(4.0))
    away = math.atan(math.hypot(x, y)) / math.hypot(x, y)
    # Rays that rise, of positive angles, come from below.
    expected = [[0, 0], [0, math.radians(5.0)], [-away * x, -away * y]]
    np.testing.assert_allclose(told.fields, expected, rtol=0, atol=1e-15)
    assert (told.z_object, told.z_image, told.image_radius) == (-math.inf, pytest.approx(9.0 + F + 1.5), -100.0)
    assert (told.entrance_pupil_diameter, told.stop_semi_diameter) == (10.0, 10.0)
    # As analyses take them: the image of a field of 5 degrees that falls lies below.
    spot = pl.aberrations.spot_diagram(lens, field=told.fields[1], z_image=told.z_image, wavelength=told.wavelengths)
    assert spot.centroid[1] == pytest.approx(-F * math.tan(math.radians(5.0)), rel=0.05)
    # Beyond a right angle fields are handed out as they are.
    wide = load(tmp_path, "FLOA; FTYP 0 0 2 1; XFLN 0 0; YFLN 0 95", STOP, *LENS).specification
    assert wide.fields[1].tolist() == [0.0, pytest.approx(-math.radians(95.0))]


def test_fields_are_heights_where_the_object_is_near(tmp_path):
    near = "DISZ 10"
    in_cm = SYSTEM.replace("ENPD 10", "UNIT CM; ENPD 1").replace("FTYP 0", "FTYP 1")
    heights = load(tmp_path, in_cm, STOP, *LENS, first=near).specification
    assert heights is not None and heights.z_object == pytest.approx(-100.0)
    np.testing.assert_allclose(heights.fields, 10.0 * np.array([[0, 0], [0, -5], [3, 4]]), rtol=1e-15)
    angles = load(tmp_path, SYSTEM.replace("ENPD 10", "UNIT CM; ENPD 1"), STOP, *LENS, first=near).specification
    # From the object to the entrance pupil, which is the stop.
    assert angles is not None and angles.fields[1, 1] == pytest.approx(100.0 * math.tan(math.radians(5.0)))
    image = load(tmp_path, SYSTEM.replace("FTYP 0", "FTYP 2"), STOP, *LENS).specification
    assert image is not None and image.fields[1, 1] == pytest.approx(math.atan(5.0 / F))


def test_the_specification_travels_with_the_lens(tmp_path):
    lens = load(tmp_path, SYSTEM, STOP, *LENS)
    save_lens(lens, tmp_path / "lens.json")
    again = load_lens(tmp_path / "lens.json")
    assert again == lens and again.specification == lens.specification is not None
    assert about_aperture(again) == about_aperture(lens) != []
    assert lens.moved(1, shift=(0.1, 0, 0)).specification == lens.specification
    assert dataclasses.replace(lens, specification=None) != lens
    assert load_lens("double-gauss-100mm-f2").specification is None
    with pytest.raises(pl.errors.InvalidValueError, match="specification is"):
        dataclasses.replace(lens, specification=7)


def test_what_is_left_out_is_said_once(tmp_path):
    for head, surface, image, named in (
        ("VDXN 0 0 0; VDYN 0 0.1 0", "", "", "vignetting factors"),
        ("VCYN 0.2", "", "", "vignetting factors"),
        ("ENVD 35 1 0", "", "", r"temperature and pressure \(35 C, 1 atm, ENVD\)"),
        ("ENVD 20 0 0", "", "", r"temperature and pressure \(20 C, 0 atm, ENVD\)"),
        ("", "; COAT AR", "", r"coatings \(COAT of surfaces 2, 3\)"),
        ("", "", "; MNUM 3 1", r"all but one of 3 configurations \(MNUM; choose by configuration=\)"),
        ("FTYP 0 1 1 1", "", "", "object space that is telecentric"),
        ("FTYP 4 0 1 1", "", "", r"fields of type 4 \(FTYP\)"),
        ("", "", "; CONI -1", "the shape of the image but for its curvature"),
        ("", "", "; TYPE EVENASPH; PARM 2 1e-4", "the shape of the image but for its curvature"),
        ("VDYN 0.1; ENVD 40 1", "", "", "vignetting factors.*, temperature and pressure"),
    ):
        given = "; ".join(filter(None, ["FLOA; XFLN 0; YFLN 5", head]))
        with pytest.warns(pl.errors.FileWarning, match=rf"^lens\.zmx: left out are {named}.*; see") as caught:
            load(tmp_path, given, STOP, *(lens + surface for lens in LENS), image=IMAGE + image)
        assert len(caught) == 1 and caught[0].filename == __file__, named
    # Nothing is said of what stands in every file.
    usual = "VDXN 0 0; VDYN 0 0; VCXN 0 0; VCYN 0 0; VANN 0 0; ENVD 2.0E+1 1 0; COFN COATING.DAT SCATTER_PROFILE.DAT"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load(tmp_path, f"{SYSTEM}; {usual}", STOP, *LENS, image=f"TYPE STANDARD; {IMAGE}; DIAM 3; MNUM 1 1; MOFF 0 1")


def test_a_glass_that_ends_before_the_primary_wavelength_is_no_matter_where_sizes_are_known(tmp_path):
    glass = [surface.replace(GLASS, "GLAS N-BK7 0 0") for surface in LENS]
    wave = "WAVM 1 10.6 1; PWAV 1; XFLN 0; YFLN 5"
    with pytest.warns(pl.errors.FileWarning, match="fields"):
        lens = load(tmp_path, f"FLOA; {wave}", STOP, *glass)
    assert lens.stop.semi_diameter == 10.0 and isinstance(lens.check(), tuple)
    with pytest.raises(PrescriptionError, match="at the primary wavelength, .*10600"):
        load(tmp_path, f"ENPD 10; {wave}", STOP, *glass)


def test_apertures_that_are_none_are_no_matter_where_the_diameter_counts(tmp_path):
    for head in ("ENPD 0", "FNUM 0 0", "FNUM 0 1", "OBNA 2 0", "OBNA 0.1 0"):
        lens = load(tmp_path, head, STOP, *LENS, first="DISZ 50" if "2" in head else FAR, stop_size=DIAMETER)
        assert lens.stop.semi_diameter == 10.0 and about_aperture(lens) == [], head
        with pytest.raises(PrescriptionError, match=f"line 2: {head[:4]} .*give stop_size=pl.optics.StopSize.DIAMETER"):
            load(tmp_path, head, STOP, *LENS, first="DISZ 50" if "2" in head else FAR)
