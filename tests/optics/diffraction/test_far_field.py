"""Bends drawn from far-field patterns, against the overlap of an opening with itself and closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from plenoptic.optics.diffraction.far_field import far_field
from plenoptic.optics.diffraction.kernels.far_field import fill_deflections
from plenoptic.optics.microlens.aperture import Opening
from plenoptic.optics.microlens.lattice import polygon_area, regular_polygon

SQUARE = regular_polygon(4, math.sqrt(0.5), math.pi / 4)
HEXAGON = regular_polygon(6, 1.0, 0.0)
DRAWS = 1 << 17


def drawn(opening, around=None, turn=None):
    """Bends (n, 4) for evenly spread numbers."""
    i = np.arange(DRAWS)
    numbers = np.column_stack([(i + 0.5) / DRAWS, np.modf(i * 0.6180339887498949)[0]])
    bends = np.empty((DRAWS, 4))
    fill_deflections(bends, numbers, far_field(opening, around, np.eye(2) if turn is None else turn))
    return bends


def contrast(bends, shift, weight=1.0):
    """Estimate, from sampled deflections, of the overlap of the opening with itself, moved by a shift."""
    return float((weight * np.cos(2 * np.pi * bends[:, :2] @ np.asarray(shift))).mean())


def overlap(corners, shift):
    """Overlap of a convex polygon with itself, moved, over its area: clipped by its own moved edges."""
    polygon = list(corners)
    moved = corners + shift
    for start, end in zip(moved, np.roll(moved, -1, axis=0), strict=True):
        along, cut = end - start, []
        inside = [along[0] * (p - start)[1] - along[1] * (p - start)[0] for p in polygon]
        for k, p in enumerate(polygon):
            before, a, b = polygon[k - 1], inside[k - 1], inside[k]
            if a * b < 0:
                cut.append(before + (p - before) * a / (a - b))
            if b >= 0:
                cut.append(p)
        polygon = cut
        if len(polygon) < 3:
            return 0.0
    return polygon_area(np.array(polygon)) / polygon_area(corners)


@settings(max_examples=6, deadline=None)
@given(st.integers(3, 9), st.floats(0.1, 10.0), st.floats(0.0, 6.0), st.floats(0.0, 6.0), st.floats(0.05, 0.9))
def test_contrast_is_the_overlap_of_a_polygon_with_itself(sides, size, first, direction, part):
    # The Wiener-Khinchin theorem. Cells of a sixteenth of a period blur 0.2 % away, and 3 % of the light, beyond the
    # tabulated disc, is that of edges each by itself.
    corners = size * regular_polygon(sides, 1.0, first)
    shift = part * size * np.array([math.cos(direction), math.sin(direction)])
    assert contrast(drawn(Opening(corners)), shift) == pytest.approx(overlap(corners, shift), abs=5e-3)


def test_a_circle_has_airys_rings():
    bends = drawn(Opening(HEXAGON, radius=0.5))
    radius = np.hypot(bends[:, 0], bends[:, 1])
    # Encircled energy 1 - J0^2 - J1^2 at the dark rings (Born and Wolf, section 8.5.2), and its tail 2 / (pi^2 r).
    assert_allclose([(radius < r).mean() for r in (1.2197, 2.2331, 3.2383)], [0.8378, 0.9099, 0.9376], atol=1e-3)
    for far in (10.0, 100.0, 1000.0):
        assert (radius > far).mean() == pytest.approx(2 / (np.pi**2 * far), rel=0.05)
    for part in (0.25, 0.5, 0.75):
        exact = 2 / np.pi * (math.acos(part) - part * math.sqrt(1 - part**2))
        assert contrast(bends, (part, 0.0)) == pytest.approx(exact, abs=2e-3)


def test_light_beside_openings_bends_as_babinet_says():
    opening, area = Opening(SQUARE * 0.8), 0.64
    bends = drawn(opening, SQUARE)
    through, gap = area * bends[:, 2], (1 - area) * bends[:, 3]
    # To the last bit in the disc; beyond, each adds up to its part.
    assert (np.abs(through + gap - 1.0) < 1e-12).mean() > 0.9
    for shift in ((0.1, 0.0), (0.2, 0.3), (0.05, 0.4)):
        opening_only = area * overlap(opening.corners, np.array(shift))
        assert contrast(bends, shift, through) == pytest.approx(opening_only, abs=4e-3)
        # The frame's: the cell's, less twice what cell and opening share, and the opening's.
        common = math.prod(min(0.5, 0.4 + s) - max(-0.5, -0.4 + s) for s in shift)
        frame = overlap(SQUARE, np.array(shift)) - 2 * common + opening_only
        # Beyond the disc edges count alone, also where they are as near to each other as the sides of this frame.
        assert contrast(bends, shift, gap) == pytest.approx(frame, abs=0.012)


def test_a_turned_opening_has_a_turned_pattern():
    angle = 0.3
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    straight, turned = drawn(Opening(SQUARE)), drawn(Opening(SQUARE), turn=turn)
    assert_allclose(turned[:, :2], straight[:, :2] @ turn.T, rtol=1e-12, atol=1e-12)
