"""Zemax files: constructs written here as text, whose focal lengths are known in closed form."""

import dataclasses
import itertools
import math
import re

import pytest

import plenoptic as pl
from plenoptic import CircularStop, ConstantMedium, LensStack, ModelGlass, Surface, glass, load_lens, save_lens
from plenoptic.errors import FileError, InvalidValueError, PrescriptionError
from plenoptic.optics import AIR, load_glasses
from plenoptic.optics.glass.media import C_LINE, D_LINE, F_LINE
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points

HEAD = """VERS 140124 258 36214
MODE SEQ
NAME A test lens
NOTE 0 Written for a test
UNIT MM X W X CM MR CPMM
FLOA
GCAT SCHOTT OHARA
FTYP 0 0 2 3 0 0 0
XFLN 0 0
YFLN 0 5.0
WAVM 1 4.861327E-1 1
WAVM 2 5.875618E-1 1
WAVM 3 6.562725E-1 1
PWAV 2
"""
PUPIL = HEAD.replace("FLOA", "ENPD 1.0E+1 0")
OBJECT = ("DISZ INFINITY",)
IMAGE = ("TYPE STANDARD", "CURV 0.0", "DIAM 3.2 0 0 0 1")
REL = 1e-12  # some ten roundings, each of 1.1e-16, times the cancellation of powers of opposite signs


def zmx(*surfaces: tuple[str, ...], head: str = HEAD, first: tuple[str, ...] = OBJECT) -> str:
    blocks = [("TYPE STANDARD", "CURV 0.0", *first), *surfaces, IMAGE]
    lines = [[f"SURF {i}", *(f"  {line}" for line in block)] for i, block in enumerate(blocks)]
    return head + "\n".join(line for block in lines for line in block) + "\nTOL TOFF   0   0\nMNUM 1 1\n"


def load(folder, text: str, **options: object) -> LensStack:
    path = folder / "lens.zmx"
    path.write_bytes(text.encode("utf-8"))
    return load_lens(path, **options)


def refused(folder, text: str, message: str, line: str | None = None):
    """The file is refused with the message, on a line that contains `line`."""
    rows = enumerate(text.split("\n"), start=1)
    number = r"\d+" if line is None else "|".join(str(i) for i, row in rows if line in row)
    with pytest.raises(PrescriptionError, match=rf"^lens\.zmx, line ({number}): .*{message}"):
        load(folder, text)


def efl(lens: LensStack) -> float:
    return cardinal_points(lens, D_LINE).efl


def thick(n: float, c1: float, c2: float, t: float) -> float:
    """Focal length of a thick lens; E. Hecht, Optics, eq. 6.2."""
    return 1 / ((n - 1) * (c1 - c2 + (n - 1) * t * c1 * c2 / n))


def blank(nd: float, vd: float = 0.0) -> str:
    return f"GLAS ___BLANK 1 0 {nd} {vd} 0 0 0 0 0 0"


STOP = ("STOP", "DISZ 2.0", "DIAM 4.0 1 0 0 1")
FRONT = ("CURV 2.0E-2 0 0 0 0", "DISZ 4.0", blank(1.5), "DIAM 1.0E+1 1 0 0 1")
BACK = ("CURV -0.01", "DISZ 96.0", "DIAM 10")
SINGLET = thick(1.5, 0.02, -0.01, 4.0)


def test_a_singlet_with_a_stop_in_front(tmp_path):
    lens = load(tmp_path, zmx(STOP, FRONT, BACK))
    front = Surface(50.0, 4.0, ConstantMedium(1.5), semi_diameter=10.0)
    assert lens.elements == (CircularStop(4.0, 2.0), front, Surface(-100.0, 0.0, AIR, semi_diameter=10.0))
    assert (lens.name, lens.source, lens.front_medium) == ("A test lens", "lens.zmx; Written for a test", AIR)
    assert efl(lens) == pytest.approx(SINGLET, rel=REL)
    # Of a model glass.
    lens = load(tmp_path, zmx(STOP, ("CURV 0.02", "DISZ 5", blank(1.67, 47.1), "DIAM 9"), ("DIAM 9",)))
    assert lens.elements[1].medium == ModelGlass(1.67, 47.1)
    assert efl(lens) == pytest.approx(1 / (0.67 * 0.02), rel=REL)


def test_an_asphere_with_a_conic_constant(tmp_path):
    shape = ("CURV 0.02", "CONI -1.5", "DISZ 4.0", blank(1.5), "DIAM 8")
    terms = ("PARM 1 1.0E-4", "PARM 2 -2e-6", "PARM 3 0", "PARM 4 3.0E-12")
    # What TYPE says holds wherever it stands.
    for surface in (("TYPE EVENASPH", *shape, *terms), (*terms, *shape, "TYPE EVENASPH")):
        lens = load(tmp_path, zmx(STOP, surface, ("DIAM 8",)))
        front = Surface(50.0, 4.0, ConstantMedium(1.5), semi_diameter=8.0, conic=-1.5, aspheric=(1e-4, -2e-6, 0, 3e-12))
        assert lens.elements[1] == front
        # The r^2 term adds twice itself to the curvature.
        assert efl(lens) == pytest.approx(1 / (0.5 * (0.02 + 2e-4)), rel=REL)
    none = load(tmp_path, zmx(STOP, (*terms, *shape, "TYPE STANDARD"), ("DIAM 8",)))
    assert none.elements[1].aspheric == ()


def test_units_scale_the_whole_lens(tmp_path):
    for name, size in (("MM", 1.0), ("CM", 10.0), ("IN", 25.4), ("METER", 1000.0), ("M", 1000.0)):
        asphere = ("TYPE EVENASPH", "CURV 0.5", "DISZ 0.3", blank(1.5), "DIAM 0.4", "PARM 2 0.02", "PARM 3 -0.003")
        text = zmx(("STOP", "DISZ 0.1", "DIAM 0.2"), asphere, ("CURV -0.2", "DIAM 0.4"))
        lens = load(tmp_path, text.replace("UNIT MM", f"UNIT {name}"))
        assert efl(lens) == pytest.approx(size * thick(1.5, 0.5, -0.2, 0.3), rel=REL), name
        surface = lens.elements[1]
        assert isinstance(surface, Surface), name
        # A shape scales as a whole: z(size r) = size z(r).
        r = 0.37
        in_file = Surface(2.0, 0.3, semi_diameter=0.4, aspheric=(0.0, 0.02, -0.003))
        assert float(surface.sag(size * r)) == pytest.approx(size * float(in_file.sag(r)), rel=1e-14), name
        assert lens.stop.semi_diameter == pytest.approx(0.2 * size, rel=1e-15), name
        assert surface.semi_diameter == pytest.approx(0.4 * size, rel=1e-15), name


def test_stops_on_surfaces_and_dummies(tmp_path):
    lens, rear = load(tmp_path, zmx(("STOP", *FRONT), BACK)), load(tmp_path, zmx(FRONT, ("STOP", *BACK)))
    assert lens.elements[0] == CircularStop(10.0, 0.0) and (lens.iris_index, rear.iris_index) == (0, 1)
    assert rear.vertices.tolist() == [-4.0, 0.0, 0.0] and rear.gap_media[2] == ConstantMedium(1.5)
    assert [efl(lens), efl(rear)] == pytest.approx([SINGLET, SINGLET], rel=REL)
    # A dummy with an aperture is a stop but not the iris.
    for keyword in ("CLAP 0 6.5 0", "FLAP 0 6.5 0"):
        lens = load(tmp_path, zmx(("DISZ 1.0", "DIAM 20", keyword), STOP, FRONT, BACK))
        assert lens.elements[:2] == (CircularStop(6.5, 1.0), CircularStop(4.0, 2.0)), keyword
        assert lens.iris_index == 1 and efl(lens) == pytest.approx(SINGLET, rel=REL), keyword
    curved = load(tmp_path, zmx(("CURV 0.01", "DISZ 1.0", "DIAM 20", "CLAP 0 6.5 0"), STOP, FRONT, BACK))
    assert curved.elements[0] == Surface(100.0, 1.0, AIR, semi_diameter=6.5)
    # An aperture goes before a diameter.
    lens = load(tmp_path, zmx(STOP, (*FRONT, "CLAP 0.0 8.5 0", "MEMA 12 0 0 0 1"), BACK))
    assert [element.semi_diameter for element in lens.elements] == [4.0, 8.5, 10.0]


def test_dummy_planes_vanish_and_their_gaps_stay(tmp_path):
    back, dummy = ("CURV -0.01", "DISZ 7.0", "DIAM 10"), ("DISZ 3.0", "DIAM 20")
    halves = (FRONT[0], "DISZ 2.5", *FRONT[2:]), ("DISZ 1.5", blank(1.5), "DIAM 20")
    plain = load(tmp_path, zmx(FRONT, ("CURV -0.01", "DISZ 10.0", "DIAM 10"), STOP, FRONT, BACK))
    # The one in front and the one behind change nothing at all.
    with_dummies = load(tmp_path, zmx(dummy, *halves, back, dummy, STOP, FRONT, BACK, dummy))
    assert with_dummies.elements == plain.elements
    # From the rear principal plane of one to the front one of the other, 10 + 2 mm apart over the stop; Hecht, eq. 6.3.
    front_plane = -SINGLET * 0.5 * -0.01 * 4.0 / 1.5
    rear_plane = -SINGLET * 0.5 * 0.02 * 4.0 / 1.5
    d = 10.0 + 2.0 + front_plane - rear_plane
    assert efl(plain) == pytest.approx(1 / (2 / SINGLET - d / SINGLET**2), rel=REL)


def test_encodings_line_ends_and_indentation(tmp_path):
    text = zmx(STOP, FRONT, BACK).replace("A test lens", "Gauß")
    path, expected = tmp_path / "lens.ZMX", load(tmp_path, text)
    assert expected.name == "Gauß"
    texts = [text.replace("\n", newline) for newline in ("\n", "\r\n", "\r")]
    texts += [re.sub(r"(?m)^ +", "", text), re.sub(r"(?m)^ +(\w+) ", "\t\\1\t", text)]
    for encoding, written in itertools.product(("utf-16", "utf-16-le", "utf-16-be", "utf-8-sig", "latin-1"), texts):
        path.write_bytes(written.encode(encoding))
        lens = load_lens(path)
        assert (lens.name, lens.elements) == (expected.name, expected.elements), (encoding, written[:80])


def test_an_immersed_object_fills_both_sides(tmp_path):
    last = ("CURV -0.01", "DISZ 96.0", blank(1.33), "DIAM 10")
    lens = load(tmp_path, zmx(("STOP", "DISZ 2", "DIAM 4", blank(1.33)), FRONT, last, first=(*OBJECT, blank(1.33))))
    assert lens.front_medium == lens.rear_medium == ConstantMedium(1.33)
    # In the medium only ratios of indices count.
    assert efl(lens) == pytest.approx(thick(1.5 / 1.33, 0.02, -0.01, 4.0), rel=REL)


def test_glasses_of_ones_own_come_first(tmp_path):
    agf = tmp_path / "mine.agf"
    names = (("N-BK7", 1.6, 1.56), ("ODD", 1.7, 1.89))
    agf.write_text("".join(f"NM {name} 2 0 {n} 60\nCD {a} 0 0 0 0 0\nLD 0.3 2.5\n" for name, n, a in names))
    text = zmx(STOP, ("CURV 0.02", "DISZ 5", "GLAS N-BK7 0 0", "DIAM 9"), ("DIAM 9",))
    odd, own = text.replace("N-BK7", "ODD"), load_glasses(agf)
    numbered = text.replace("N-BK7 0 0", "N-BK7 0 0 1.5 40.0 0 0 0 0 0 0")  # the name counts
    constant = {"N-BK7": ConstantMedium(1.8)}
    for written, glasses, n in ((text, None, glass("N-BK7").index(D_LINE)), (text, own, 1.6), (text, constant, 1.8),
                                (odd, own, 1.7), (numbered, None, glass("N-BK7").index(D_LINE))):  # fmt: skip
        lens = load(tmp_path, written, **({} if glasses is None else {"glasses": glasses}))
        assert efl(lens) == pytest.approx(1 / ((n - 1) * 0.02), rel=REL), n
    refused(tmp_path, odd, "no glass 'ODD'.*catalogues SCHOTT OHARA.*glasses=pl.optics.load_glasses", "GLAS ODD")
    with pytest.raises(InvalidValueError, match="glasses is a"):
        load(tmp_path, text, glasses="schott")


UNSIZED = (("STOP", "DISZ 20.0"), ("CURV 0.02", "DISZ 4.0", blank(1.5)), ("CURV -0.01", "DISZ 96.0", "DIAM 0"))


def meet(y: float, slope: float, radius: float) -> tuple[float, float]:
    """Height and sag at which a meridional ray, of that height in the plane of the vertex, meets a sphere."""
    z = 0.0
    for _ in range(60):
        z = radius - math.copysign(math.sqrt(radius**2 - (y + slope * z) ** 2), radius)
    return y + slope * z, z


def test_missing_diameters_are_those_of_the_beam(tmp_path):
    # The ray through the rim of the stop, by hand: onto the first sphere, by Snell's law through it, onto the second.
    slope = math.tan(math.radians(5.0))
    front, z = meet(5.0 + 20.0 * slope, slope, 50.0)
    normal = math.asin(front / 50.0)
    inside = math.tan(math.asin(math.sin(math.atan(slope) + normal) / 1.5) - normal)
    rear, _ = meet(front + (4.0 - z) * inside, inside, -100.0)
    # The entrance pupil, the f-number or the stop give the beam.
    by_number = PUPIL.replace("ENPD 1.0E+1", f"FNUM {SINGLET / 10!r}")
    stop = ("STOP", "DISZ 20.0", "DIAM 5.0")
    for text in (zmx(*UNSIZED, head=PUPIL), zmx(*UNSIZED, head=by_number), zmx(stop, *UNSIZED[1:], head=HEAD)):
        lens = load(tmp_path, text)
        sizes = [element.semi_diameter for element in lens.elements]
        assert sizes == pytest.approx([5.0, front, rear], rel=1e-12)
        assert cardinal_points(lens, D_LINE).entrance_pupil_semi_diameter == pytest.approx(5.0, rel=1e-12)
        assert efl(lens) == pytest.approx(SINGLET, rel=REL)


def test_fields_may_be_heights(tmp_path):
    # An object of 30 mm, 100 mm in front of the stop, 10 mm of which are a dummy's gap.
    head = PUPIL.replace("FTYP 0", "FTYP 1").replace("YFLN 0 5.0", "YFLN 0 30.0")
    lens = load(tmp_path, zmx(("DISZ 10.0",), *UNSIZED, head=head, first=("DISZ 90.0",)))
    front, _ = meet(5.0 + 0.35 * 20.0, 0.35, 50.0)
    assert lens.stop.semi_diameter == pytest.approx(5.0, rel=1e-12)
    assert lens.elements[1].semi_diameter == pytest.approx(front, rel=1e-12)


def test_missing_diameters_without_a_beam_are_named(tmp_path):
    fields = ("XFLN 0 0\nYFLN 0 5.0\n", ""), ("FTYP 0", "FTYP 1"), ("FTYP 0", "FTYP 7")
    # Without its size the stop has none itself.
    for surface, old, new in ((1, "ENPD 1.0E+1 0\n", ""), *((2, *change) for change in fields)):
        text = zmx(*UNSIZED, head=PUPIL.replace(old, new))
        refused(tmp_path, text, rf"surface {surface} has no semi-diameter \(DIAM\)", f"SURF {surface}")


def test_what_cannot_be_is_refused_by_name_and_line(tmp_path):
    for surface, message in (
        (("CURV -0.001", "DISZ 5", "GLAS MIRROR 0 0", "DIAM 5"), "thickness is -5 mm"),
        (("CURV 0.02", "DISZ 1", "GLAS UNOBTAINIUM 0 0", "DIAM 5"), "no glass 'UNOBTAINIUM'"),
        (("CURV 0.02", "DISZ 1", "GLAS ___BLANK 1 0", "DIAM 5"), "GLAS has 3 entries; it must have at least 4"),
        (("CURV 0.02", "DISZ 1", blank(0.5), "DIAM 5"), "refractive_index is 0.5"),
        ((blank(1.6), "CURV 0.02", "DIAM 5", "DISZ INFINITY"), "thickness is inf"),
        ((blank(1.5), "CURV 0.02", "DISZ 1", "DIAM 51"), "semi_diameter 51 mm exceeds the radius"),
        ((blank(1.5), "CURV 0.02", "DISZ 1", "DIAM 5", "CLAP 0 0 0"), "semi_diameter is 0"),
        (("DISZ 1", "DIAM 5", "OBSC 1 2 0"), "OBSC blocks light from 1 to 2"),
        (("DISZ 1", "DIAM 5", "SQAP 2 3 0"), "SQAP: rectangular apertures"),
        (("DISZ 1", "DIAM 5", "CLAP 2 1 0"), "CLAP passes light from 2 to 1"),
        (("DISZ 1", "DIAM 5", "OBDC 0 0.5"), "the aperture is decentred"),
        (("DISZ 1", "DIAM 5", "SCBD 1 0 0.0 0.0 5.0 0.0 0.0"), "the surface is decentred or tilted"),
        (("DISZ 1", "DIAM 5", "CURV 0,02"), "CURV is '0,02'"),
        (("DISZ 1", "DIAM 5", "CURV"), "CURV has 0 entries"),
        (("DISZ 1", "DIAM 5", "STOP"), "surface 2 is a second STOP"),
        (("TYPE EVENASPH", "DISZ 1", "DIAM 5", "PARM 9 1e-9"), "PARM 9 is 1e-09"),
    ):
        of_size = "CLAP" if "CLAP 0 0 0" in surface else "DIAM"
        keyword = {"thickness": "DISZ", "semi_diameter": of_size}.get(message.split()[0])
        line = next((f"  {line}" for line in surface if line.split()[0] == keyword), None)
        refused(tmp_path, zmx(STOP, surface, FRONT, BACK), message, line)
    text = zmx(STOP, ("TYPE DGRATING", "DISZ 1"), FRONT, BACK)
    refused(tmp_path, text, "type DGRATING", "TYPE DGRATING")
    refused(tmp_path, text.replace("\n", "\r\n"), "type DGRATING", "TYPE DGRATING")
    refused(tmp_path, zmx(STOP, (*FRONT, "SQAP 2 3 0"), BACK), "rectangular", "SQAP 2 3")


def test_a_wrong_head_and_a_file_without_a_lens_are_refused(tmp_path):
    for old, new, message in (
        ("MODE SEQ", "MODE NSC", "MODE is 'NSC'"),
        ("UNIT MM", "UNIT FT", "UNIT is 'FT'"),
        ("UNIT MM X W X CM MR CPMM", "UNIT", "UNIT has 0 entries"),
        ("SURF 2", "SURF 3", "SURF is '3'; the next surface has number 2"),
        ("FLOA", "ENPD ten", "ENPD is 'ten'"),
        ("FLOA", "ENPD 0 0", "ENPD 0 does not determine the stop: it must be above 0; give stop_size="),
        ("FLOA", "OBNA 0.1 0", "the object is at infinity"),
        ("FLOA", "FNUM -1 0", "it must be above 0"),
    ):
        refused(tmp_path, zmx(STOP, FRONT, BACK).replace(old, new, 1), re.escape(message), new)
    refused(tmp_path, "", "there are 0 surfaces")
    refused(tmp_path, HEAD + "SURF 0\nSURF 1\n", "there are 2 surfaces", "SURF 1")
    refused(tmp_path, zmx(STOP), "no surface", "SURF 1")
    refused(tmp_path, zmx(FRONT, BACK, first=("STOP", *OBJECT)), "the object or the image is the STOP", "STOP")
    # Without a stop the rule places one.
    lens = load(tmp_path, zmx(FRONT, BACK, FRONT, BACK))
    assert lens.source.endswith("stop placed by rule")
    assert lens.vertices.tolist() == [-52.0, -48.0, 0.0, 48.0, 52.0]
    refused(tmp_path, zmx(("CLAP 0 3 0", "DISZ 1"), FRONT, BACK), "no surface is the STOP")


def test_a_written_lens_is_read_back(tmp_path):
    for name in pl.lens_names():
        if name.startswith("mirror"):
            continue
        lens = load_lens(name)
        save_lens(lens, tmp_path / "lens.zmx")
        again = load_lens(tmp_path / "lens.zmx")
        assert (again.name, again.iris_index) == (lens.name, lens.iris_index)
        for old, new in zip(lens.elements, again.elements, strict=True):
            assert (new.thickness, new.semi_diameter) == (old.thickness, old.semi_diameter), name
            if isinstance(old, Surface):
                # A radius by way of its curvature: two roundings.
                assert new.radius == pytest.approx(old.radius, rel=3e-16), name
        for line in (F_LINE, D_LINE, C_LINE):
            # Glasses by name agree to 1e-6, as the writer promises; the others have the same n_d and V_d.
            assert again.indices(line) == pytest.approx(lens.indices(line), abs=1e-6), (name, line)


def test_aspheres_further_stops_and_stops_in_glass_are_written(tmp_path):
    path, medium = tmp_path / "lens.zmx", ConstantMedium(1.5)
    asphere = Surface(25.0, 3.0, medium, semi_diameter=5.0, conic=-0.7, aspheric=(1e-4, 0.0, 1e-9))
    conic = Surface(math.inf, 0.5, ModelGlass(1.6, 40.0), semi_diameter=4.0, conic=2.0)
    front = [CircularStop(6.0, 1.0), asphere, Surface(math.inf, 2.0, semi_diameter=5.0)]
    rear = [CircularStop(2.0, 1.0), conic, Surface(-30.0, semi_diameter=4.0)]
    lens = LensStack([*front, *rear], iris=3, name="two\nlines")
    save_lens(lens, path)
    again = load_lens(path)
    assert again.elements == lens.elements and (again.iris_index, again.name) == (3, "two lines")
    ends = Surface(50.0, 5, medium, semi_diameter=10), Surface(-50.0, semi_diameter=10)
    lens = LensStack([ends[0], CircularStop(8.0, 5), ends[1]])
    save_lens(lens, path)
    assert efl(load_lens(path)) == pytest.approx(efl(lens), rel=1e-12)
    # Spheres used to their equator come back.
    for radius in (0.9, 1.1, 4.9, 13.7, 199.9):
        front = Surface(radius, 2 * radius, glass("N-BK7"), semi_diameter=radius)
        save_lens(LensStack([CircularStop(0.1 * radius), front, Surface(-radius, semi_diameter=radius)]), path)
        assert load_lens(path).elements[1].semi_diameter == pytest.approx(radius, rel=1e-12)
    # A glass of no catalogue is written as a model glass.
    medium = pl.Sellmeier((1.04, 0.23, 1.01), (0.006, 0.02, 103.0), name="MINE")
    sides = Surface(20.0, 3.0, medium, semi_diameter=5.0), Surface(-20.0, semi_diameter=5.0)
    save_lens(LensStack([CircularStop(2.0), *sides]), tmp_path / "lens.zmx")
    read = load_lens(tmp_path / "lens.zmx").gap_media[2]
    assert isinstance(read, ModelGlass)
    # n_d is written with all digits, and so is V_d, of which a model glass makes the same n_F - n_C.
    dispersion = read.index(F_LINE) - read.index(C_LINE)
    assert read.index(D_LINE) == pytest.approx(medium.index(D_LINE), rel=1e-15)
    assert dispersion == pytest.approx(medium.index(F_LINE) - medium.index(C_LINE), rel=1e-9)


def test_what_zemax_files_cannot_hold_is_refused(tmp_path):
    lens = load_lens("singlet-100mm-f4")
    stop, front, back = lens.elements
    ball = [Surface(5.0, 7.5, ConstantMedium(1.5), semi_diameter=5.0, depth=7.5), Surface(math.inf, semi_diameter=1.0)]
    for wrong, message in (
        (lens.moved(1, shift=(0.1, 0, 0)), "element 1 is decentred"),
        (lens.with_stop(pl.PolygonStop(6, 3.0)), "element 0 is PolygonStop"),
        (LensStack([stop, *ball]), "element 1 goes beyond its equator"),
        (LensStack([stop, front, dataclasses.replace(back, aspheric=(1e-30,) * 9)]), "element 2 has more than 8"),
    ):
        with pytest.raises(PrescriptionError, match=message):
            save_lens(wrong, tmp_path / "lens.zmx")
    assert not (tmp_path / "lens.zmx").exists()
    with pytest.raises(FileError, match=r"\.json or \.zmx"):
        save_lens(lens, tmp_path / "lens.seq")
