import math
import pickle

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plenoptic.errors import FileError, InvalidValueError, PrescriptionError
from plenoptic.optics.glass.bundled import glass, glass_names
from plenoptic.optics.glass.catalogue import GlassCatalogue, GlassEntry, glasses_from_agf, load_glasses
from plenoptic.optics.glass.dispersion import COEFFICIENT_COUNTS, DispersionFormula, Formula
from plenoptic.optics.glass.media import D_LINE, Schott, Sellmeier, abbe_number


@given(name=st.sampled_from(glass_names()), data=st.data())
def test_case_and_signs_in_a_name_make_no_difference(name, data):
    plain = name.replace("-", "")
    signs = data.draw(st.lists(st.sampled_from(["", "-", "_", " "]), min_size=len(plain), max_size=len(plain)))
    upper = data.draw(st.lists(st.booleans(), min_size=len(plain), max_size=len(plain)))
    written = "".join(s + (c if u else c.lower()) for s, c, u in zip(signs, plain, upper, strict=True))
    assert glass(written) == glass(name)


MINE = """\
CC made for this test
NM MY-BK7 2 517642.251 1.5168 64.17 0 1
GC step 0.5; Größe
ED 7.1 8.3 2.51 -0.0009 0
CD 1.039612120E+00 6.000698670E-03 2.317923440E-01 2.001791440E-02 1.010469450E+00 1.035606530E+02 0 0 0 0
TD 1.860000E-06 1.310000E-08 -1.370000E-11 4.340000E-07 6.270000E-10 1.700000E-01 2.000000E+01
OD - 1.0000 0.0000 1.0000 2.3000 2.3000
LD 3.00000E-01 2.50000E+00
IT 3.00000E-01 5.00000E-02 2.50000E+01

NM OLD 1 1 1.51680 64.17
CD 2.2718929 -1.0108077e-2 1.0592509e-2 2.0816965e-4 -7.6472538e-6 4.9240991e-7
LD .365 1.014
NM ALN 9 1 2.154291 50.733102 0 0 0
CD 3.1399 1.3786 2.941E-002 3.861 225.9009
LD 0.22 5.
NM INFRARED 7 1 1.000000 0.000000 0 0 0
CD 6.364 0.342 0.09 0.0011
LD 0.59 4.6
"""


def _written(folder, content, name="mine.agf"):
    file = folder / name
    file.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8"))
    return load_glasses(file)


def test_a_catalogue_is_a_mapping_from_names_to_media(tmp_path):
    mine = _written(tmp_path, MINE)
    assert mine.names == tuple(mine) == ("MY-BK7", "OLD", "ALN", "INFRARED") and len(mine) == 4
    assert repr(mine) == "<GlassCatalogue 'mine.agf': 4 glasses>" and "my bk7" in mine and "BK7" not in mine
    assert mine["my_bk7"].medium == Sellmeier(
        (1.03961212, 0.231792344, 1.01046945), (0.00600069867, 0.0200179144, 103.560653), "MY-BK7", (300.0, 2500.0)
    )
    assert mine["old"] == Schott(glass("BK7").coefficients, "OLD", (365.0, 1014.0))
    aln = DispersionFormula(Formula.SELLMEIER_4, (3.1399, 1.3786, 0.02941, 3.861, 225.9009), "ALN", (220.0, 5000.0))
    assert mine["ALN"] == aln and mine["infrared"].index(1000.0) > 2.5
    assert mine.entry("my-bk7").source == "step 0.5; Größe"
    assert pickle.loads(pickle.dumps(mine)) == mine and hash(pickle.loads(pickle.dumps(mine))) == hash(mine)
    assert pickle.loads(pickle.dumps(mine))["aln"] == aln


def test_encodings_line_ends_and_tabs_make_no_difference(tmp_path):
    reference = _written(tmp_path, MINE)
    for newline in ("\n", "\r\n", "\r"):
        for encoding in ("utf-8", "utf-8-sig", "utf-16", "latin-1"):
            assert _written(tmp_path, MINE.replace("\n", newline).encode(encoding)) == reference, (newline, encoding)
    assert _written(tmp_path, b"\xfe\xff" + MINE.encode("utf-16-be")) == reference
    assert _written(tmp_path, MINE.replace(" ", "\t").replace("\t0.5;\tG", " 0.5; G")) == reference
    with pytest.raises(FileError, match=r"cannot read .*mine.agf"):  # half a character
        _written(tmp_path, MINE.encode("utf-16")[:-1])


def test_every_formula_has_its_medium(tmp_path):
    kinds = {1: Schott, 2: Sellmeier, 6: Sellmeier, 11: Sellmeier}
    for formula in Formula:
        # Long lines are cut; a line may be continued; coefficients that are missing are not 0.
        numbers = ["2.25", "0.01", "0.01", *["0"] * 7]
        head, end = f"NM X {int(formula)} 0 1 0\nCD ", "\nLD 0.4 0.7\n"
        count = COEFFICIENT_COUNTS[formula]
        medium = _written(tmp_path, head + " ".join(numbers) + end)["X"]
        assert type(medium) is kinds.get(formula, DispersionFormula), formula
        for text in (" ".join(numbers[:count]), " ".join(numbers[:2]) + "\n  " + "\n".join(numbers[2:])):
            assert _written(tmp_path, head + text + end)["X"] == medium, formula
        with pytest.raises(PrescriptionError, match=f"CD has {count - 1} coefficients, .* needs {count}"):
            _written(tmp_path, head + " ".join(numbers[: count - 1]) + end)["X"]


# All by hand from n^2 = a + b w^2 + c w^-2 + d w^-4 + e w^-6 + f w^-8 with the six coefficients, not by the reader.
TWO_LINES = """\
NM TWOLINES 1 719393 1.718921 39.30 0 2 0
ED 7 0 4 0 0 0
CD 2.882 -0.0138 0.0227 0.0016
-0.00011 1.35e-05 0 0
TD 0 0 0 0 0 0 20
 +0.5 1
LD 0.4 1.0
"""


def test_coefficients_go_on_until_a_keyword():
    def index(um):
        return math.sqrt(sum(k * um**p for k, p in zip((2.882, -0.0138, 0.0227, 0.0016, -0.00011, 1.35e-05),
                                                       (0, 2, -2, -4, -6, -8), strict=True)))  # fmt: skip

    split = "CD 2.882 -0.0138 0.0227 0.0016\n-0.00011 1.35e-05 0 0"
    variants = (TWO_LINES, TWO_LINES.replace("-0.00011", "\n\t-.00011"), TWO_LINES.replace(" 0.0227", "\n0.0227"),
                TWO_LINES.replace(split, "CD\n 2.882 -0.0138 0.0227 0.0016 -0.00011 1.35e-05"),
                TWO_LINES.replace("\n", "\r\n"), TWO_LINES.replace("LD", "GC 3\n5 years\nLD"))  # fmt: skip
    for text in variants:
        glass = glasses_from_agf(text, "x")["TWOLINES"]
        assert glass.index(D_LINE) == pytest.approx(index(0.5875618), rel=1e-15) == pytest.approx(1.718921, abs=5e-7)
        assert glass.index(404.66) == pytest.approx(1.752644, abs=5e-7)
        assert abbe_number(glass) == pytest.approx(39.298, abs=5e-4)
    with pytest.raises(PrescriptionError, match="line 4: CD is '1,35e-05'"):
        glasses_from_agf(TWO_LINES.replace("1.35", "1,35"), "x")


@pytest.mark.parametrize("stated, is_right", [("39.30", 1), ("39", 1), ("39.7", 1), ("0", 1), ("41", 0), ("37.5", 0)])
def test_the_abbe_number_of_a_glass_is_that_of_its_formula(stated, is_right):
    catalogue = glasses_from_agf(TWO_LINES.replace("39.30", stated), "x")
    if is_right:
        assert catalogue["TWOLINES"].index(D_LINE) > 1
    else:
        with pytest.raises(PrescriptionError, match=f"gives V_d 39.3 and its line NM {stated}"):
            catalogue["TWOLINES"]


def test_a_fit_that_leaves_1_is_an_error_only_there():
    text = "NM PLASTIC 1 0 1.564096 6.785 0 0 0\nCD 3.5 -0.9 -0.6 0.15 -0.012 0.0004\nLD {} {}\n"
    for ends in ((0.4, 1.6), (0.405, 1.62), (0.5, 1.7), (0.58, 1.65)):
        plastic = glasses_from_agf(text.format(*ends), "x")["PLASTIC"]
        assert plastic.index(D_LINE) == pytest.approx(1.564096, abs=5e-7)
        # n^2 of the formula at 1.6 um, by hand: 0.983808.
        with pytest.raises(InvalidValueError, match="of PLASTIC is .* nm; it must be finite and at least 1"):
            plastic.index(1e3 * ends[1])
    # At no wavelength of its range: the glass is an error.
    with pytest.raises(PrescriptionError, match="line 1, glass PLASTIC: .*at least 1"):
        glasses_from_agf(text.format(1.62, 1.7), "x")["PLASTIC"]


NM, CD, LD = "NM OLD 1 1 1.51680 64.17", "CD 2.2718929", "LD .365 1.014"


def _with(line, at):
    assert at in MINE
    return MINE.replace(at, line)


def test_a_line_that_cannot_be_understood_is_named(tmp_path):
    for content, message in (
        ("CC nothing\n", "mine.agf has no line NM"),
        ("CD 1 2 3\n" + MINE, "line 1: CD stands before the first NM"),
        (_with("NM MY-BK7 2 517642.251", "NM MY-BK7 2 517642.251 1.5168 64.17 0 1"), "line 2: NM has 3 words"),
        (_with("NM OLD 1.5 1 1.5 64", NM), "line 11: formula is 1.5"),
        (_with("NM OLD -1 1 1.5 64", NM), "line 11: formula is -1"),
        (_with("NM OLD one 1 1.5 64", NM), "line 11: formula is 'one'"),
        (_with("NM OLD 1 1 1,5168 64", NM), "line 11: n_d is '1,5168'"),
        (_with("NM OLD 1 1 1.5168 nan", NM), "line 11: V_d is 'nan'"),
        (_with("LD 0.365", LD), "line 13: LD has 1 numbers"),
        (_with("LD 0.365 1e999", LD), "line 13: LD is 1e999, too large"),
        (_with(f"{LD}\n{LD}", LD), "line 14: LD stands twice for OLD"),
        (_with("CD x", CD), "line 12: CD is 'x'"),
    ):
        with pytest.raises(PrescriptionError, match=r"mine.agf.*") as caught:
            _written(tmp_path, content)
        assert message in str(caught.value)


def test_a_glass_that_makes_no_sense_is_an_error_when_it_is_asked_for(tmp_path):
    for content, message in (
        (_with("NM OLD 1 1 1.51880 64.17", NM), "its formula gives n_d 1.5168 and its line NM"),
        (_with("NM OLD 14 1 1.51680 64.17", NM), "formula is 14; supported ones are 1 to 13"),
        (_with("IT", LD), "it has no line CD or no line LD"),
        (_with("LD 1.014 0.365", LD), "wavelength_range (1014, 365) is empty"),
        (_with("CD 0.99 0 0 0 0 0\nGC", CD), "must be finite and at least 1"),
    ):
        mine = _written(tmp_path, content)
        with pytest.raises(PrescriptionError, match=r"^mine.agf, line 11, glass OLD: ") as caught:
            mine["OLD"]
        assert message in str(caught.value)
        assert mine["ALN"].index(D_LINE) > 2, message
    # Rounding of a stated index is none.
    assert _written(tmp_path, _with("NM OLD 1 1 1.517 64.17", NM))["OLD"].index(D_LINE) == glass("BK7").index(D_LINE)


def test_names_that_differ_by_a_sign_are_told_apart_by_it(tmp_path):
    text = "NM A-B1 5 0 1 0\nCD 1.5 0 0\nLD 0.4 0.7\nNM AB1 5 0 1 0\nCD 1.6 0 0\nLD 0.4 0.7\n"
    mine = _written(tmp_path, text)
    assert mine["a-b1"].index(500.0) == 1.5 and mine["AB1"].index(500.0) == 1.6
    with pytest.raises(PrescriptionError, match="A-B1 on line 1 and AB1 on line 4, which differ"):
        mine["AB-1"]
    # Twice the same is no harm.
    assert _written(tmp_path, text[: text.index("NM AB1")] * 2)["ab 1"].index(500.0) == 1.5


def test_entries_are_checked():
    entry = GlassEntry("X", 5, 1.5, 0, [1.5, 0, 0], [400, 700])
    assert GlassCatalogue("mine", [entry])["x"].index(500.0) == 1.5
    for wrong in ({"name": 5}, {"formula": 2.5}, {"nd": "a"}, {"vd": math.nan}, {"coefficients": [math.inf]}):
        with pytest.raises(InvalidValueError):
            GlassEntry(**{"name": "X", "formula": 5, "nd": 1.5, "vd": 60.0, **wrong})


def test_a_file_that_cannot_be_read_is_a_file_error(tmp_path):
    for path in (tmp_path / "nowhere.agf", ".", "\0", 7):
        with pytest.raises(FileError):
            load_glasses(path)
