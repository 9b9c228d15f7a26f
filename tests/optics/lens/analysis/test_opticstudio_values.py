"""Lenses against values that others read out of Ansys Zemax OpticStudio.

Source of all numbers: https://github.com/optiland/optiland/issues/710 and the pull request 714. The singlet is by
OpticStudio 2025 R2.02, the triplet by 2026 R1.00, Hubble (M. Laikin, Lens Design, 4th ed., 2007, p. 200) by 2023 R1.02.
"""

import math

import numpy as np
import pytest

import plenoptic as pl

FIELD = math.radians(0.15)
PUPIL = 1200.0
HUBBLE = f"""MODE SEQ
UNIT MM
ENPD 2400
FTYP 0 0 2 1
XFLN 0 0
YFLN 0 0.15
WAVM 1 0.55 1
PWAV 1
SURF 0
DISZ INFINITY
SURF 1
DISZ 4910.01016
SURF 2
STOP
CURV {-1 / 11040.02286}
CONI -1.001152
DISZ -4910.01016
GLAS MIRROR 0 0
CLAP 177.80035 1300
SURF 3
CURV {-1 / 1349.31166}
CONI -1.483014
DISZ 6365.20955
GLAS MIRROR 0 0
SURF 4
CURV {-1 / 635.38227}
"""
HUBBLE_RAYS = [
    ((0.0, 0.0, 0.0, 1.0), (0.0, 0.000292798, 0.0, -0.020832193)),
    ((0.0, 0.0, 0.0, 0.7), (0.0, 0.000224337, 0.0, -0.014582932)),
    ((0.0, 1.0, 0.0, 0.0), (0.0, 150.423380108, 0.0, 0.021668821)),
    ((0.0, 1.0, 0.0, 1.0), (0.0, 150.415481283, 0.0, 0.000731952)),
    ((0.0, 1.0, 0.0, -1.0), (0.0, 150.483684128, 0.0, 0.042499115)),
    ((0.0, 0.7, 0.7, 0.0), (0.011252785, 105.43303112, -0.014598926, 0.015153183)),
]
"""(Hx, Hy, Px, Py) and (x, y, L, M) on the curved image surface."""


@pytest.fixture(scope="module")
def hubble(tmp_path_factory):
    path = tmp_path_factory.mktemp("opticstudio") / "hubble.zmx"
    path.write_text(HUBBLE)
    return pl.load_lens(path)


def test_hubble_first_order(hubble):
    """Tolerances: half the last printed digit; the focal length was read from a file of 9 digits."""
    points, z = pl.paraxial.cardinal_points(hubble, wavelength=550.0), hubble.specification
    assert points.efl == pytest.approx(57600.079948, abs=2e-3)
    assert 2.0 * points.entrance_pupil_semi_diameter == pytest.approx(2400.0, abs=1e-9)
    assert 2.0 * points.exit_pupil_semi_diameter == pytest.approx(289.9321, abs=5e-5)
    assert points.exit_pupil - z.z_image == pytest.approx(-6958.364, abs=1e-3)
    assert points.f_number == pytest.approx(24.00003, abs=5e-6)
    assert points.rear_focus - z.z_image == pytest.approx(0.01686423, abs=1e-6)


def test_hubble_third_order(hubble):
    """Six decimals are printed; S_V and odd signs depend on conventions."""
    sums = pl.aberrations.seidel_sums(hubble, field=FIELD, wavelength=550.0)
    listed = [0.000003, 0.000337, 0.001452, 0.012841, 0.000760]
    np.testing.assert_allclose(np.abs(sums.total), listed, atol=5.1e-7, rtol=0)


@pytest.mark.parametrize("fields, image", HUBBLE_RAYS)
def test_hubble_real_rays(tmp_path, fields, image):
    """Nine decimals are printed, of a prescription of nine digits: 1e-6 mm and 1e-8. Wider rims let all rays pass."""
    wide = HUBBLE.replace("CLAP 177.80035 1300\n", "").replace("ENPD 2400", "ENPD 2402").replace("0.15", "0.3")
    (tmp_path / "hubble.zmx").write_text(wide)
    lens = pl.load_lens(tmp_path / "hubble.zmx")
    _, h_y, p_x, p_y = fields
    direction = np.array([0.0, math.sin(h_y * FIELD), math.cos(h_y * FIELD)])
    through = np.array([PUPIL * p_x, PUPIL * p_y, float(lens.vertices[0])])
    out = lens.trace(pl.RayBundle((through - 6000.0 * direction)[None], direction[None], wavelength=550.0))
    vertex, radius, d = lens.specification.z_image, lens.specification.image_radius, out.direction[0]
    p = out.at_z(vertex)[0] - [0.0, 0.0, vertex + radius]
    b = float(p @ d)
    on_image = p + (-b - math.copysign(1.0, radius) * math.sqrt(b * b - float(p @ p) + radius**2)) * d
    assert out.status[0] == 0
    np.testing.assert_allclose(on_image[:2], image[:2], atol=1e-6, rtol=0)
    np.testing.assert_allclose(d[:2], image[2:], atol=1e-8, rtol=0)


def test_singlet_first_order(tmp_path):
    """SingletStopSurf2: LAC9 of Hoya, the stop at its rear surface."""
    text = f"""UNIT MM
ENPD 25
FTYP 0 0 3 3
XFLN 0 0 0
YFLN 0 3.5 5
WAVM 1 0.4861327 1
WAVM 2 0.5875618 1
WAVM 3 0.6562725 1
PWAV 2
GCAT HOYA
SURF 0
DISZ INFINITY
SURF 1
CURV {1 / 63.73364157}
DISZ 10
GLAS LAC9
SURF 2
STOP
CURV {1 / 653.2939232}
DISZ 92.7383463
SURF 3
"""
    (tmp_path / "singlet.zmx").write_text(text)
    figures = {
        101.501826: "efl", 25.0: "epd", 6.318809: "entrance", 23.397108: "xpd", -92.738346: "exit", 4.060073: "number",
        2.255622: "focus", -99.246204: "rear", 1.093608: "invariant",
    }  # fmt: skip
    first_order = _first_order(pl.load_lens(tmp_path / "singlet.zmx"), 5.0)
    for listed, name in figures.items():
        assert first_order[name] == pytest.approx(listed, abs=6e-7, rel=0), name


def test_cooke_triplet_first_order(tmp_path):
    """Fifteen digits are listed, by OpticStudio 2026 R1.00; SK16 of Hikari, F2 of Schott."""
    surfaces = (
        (22.01359, 3.25896, "SK16"), (-435.76044, 6.00755, ""), (-22.21328, 0.99997, "F2"), (20.29192, 4.75041, ""),
        (79.68360, 2.95208, "SK16"), (-18.39533, 42.20778, ""),
    )  # fmt: skip
    head = "UNIT MM;ENPD 10;FTYP 0 0 1 1;XFLN 0;YFLN 20;WAVM 1 0.55 1;PWAV 1;GCAT SCHOTT HIKARI;SURF 0;DISZ INFINITY"
    rows = [
        f"SURF {i};CURV {1 / radius!r};DISZ {gap}{glass and f';GLAS {glass}'}{';STOP' * (i == 4)}"
        for i, (radius, gap, glass) in enumerate(surfaces, start=1)
    ]
    (tmp_path / "cooke.zmx").write_text(";".join([head, *rows, "SURF 7"]).replace(";", "\n"))
    figures = {
        49.99978307143194: "efl", 10.0: "epd", 11.51215867374679: "entrance", 10.23372956403460: "xpd",
        -50.96134802390034: "exit", 4.999978307143193: "number", 0.2070775589588518: "focus",
        -49.79270551247308: "rear", 1.819851171331012: "invariant",
    }  # fmt: skip
    first_order = _first_order(pl.load_lens(tmp_path / "cooke.zmx"), 20.0)
    for listed, name in figures.items():
        # Its exit pupil follows from rays that are not quite paraxial.
        assert first_order[name] == pytest.approx(listed, rel=2e-8 if name in ("xpd", "exit") else 2e-12), name


def _first_order(lens: pl.LensStack, angle: float) -> dict[str, float]:
    """Figures of the listings; the angle of the field in degrees."""
    wave, z = lens.specification.wavelengths[0], lens.specification.z_image
    points = pl.paraxial.cardinal_points(lens, wavelength=wave)
    chief = pl.paraxial.chief_ray(lens, math.radians(angle), wavelength=wave)
    return {
        "efl": points.efl,
        "epd": 2.0 * points.entrance_pupil_semi_diameter,
        "entrance": points.entrance_pupil - float(lens.vertices[0]),
        "xpd": 2.0 * points.exit_pupil_semi_diameter,
        "exit": points.exit_pupil - z,
        "number": points.f_number,
        "focus": points.rear_focus - z,
        "rear": points.rear_principal - z,
        "invariant": abs(pl.paraxial.lagrange_invariant(pl.paraxial.marginal_ray(lens, wavelength=wave), chief)),
    }
