"""Curves of one figure are told apart by those who do not tell red from green."""

import itertools

import numpy as np
import pytest

pytest.importorskip("matplotlib")
from matplotlib.colors import to_rgb

from plenoptic.core.color.srgb import srgb_to_linear
from plenoptic.plots.canvas import COLOURS, wavelength_colours

# F. Vienot, H. Brettel and J. D. Mollon, Color Res. Appl. 24, 243 (1999), on linear sRGB.
PROTANOPE = np.array([[0.11238, 0.88762, 0.0], [0.11238, 0.88762, 0.0], [0.00401, -0.00401, 1.0]])
DEUTERANOPE = np.array([[0.29275, 0.70725, 0.0], [0.29275, 0.70725, 0.0], [-0.02234, 0.02234, 1.0]])
# IEC 61966-2-1.
TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def lab(colour, seen_by):
    """CIELAB of a colour as somebody sees it."""
    xyz = TO_XYZ @ np.clip(seen_by @ srgb_to_linear(np.array(to_rgb(colour))), 0.0, 1.0)
    x, y, z = np.cbrt(np.maximum(xyz / TO_XYZ.sum(axis=1), 1e-6))
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


def test_colours_are_told_apart():
    # A difference of 2.3 is just seen side by side; thin lines and dots apart take several times as much.
    kinds = ((COLOURS, 18), (wavelength_colours([400, 500, 600]), 35), (wavelength_colours(range(5)), 10))
    for seen_by in (np.eye(3), PROTANOPE, DEUTERANOPE):
        for colours, least in kinds:
            seen = [lab(colour, seen_by) for colour in colours]
            assert min(np.linalg.norm(a - b) for a, b in itertools.combinations(seen, 2)) > least, (seen_by, least)


def test_longer_wavelengths_are_lighter():
    lightness = [lab(colour, np.eye(3))[0] for colour in wavelength_colours([650.0, 450.0, 550.0])]
    assert lightness[1] < lightness[2] < lightness[0] < 80  # and lines stand out against white
