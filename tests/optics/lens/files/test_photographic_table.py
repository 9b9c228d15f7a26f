"""Descriptive tables of photographic lenses against matrices by hand, and messages."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

import plenoptic as pl
from plenoptic import Surface, load_lens
from plenoptic.errors import FileWarning, InvalidValueError, PrescriptionError
from plenoptic.optics import ModelGlass

TABLE = """[descriptive data]
title\tTwo groups
[constants]
[variable distances]
Focal Length\t60\t70\tundefined
Angle of View\t40\tundefined\tundefined
F-Number\t4
Image Height\t43.2
Magnification\t0\t0\t-0.1
d0\tInfinity\tInfinity\t500
d2\t20\t30\t25
Bf\t50\t40\tundefined
Aperture Diameter\t10\t12\t12
[lens data]
1\t50\t4\t1.5\t22\t60
2\t-80\td2\t\t22
2AS\tAS\t1.5\t\t9
3\t-100\t3\t1.6\t20\t40
4\t200\t2\t\t20
5\tCG\t1.0\t1.5168\t30\t64.2
6\tInfinity\tBf\t\t30
[aspherical data]
1\t50\t-0.5\t1e-6\t-2e-9
[figure]
[notes]
"""
LINE = 587.5618


def load(folder, text: str = TABLE, **options: object) -> pl.LensStack:
    (folder / "lens.txt").write_text(text, encoding="utf-8")
    return load_lens(folder / "lens.txt", **options)


def focal_length(gap: float) -> float:
    """n' u' = n u - (n' - n) c y."""
    y, nu, n = 1.0, 0.0, 1.0
    surfaces = ((1 / 50, 4, 1.5), (-1 / 80, gap + 1.5, 1.0), (-1 / 100, 3, 1.6), (1 / 200, 2, 1.0), (0.0, 1, 1.5168))
    for c, t, behind in (*surfaces, (0.0, 0, 1.0)):
        nu -= (behind - n) * c * y
        y, n = y + t * nu / behind, behind
    return -1.0 / nu


@pytest.mark.parametrize("configuration, gap, back, stop", [(1, 20.0, 50.0, 5.0), (2, 30.0, 40.0, 6.0)])
def test_configurations(tmp_path, configuration, gap, back, stop):
    lens = load(tmp_path, configuration=configuration)
    assert pl.paraxial.cardinal_points(lens, wavelength=LINE).efl == pytest.approx(focal_length(gap), rel=1e-7)
    assert lens.specification.z_image - lens.vertices[-1] == pytest.approx(back, rel=1e-12)
    assert (lens.name, lens.stop.semi_diameter) == ("Two groups", stop)
    assert math.isinf(lens.specification.z_object)


def test_the_first_configuration_is_the_default_and_others_are_named(tmp_path):
    with pytest.warns(FileWarning, match="all but the first of 3 configurations; choose by configuration="):
        lens = load(tmp_path)
    assert lens == load(tmp_path, configuration=1)
    np.testing.assert_allclose(np.abs(lens.specification.fields[1]), [0.0, math.radians(20.0)], rtol=1e-12)


def test_a_near_object_and_a_distance_that_is_undefined(tmp_path):
    lens = load(tmp_path, TABLE.replace("\tundefined\nAperture", "\t40\nAperture"), configuration=3)
    assert lens.specification.z_object == pytest.approx(float(lens.vertices[0]) - 500.0)
    with pytest.raises(
        PrescriptionError, match=r"lens.txt, line 21: the thickness 'Bf' has no value .*; choose another"
    ):
        load(tmp_path, configuration=3)
    with pytest.raises(InvalidValueError, match=r"configuration is 4; lens.txt has 3 \(\[variable distances\]\)"):
        load(tmp_path, configuration=4)


def image(object_distance: float, gap: float) -> float:
    """Distance from the last surface of FOCUSING to the paraxial image."""
    y, nu = (1.0, 0.0) if math.isinf(object_distance) else (object_distance, 1.0)
    n = 1.0
    for c, t, behind in ((1 / 60, 5.0, 1.6), (-1 / 90, gap, 1.0), (-1 / 200, 2.0, 1.7), (1 / 80, 0.0, 1.0)):
        nu -= (behind - n) * c * y
        y, n = y + t * nu / behind, behind
    return -y / nu


def gap_in_focus(object_distance: float, total: float) -> float:
    """Gap before the second lens that brings the image to `total` mm behind the second surface, by bisection."""
    low, high = 1.0, 20.0
    for _ in range(60):
        gap = 0.5 * (low + high)
        low, high = (low, gap) if gap + 2.0 + image(object_distance, gap) < total else (gap, high)
    return gap


TOTAL = 2.0 + 4.0 + image(math.inf, 4.0)
"""An inner lens moves, while object side and image stand still."""
DISTANCES = (math.inf, 2000.0, 800.0)


def focusing(distances=DISTANCES, zoom: int = 1, total: float = TOTAL) -> str:
    """A table with columns for distances of the object, each for some zoom positions that are all the same lens."""
    columns = [d for d in distances for _ in range(zoom)]
    gaps = [gap_in_focus(d, total) for d in columns]
    rows = {
        "Focal Length": [100.0 + i % zoom if math.isinf(d) else "undefined" for i, d in enumerate(columns)],
        "d0": ["Infinity" if math.isinf(d) else d for d in columns],
        "d2": gaps,
        "Bf": [total - 2.0 - gap + 0.1 * (i % zoom) for i, gap in enumerate(gaps)],
    }
    lines = "\n".join("\t".join([name, *(str(v) for v in values)]) for name, values in rows.items())
    lens = "1\t60\t5\t1.6\t20\n2\t-90\td2\t\t20\n3\t-200\t2\t1.7\t16\n4\t80\t0\t\t16\n5\tAS\tBf\t\t10\n"
    return f"[variable distances]\n{lines}\n[lens data]\n{lens}"


@pytest.mark.parametrize("focus", [math.inf, 9000.0, 3000.0, 2000.0, 1500.0, 1000.0, 800.0])
def test_variable_distances_at_a_focus_distance(tmp_path, focus):
    lens = load(tmp_path, focusing(), focus=focus)
    # One lens moves, so that the position in focus is that found by hand.
    assert np.diff(lens.vertices)[1] == pytest.approx(gap_in_focus(focus, TOTAL), abs=1e-10)
    assert float(lens.vertices[0]) - lens.specification.z_object == pytest.approx(focus)
    assert lens.specification.z_image - float(lens.vertices[1]) == pytest.approx(TOTAL, abs=1e-10)
    points = pl.paraxial.cardinal_points(lens, wavelength=LINE)
    z_image = points.rear_focus  # Newton: x x' = -f^2
    if math.isfinite(focus):
        z_image += points.efl**2 / (points.front_focus - lens.specification.z_object)
    assert z_image == pytest.approx(lens.specification.z_image, abs=1e-8)


def test_columns_out_of_focus_stay_so_in_between(tmp_path):
    """Both columns have their image 0.3 mm behind the sensor, and so has the position between them."""
    text = re.sub(
        r"Bf\t\S.*", lambda row: "Bf" + "".join(f"\t{float(b) - 0.3}" for b in row[0].split()[1:]), focusing()
    )
    lens = load(tmp_path, text, focus=1400.0)
    assert np.diff(lens.vertices)[1] == pytest.approx(gap_in_focus(1400.0, TOTAL), abs=1e-10)


def test_the_example_of_the_page_about_lenses(tmp_path, monkeypatch, capsys):
    page = (Path(__file__).parents[4] / "docs" / "lenses.md").read_text(encoding="utf-8")
    (code,) = (block for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if "focusing.txt" in block)
    monkeypatch.chdir(tmp_path)
    exec(code, {"pl": pl})
    printed = [float(line.split()[1]) for line in capsys.readouterr().out.splitlines()]
    assert printed == pytest.approx([gap_in_focus(d, TOTAL) for d in (math.inf, 2000.0, 1200.0, 800.0)], abs=1e-4)
    assert printed == pytest.approx([float(n) for n in code.rpartition("#")[2].strip(" m\n").split(", ")], abs=5e-4)


def test_focus_distances_of_a_zoom(tmp_path):
    text = focusing(zoom=2)
    for number, back in ((1, 0.0), (2, 0.1)):
        lens = load(tmp_path, text, configuration=number, focus=1200.0)
        assert lens.specification.z_image - float(lens.vertices[1]) == pytest.approx(TOTAL + back, abs=1e-12)
    assert load(tmp_path, text, focus=1200.0) == load(tmp_path, text, configuration=1, focus=1200.0)


@pytest.mark.parametrize(
    "text, focus, message",
    [
        (focusing(), 700.0, r"focus is 700 mm; lens.txt states 800 to inf mm \(d0\)"),
        (focusing((2000.0, 800.0)), math.inf, "focus is inf mm; lens.txt states 800 to 2000 mm"),
        (focusing((math.inf,)), 900.0, "focus is 900 mm; lens.txt states inf to inf mm"),
        (focusing(), -900.0, "focus is -900 mm; it must be above 0"),
        (
            re.sub(r"(?m)^(\d)\t-?\d+\t", r"\1\tInfinity\t", focusing()),
            4900.0,
            "no position between the columns of lens.txt",
        ),
        (focusing((math.inf, 800.0, math.inf)), 900.0, "does not state the same focus distances .* for each of 2 zoom"),
    ],
)
def test_focus_distances_that_are_not_stated(tmp_path, text, focus, message):
    with pytest.raises(InvalidValueError, match=message):
        load(tmp_path, text, focus=focus)
    with pytest.raises(InvalidValueError, match="only .txt files have variable distances by focus distance"):
        load_lens("singlet-100mm-f4", focus=900.0)


@pytest.mark.parametrize(
    "constants, numerals, powers",
    [
        ("", "1e-6\t-2e-9", {4: 1e-6, 6: -2e-9}),
        ("AsphericalA2\n", "1e-4\t1e-6\t-2e-9", {2: 1e-4, 4: 1e-6, 6: -2e-9}),
        ("AsphericalOddCount\t1\n", "0\t1e-6\t-2e-9", {4: 1e-6, 6: -2e-9}),
        ("AsphericalOddCount\t2\n", "0\t1e-6\t0\t-2e-9\t3e-12", {4: 1e-6, 6: -2e-9, 8: 3e-12}),
        (
            "AsphericalOddCount\t2\n",
            "2e-5\t1e-6\t-3e-7\t-2e-9\t3e-12",
            {3: 2e-5, 4: 1e-6, 5: -3e-7, 6: -2e-9, 8: 3e-12},
        ),
    ],
)
def test_aspheres_against_the_sag(tmp_path, constants, numerals, powers):
    text = TABLE.replace("[constants]\n", f"[constants]\n{constants}").replace("1e-6\t-2e-9", numerals)
    surface = next(e for e in load(tmp_path, text, configuration=1).elements if isinstance(e, Surface))
    r = 9.0
    sag = (r * r / 50) / (1 + math.sqrt(1 - 0.5 * (r / 50) ** 2)) + sum(a * r**p for p, a in powers.items())
    assert surface.sag(r) == pytest.approx(sag, rel=1e-13)


def test_glasses_by_name_if_their_index_is_that_of_the_table(tmp_path):
    named = TABLE.replace("1.5168\t30\t64.2", "1.5168\t30\t64.2\tN-BK7\tSchott").replace(
        "1.6\t20\t40", "1.6\t20\t40\tN-BK7\tSchott"
    )
    media = [e.medium for e in load(tmp_path, named, configuration=1).elements if isinstance(e, Surface)]
    assert media[2] == ModelGlass(1.6, 40.0)
    assert media[4] == pl.glass("N-BK7")


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("[lens data]", "[data]", r"there is no section \[lens data\]; the tables that can be read are"),
        ("1\t50\t-0.5", "1\t51\t-0.5", r"line 23: the radius is 51 in \[aspherical data\], 50 in \[lens data\]"),
        ("1\t50\t-0.5", "9\t50\t-0.5", r"line 23: \[aspherical data\] names surface '9', which does not exist"),
        ("[constants]\n", "[constants]\nAsphericalA2\nAsphericalOddCount\t1\n", "the order of the powers of r"),
        ("1\t50\t4", "1\tabout 50\t4", "line 15: the radius is 'about 50'; it must be a number"),
    ],
)
def test_messages(tmp_path, old, new, message):
    with pytest.raises(PrescriptionError, match=message):
        load(tmp_path, TABLE.replace(old, new), configuration=1)
