"""The lenses that come with the package have the focal length and the image that their sources state."""

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.optics.glass.media import D_LINE

# mm: focal length and distance of the paraxial image from the last vertex; nan where the source states none. Of those
# of Smith's book the focal length is nominal, and indices have three decimals: 0.0005 / 0.7 of 100 mm is 0.07, and
# there are several.
STATED = {
    "achromat-100mm-f4.4": (100.1, np.nan, 0.1),
    "achromat-pair-52mm-f2.4": (np.nan, 43.7077, 2e-3),
    "asphere-15mm-f0.9": (15.0, 11.5067, 5e-3),
    "biotar-100mm-f1.4": (100.0, 64.69, 0.25),
    "cooke-triplet-50mm-f5": (50.0, np.nan, 1e-3),
    "double-gauss-100mm-f1.1": (100.0, 55.742, 0.1),
    "double-gauss-100mm-f2": (np.nan, 72.228, 0.15),
    "double-gauss-105mm-f1.4": (np.nan, 62.112, 0.15),
    "field-corrector-127mm-f3.5": (127.0, np.nan, 0.1),
    "fisheye-100mm-f8": (100.0, 150.119, 0.15),
    "metrogon-100mm-f6.3": (100.0, 79.729, 0.3),
    "mirror-1000mm-f7.5": (999.637, np.nan, 1e-3),  # by the program optiland, from the same file
    "protar-98mm-f12.5": (np.nan, 95.013, 0.1),
    "retrofocus-100mm-f1.9": (100.0, 178.126, 0.1),
    "telephoto-100mm-f2.8": (100.0, 22.862, 0.25),
    "topogon-100mm-f6.3": (np.nan, 77.809, 0.15),
    "zoom-14mm-f4": (np.nan, 21.36, 1e-3),
}

# mm: the distance that the source prints for the sharpest image, and by how much it may differ.
# That of the mirror lens is where its file has the image.
SHARPEST = {
    "cooke-triplet-50mm-f5": (42.20778, 0.06),
    "field-corrector-127mm-f3.5": (1.159 * 25.4, 0.09),
    "heliar-254mm-f5": (8.5066 * 25.4, 0.24),
    "mirror-1000mm-f7.5": (75.7409, 0.36),
    "petzval-51mm-f1.4": (0.3921 * 25.4, 0.09),
    "tessar-102mm-f4.5": (3.4025 * 25.4, 0.06),
}


def test_focal_length_and_image_are_those_that_the_source_states():
    for name in STATED:
        lens, (efl, image, error) = pl.load_lens(name), STATED[name]
        wavelength = D_LINE if lens.specification is None else lens.specification.wavelengths[0]
        points = pl.paraxial.cardinal_points(lens, wavelength)
        for found, stated in ((points.efl, efl), (points.bfl, image)):
            assert np.isnan(stated) or found == pytest.approx(stated, abs=error), name


@pytest.mark.slow
def test_the_printed_image_is_the_sharpest_one():
    for name, (printed, error) in SHARPEST.items():
        lens = pl.load_lens(name)
        told, last = lens.specification, float(lens.vertices[-1])
        assert told.z_image - last == pytest.approx(printed, abs=1e-5), name
        # In steps of 0.06 mm.
        distances = printed + np.linspace(-0.6, 0.6, 21)
        blur = np.zeros(21)
        for field in told.fields:
            how = {"field": field, "wavelength": told.wavelengths}
            blur += [pl.aberrations.spot_diagram(lens, z_image=last + d, **how).rms_radius ** 2 for d in distances]
        assert distances[blur.argmin()] == pytest.approx(printed, abs=error + 1e-9), name
