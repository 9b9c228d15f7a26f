"""Public Zemax files: those that the package rayoptics ships. Focal lengths are optiland's (version 0.6.3)."""

import importlib.util
from pathlib import Path

import pytest

import plenoptic as pl
from plenoptic.errors import PrescriptionError

SPEC = importlib.util.find_spec("rayoptics")
FOLDERS = [] if SPEC is None else [Path(folder) for folder in SPEC.submodule_search_locations or ()]
FILES = {path.stem: path for folder in FOLDERS for path in folder.rglob("*.[zZ][mM][xX]")}
pytestmark = [
    *(pytest.mark.validation, pytest.mark.skipif(not FILES, reason="needs the package rayoptics")),
    pytest.mark.filterwarnings("ignore::plenoptic.errors.FileWarning"),
]

# mm, at the primary wavelength; for the two before the last the index of fused silica differs by 1.4e-9, and that of
# BK7, here the glass of 1992 and there N-BK7, by 1e-5; of the last one that of a glass known by n_d and V_d by 4e-7.
FOCAL_LENGTHS = {"US00583336-2-scaled": (49.38897584676335, 1e-9), "HoO-V2C18Ex03": (80.09343065693426, 1e-13)}
FOCAL_LENGTHS |= {"HoO-V2C18Ex66": (90.05187904998931, 1e-13), "HoO-V2C18Ex66NEW": (90.05187904998931, 1e-13)}
FOCAL_LENGTHS |= {"US05331467-1": (999.6369653778445, 1e-13), "US05831776-1": (494.02032877703374, 1e-7)}
FOCAL_LENGTHS |= {"zmax_55278": (52.24355673278863, 2e-5), "HoO-V2C18Ex27": (24.608678562469894, 1e-7)}

# mm: x and y of a ray parallel to the axis in front of the lens, and those that optiland has in the image, in its axes.
# The last one has four tilted mirrors.
REAL_RAYS = [
    ("HoO-V2C18Ex03", (0.0, 7.0081751824817475), (0.0, -2.8241842211507162e-06)),
    ("US05331467-1", (0.0, 46.649725050966076), (0.0, -0.02417936563814127)),
    ("HoO-V2C18Ex66NEW", (2.0, 2.0), (0.00040767670824948254, 0.00033085948532567724)),
]
REFUSED = {"354710-C-Zemax(ZMX)": "no glass 'D-ZK3M'", "HoO-V2C18Ex46": "surface 7 is of type TOROIDAL"}
REFUSED |= {"ASL5040-UV-Zemax(ZMX)": "surface 1 is of type QED_TYPE"}
REFUSED |= {"US08011793-1": "SQAP: rectangular apertures", "US08427765-1": "no glass 'L-TIM28_MOLD'"}
REFUSED |= {"zmax_37992": "the aperture is decentred"}
GIVEN = {"354710-C-Zemax(ZMX)": "D-ZK3M", "US08427765-1": "L-TIM28_MOLD"}


def test_focal_lengths_and_rays_are_those_of_another_program():
    for name, (expected, error) in FOCAL_LENGTHS.items():
        lens = pl.load_lens(FILES[name])
        efl = pl.paraxial.cardinal_points(lens, lens.specification.wavelengths[0]).efl
        assert efl == pytest.approx(expected, rel=error), name
    for name, start, expected in REAL_RAYS:
        lens = pl.load_lens(FILES[name])
        ray = pl.RayBundle([[*start, -500.0]], [[0.0, 0.0, 1.0]], lens.specification.wavelengths[0])
        # Some ten surfaces, each with roundings of 500 mm.
        found = lens.trace(ray).at_z(lens.specification.z_image)[0, :2]
        assert found == pytest.approx(expected, abs=1e-12), name


def test_what_is_no_lens_is_refused_with_the_reason_and_a_glass_that_is_missing_may_be_given():
    for name, said in REFUSED.items():
        with pytest.raises(PrescriptionError, match=rf"line \d+: .*{said}"):
            pl.load_lens(FILES[name])
    for name, missing in GIVEN.items():
        lens = pl.load_lens(FILES[name], glasses={missing: pl.ConstantMedium(1.6), "BK7": pl.glass("N-BK7")})
        assert pl.paraxial.cardinal_points(lens, 587.6).efl > 0, name
