"""CODE V sequences: small lenses against matrices by hand, and messages."""

import math

import numpy as np
import pytest

import plenoptic as pl
from plenoptic import RayBundle, Surface, load_lens
from plenoptic.errors import FileWarning, InvalidValueError, PrescriptionError
from plenoptic.optics import ConstantMedium, ModelGlass, RingStop

HEAD = "RDM;LEN; DIM M; EPD 10; WL 587.6 486.1; REF 1; YAN 0 2"
REL = 1e-12
"""Of some ten roundings."""


def load(folder, *surfaces: str, head: str = HEAD, **options: object) -> pl.LensStack:
    text = "\n".join([head, "SO 0 1e11", *surfaces, "SI 0 0", "GO"])
    (folder / "lens.seq").write_text(text, encoding="utf-8")
    return load_lens(folder / "lens.seq", **options)


def thick_lens(r_1: float, r_2: float, t: float, n: float) -> float:
    """Focal length by the lensmaker's equation."""
    return 1.0 / ((n - 1.0) * (1.0 / r_1 - 1.0 / r_2 + (n - 1.0) * t / (n * r_1 * r_2)))


def efl(lens: pl.LensStack) -> float:
    return pl.paraxial.cardinal_points(lens, wavelength=lens.specification.wavelengths[0]).efl


@pytest.mark.parametrize("unit, mm", [("M", 1.0), ("MM", 1.0), ("C", 10.0), ("I", 25.4)])
@pytest.mark.parametrize("mode", ["RDM", "RDM Y", "rdm n"])
def test_radii_or_curvatures_in_a_unit(tmp_path, unit, mm, mode):
    c = (1 / 50, -1 / 80) if mode == "rdm n" else (50.0, -80.0)
    head = HEAD.replace("DIM M", f"DIM {unit}").replace("RDM", mode)
    lens = load(tmp_path, f"s {c[0]!r} 4 1.5:0  ! a comment; S 1 1", f"s {c[1]!r} &", "70", "sto", head=head)
    assert efl(lens) == pytest.approx(mm * thick_lens(50.0, -80.0, 4.0, 1.5), rel=REL)
    assert lens.specification.wavelengths == (587.6, 486.1)
    assert lens.specification.z_image - lens.vertices[-1] == pytest.approx(70 * mm)
    assert lens.specification.entrance_pupil_diameter == pytest.approx(10.0 * mm)


def test_the_image_is_moved_by_its_thickness_and_forms_with_a_surface_change_it(tmp_path):
    (tmp_path / "a.seq").write_text(
        f"{HEAD}\nSO 0 1e11\nS 50 4 1.5:0\nS -80 70\nTHI S2 60; RDY S1 40\nTHI S1 HMY 0\nSI 0 -1.5\n"
    )
    lens = load_lens(tmp_path / "a.seq")
    assert efl(lens) == pytest.approx(thick_lens(40.0, -80.0, 4.0, 1.5), rel=REL)
    assert lens.specification.z_image - lens.vertices[-1] == pytest.approx(58.5)


def test_aspheres_against_the_sag(tmp_path):
    """Rays parallel to the axis meet the surface at its sag: conic, r^4 and r^20, in inch."""
    head = HEAD.replace("DIM M", "DIM I").replace("EPD 10", "EPD 1")
    lens = load(tmp_path, "S 2 .3 1.5:0", "ASP; K -0.5; A 1e-3", "J -2e-3", "S 0 3", head=head)
    r = 0.4
    sag = (r * r / 2) / (1 + math.sqrt(1 - 0.5 * (r / 2) ** 2)) + 1e-3 * r**4 - 2e-3 * r**20
    surface = next(e for e in lens.elements if isinstance(e, Surface))
    assert surface.sag(25.4 * r) == pytest.approx(25.4 * sag, rel=1e-12)


@pytest.mark.parametrize(
    "name, medium",
    [
        ("517642", ModelGlass(1.517, 64.2)),
        ("517.642", ModelGlass(1.517, 64.2)),
        ("517000.642000", ModelGlass(1.517, 64.2)),
        ("516800.641700", ModelGlass(1.5168, 64.17)),
        ("1.5168:64.17", ModelGlass(1.5168, 64.17)),
        ("1.6:0", ConstantMedium(1.6)),
        ("NBK7_SCHOTT", pl.glass("N-BK7")),
        ("SLAL8_OHARA", pl.glass("S-LAL8")),
    ],
)
def test_glasses(tmp_path, name, medium):
    lens = load(tmp_path, f"S 50 4 {name}", "S -80 70")
    assert next(e for e in lens.elements if isinstance(e, Surface)).medium == medium


def test_glasses_of_the_file(tmp_path):
    """Laurent's formula as stated; a table made by it is met at wavelengths between."""
    a = (2.27, -0.01, 0.0106, 2e-4, -7e-6, 5e-7)
    n = lambda w: math.sqrt(sum(k * (w * 1e-3) ** p for k, p in zip(a, (0, 2, -2, -4, -6, -8), strict=True)))  # noqa: E731
    waves = (1000.0, 850.0, 700.0, 650.0, 587.6, 546.1, 486.1, 435.8)
    table = " ".join(repr(n(w)) for w in waves)
    catalogue = f"PRV\nPWL {' '.join(map(str, waves))}\n'tab' {table}\n'lau' LAU {' '.join(map(str, a))}\nEND"
    lens = load(tmp_path, "S 50 4 'tab'", "S -60 2 'LAU'", "S -80 70", head=f"{HEAD}\n{catalogue}")
    tab, lau = [e.medium for e in lens.elements if isinstance(e, Surface)][:2]
    for wave in (587.6, 610.0, 450.0):
        assert lau.index(wave) == pytest.approx(n(wave), rel=1e-15)
        assert tab.index(wave) == pytest.approx(n(wave), abs=1e-9)


def test_mirrors_apertures_and_the_default_stop(tmp_path):
    """Paraboloid: f = -R / 2; the stop is surface 1, and its hole stops light."""
    lens = load(tmp_path, "S -400 -200 REFL", "CON; K -1", "CIR 30", "CIR HOL 4", "CIR EDG 90")
    assert efl(lens) == pytest.approx(200.0, rel=REL)
    ring = next(e for e in lens.elements if isinstance(e, RingStop))
    assert ring.inner_semi_diameter == 4.0
    assert lens.stop.semi_diameter == pytest.approx(5.0)
    assert max(e.semi_diameter for e in lens.elements if isinstance(e, Surface)) == 30.0


def test_a_plane_mirror_with_bend_is_unfolded(tmp_path):
    straight = load(tmp_path, "S 50 4 1.5:0", "STO", "S -80 70")
    folded = load(tmp_path, "S 50 4 1.5:0", "STO", "S -80 30", "S 0 -40 REFL", "ADE 45; BEN")
    assert efl(folded) == pytest.approx(efl(straight), rel=REL)
    assert folded.specification.z_image == pytest.approx(straight.specification.z_image, rel=REL)


@pytest.mark.parametrize("command, diameter", [("FNO 4", None), ("NA .125", None), ("EPD 8", 8.0)])
def test_system_apertures(tmp_path, command, diameter):
    """f / 4 is a numerical aperture of 1 / 8 for a far object."""
    lens = load(tmp_path, "S 50 4 1.5:0", "S -80 70", head=HEAD.replace("EPD 10", command))
    assert lens.specification.entrance_pupil_diameter == pytest.approx(diameter or efl(lens) / 4.0, rel=REL)


@pytest.mark.parametrize("kind", ["XAN 0 1; YAN 0 2", "XOB 0 10; YOB 0 20", "XIM 0 1; YIM 0 2"])
def test_fields(tmp_path, kind):
    head = HEAD.replace("YAN 0 2", kind)
    (tmp_path / "lens.seq").write_text(
        f"{head}\nSO 0 {100 if 'OB' in kind else 1e11}\nS 50 4 1.5:0\nS -80 70\nSI 0 0\n"
    )
    fields = load_lens(tmp_path / "lens.seq").specification.fields
    assert fields.shape == (2, 2)
    if "OB" in kind:
        np.testing.assert_array_equal(fields, [(0, 0), (10, 20)])
    assert fields[1, 1] / fields[1, 0] == pytest.approx(2.0, rel=1e-3)


def test_zoom_positions(tmp_path):
    """The second thickness counts in the second position; other data are named."""
    zoom = "ZOO 2\nZOO THI S2 20 30\nZOO EPD 10 8\nZOO THC S2 0 0\nZOO CIR S1 1 2"
    surfaces = ("S 50 4 1.5:0", "S -80 20", "S -100 3 1.5:0", "S 200 50")
    lines = "\n".join([HEAD, "SO 0 1e11", *surfaces, "SI 0 0", zoom])
    (tmp_path / "a.seq").write_text(lines)
    with pytest.warns(
        FileWarning, match=r"first of 2 zoom positions \(ZOO; choose by configuration=\), zoom data of CIR"
    ):
        first = load_lens(tmp_path / "a.seq")
    with pytest.warns(FileWarning, match="zoom data of CIR"):
        second = load_lens(tmp_path / "a.seq", configuration=2)
    same = load(tmp_path, *[s.replace("-80 20", "-80 30") for s in surfaces], head=HEAD.replace("EPD 10", "EPD 8"))
    assert efl(second) == pytest.approx(efl(same), rel=REL)
    assert second.stop.semi_diameter == pytest.approx(same.stop.semi_diameter, rel=REL)
    assert efl(first) != pytest.approx(efl(second), rel=1e-3)
    with pytest.raises(InvalidValueError, match=r"configuration is 3; a.seq has 2 \(ZOO\)"):
        load_lens(tmp_path / "a.seq", configuration=3)


def test_ignored_data_are_named(tmp_path):
    with pytest.warns(FileWarning, match=r"vignetting factors \(.*the temperature \(30.0 C, TEM\), the command XYZ"):
        load(tmp_path, "S 50 4 1.5:0", "XYZ 3", "S -80 70", head=f"{HEAD}; VUY 0 .2; TEM 30.0; WTW 1 1")


@pytest.mark.parametrize(
    "surfaces, head, message",
    [
        (
            ("S 50 4 1.5:0",),
            "EPD 10",
            "line 3: S has 50 before RDM states if it is a radius or a curvature; add a line",
        ),
        (("S 50 4 NOGLASS_X",), HEAD, "line 3: there is no glass 'NOGLASS'"),
        (("S 50 4 1.5:0", "ADE 5"), HEAD, r"line 3: surface 1 is tilted or decentred \(ADE\)"),
        (("S 50 4 1.5:0", "DAR"), HEAD, "line 4: DAR: tilts and decentres cannot be read"),
        (("S 50 4 1.5:0", "DIF DOE"), HEAD, "line 4: DIF: diffractive surfaces cannot be read"),
        (("S 50 4 1.5:0", "REX 5"), HEAD, "line 4: REX: apertures that are not round cannot be read"),
        (("S 50 4 1.5:0", "CUF .1"), HEAD, "line 4: CUF: Fresnel surfaces cannot be read"),
        (("S 50 4,2 1.5:0",), HEAD, "line 3: S is '4,2'; it must be a number"),
        (("S 50",), HEAD, "line 3: S has 1 entries; it must have 2 or more"),
        (("S 50 4 1.5:0", "THI S9 3"), HEAD, "line 4: S9 names a surface that the file does not have"),
        (("S 50 4 1.5:0", "SO 0 1"), HEAD, "line 4: SO stands here; a lens has SO first"),
        (("S 50 4 1.5:0", "S -80 3"), HEAD.replace("REF 1", "REF 3"), "REF is 3; WL has 2 wavelengths"),
        (("S 50 4 1.5:0", "S -80 3"), HEAD.replace("DIM M", "DIM X"), "DIM is 'X'; it must be M"),
        (("S 50 4 'q'",), f"{HEAD}\nPRV\nPWL 500 600\n'q' 1.5\nEND", "line 4: the glass 'q' is neither LAU"),
        (("S 50 4 'q'",), f"{HEAD}\nPRV\nPWL 500 550 600 650\n'q' 1.5 1.6 1.4 -1\nEND", "line 4: PRV: 'q' needs"),
    ],
)
def test_messages(tmp_path, surfaces, head, message):
    with pytest.raises(PrescriptionError, match=message):
        load(tmp_path, *surfaces, head=head)


def test_a_file_without_an_image_is_refused(tmp_path):
    (tmp_path / "a.seq").write_text(f"{HEAD}\nSO 0 1e11\nS 50 3 1.5:0\nS -50 3\n")
    with pytest.raises(PrescriptionError, match=r"an image \(SI\); it has 3 of them, and no SI"):
        load_lens(tmp_path / "a.seq")


def test_an_obscuration_stops_light(tmp_path):
    lens = load(tmp_path, "S 50 4 1.5:0", "CIR OBS 2", "S -80 70")
    heights = np.array([1.9, 2.1, 4.9, 5.1])
    start = np.column_stack([0 * heights, heights, 0 * heights - 9.0])
    passes = lens.trace(RayBundle(start, np.tile([0.0, 0.0, 1.0], (4, 1)))).status == 0
    assert passes.tolist() == [False, True, True, False]
