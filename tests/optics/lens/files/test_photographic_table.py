"""Descriptive tables of photographic lenses against matrices by hand, and messages."""

import math

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
