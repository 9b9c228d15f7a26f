import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import plenoptic as pl
from plenoptic.optics.microlens.aperture import opening_of
from plenoptic.optics.microlens.lattice import cell_polygon, polygon_area, polygon_edges

EPS = np.finfo(float).eps
Shape = pl.optics.ApertureShape
PITCHES = {pl.Lattice.HEXAGONAL: (1.0, 1.0), pl.Lattice.SQUARE: (1.0, 1.0), pl.Lattice.RECTANGULAR: (0.7, 1.1)}
LARGEST = {
    # A circle touches sides; a square of side a fits a hexagon of apothem p / 2 as a (1 + 1 / sqrt 3) = 2 p / sqrt 3.
    (pl.Lattice.HEXAGONAL, Shape.CIRCLE): math.pi / math.sqrt(12),
    (pl.Lattice.SQUARE, Shape.CIRCLE): math.pi / 4,
    (pl.Lattice.RECTANGULAR, Shape.CIRCLE): math.pi / 4 * 0.7 / 1.1,
    (pl.Lattice.HEXAGONAL, Shape.SQUARE): (2 / math.sqrt(3) / (1 + 1 / math.sqrt(3))) ** 2 / (math.sqrt(3) / 2),
    (pl.Lattice.SQUARE, Shape.SQUARE): 1.0,
    (pl.Lattice.RECTANGULAR, Shape.SQUARE): 0.7 / 1.1,
    # A hexagon with corners on the x-axis is 2 R wide and sqrt(3) R high; its area is 1.5 sqrt(3) R^2.
    (pl.Lattice.HEXAGONAL, Shape.HEXAGON): 1.0,
    (pl.Lattice.SQUARE, Shape.HEXAGON): 1.5 * math.sqrt(3) / 4,
    (pl.Lattice.RECTANGULAR, Shape.HEXAGON): 1.5 * math.sqrt(3) * 0.35**2 / (0.7 * 1.1),
    **{(lattice, Shape.CELL): 1.0 for lattice in PITCHES},
}


def cell_of(lattice, size=1.0):
    x, y = PITCHES[lattice]
    return cell_polygon(lattice, (size * x, size * y))


@settings(max_examples=60)
@given(
    lattice=st.sampled_from(list(PITCHES)),
    shape=st.sampled_from(list(Shape)),
    part=st.floats(1e-6, 1.0),
    size=st.sampled_from([1e-6, 1.0, 1e6]),
)
def test_openings_have_their_area_and_fit_their_cell(lattice, shape, part, size):
    cell, fill_factor = cell_of(lattice, size), part * LARGEST[lattice, shape]
    opening = opening_of(pl.optics.MicrolensAperture(shape, fill_factor), cell)
    round_one = shape is Shape.CIRCLE
    area = math.pi * opening.radius**2 if round_one else polygon_area(opening.corners)
    assert area == pytest.approx(fill_factor * polygon_area(cell), rel=32 * EPS)
    assert opening.reach == pytest.approx(opening.radius if round_one else np.hypot(*opening.corners.T).max(), rel=EPS)
    # Inside the cell to the tolerance with which openings are accepted, 1e-9 of the cell.
    edges = polygon_edges(cell)
    farthest = np.full(len(edges), opening.radius) if round_one else (opening.corners @ edges[:, :2].T).max(axis=0)
    assert np.all(farthest <= edges[:, 2] * (1 + 2e-9))
    if round_one:
        # The polygon in which rays are drawn holds the circle and touches it.
        assert polygon_edges(opening.corners)[:, 2] == pytest.approx(opening.radius, rel=64 * EPS * 24)
        assert len(opening.edges) == 0
    else:
        assert math.isinf(opening.radius) and np.array_equal(opening.edges, polygon_edges(opening.corners))


def test_what_sticks_out_of_its_cell_is_refused():
    for lattice, shape in [key for key in LARGEST if LARGEST[key] < 1]:
        cell, largest = cell_of(lattice), LARGEST[lattice, shape]
        opening_of(pl.optics.MicrolensAperture(shape, largest * (1 - 1e-12)), cell)
        with pytest.raises(
            pl.errors.InvalidValueError, match=f"makes the {shape.name.lower()} stick out of its cell"
        ) as error:
            opening_of(pl.optics.MicrolensAperture(shape, largest * (1 + 1e-6)), cell)
        # The error names a fill factor that is accepted, and hardly less than the largest.
        stated_limit = float(re.search(r"that fits is ([0-9.]+)", str(error.value))[1])
        assert largest - 1.01e-5 < stated_limit <= largest, (lattice, shape)
        opening_of(pl.optics.MicrolensAperture(shape, stated_limit), cell)


def test_shapes_lie_as_documented():
    square = opening_of(pl.optics.MicrolensAperture(Shape.SQUARE, 0.25), cell_of(pl.Lattice.SQUARE)).corners
    assert np.abs(square) == pytest.approx(np.full((4, 2), 0.25), abs=4 * EPS)
    # The whole cell of the hexagonal lattice is a hexagon, with two corners on the x-axis; a cell's opening is similar.
    whole = opening_of(pl.optics.MicrolensAperture(Shape.HEXAGON), cell_of(pl.Lattice.HEXAGONAL)).corners
    assert whole == pytest.approx(cell_of(pl.Lattice.HEXAGONAL), abs=8 * EPS)
    assert (np.abs(whole[:, 1]) < 8 * EPS).sum() == 2
    for lattice in PITCHES:
        opening = opening_of(pl.optics.MicrolensAperture(Shape.CELL, 0.49), cell_of(lattice))
        assert opening.corners == pytest.approx(0.7 * cell_of(lattice), rel=8 * EPS, abs=8 * EPS), lattice


def test_arrays_have_openings():
    bare = pl.MicrolensArray(pitch=0.2, focal_lengths=(2.0,))
    assert np.array_equal(bare.opening.corners, bare.cell_corners) and bare.opening.reach == bare.cell_radius
    circle = pl.optics.MicrolensAperture(Shape.CIRCLE, 0.6)
    opened = pl.MicrolensArray(pitch=0.2, focal_lengths=(2.0,), aperture=circle)
    assert opened.opening.reach == pytest.approx(math.sqrt(0.6 * bare.cell_area / math.pi), rel=8 * EPS)
    # Listed lenses: of a square of the pitch, whatever their cells are.
    listed = {"lattice": pl.Lattice.FREE, "centres": [(0, 0), (0.3, 0.1)]}
    free = pl.MicrolensArray(pitch=0.2, focal_lengths=(2.0,), aperture=circle, **listed)
    assert free.opening.radius == pytest.approx(math.sqrt(0.6 * 0.04 / math.pi), rel=8 * EPS)
    with pytest.raises(pl.errors.InvalidValueError, match="makes the circle stick out of its cell"):
        pl.MicrolensArray(pitch=0.2, focal_lengths=(2.0,), aperture=pl.optics.MicrolensAperture(Shape.CIRCLE, 0.95))


def test_a_small_opening_allows_a_strong_plate():
    # A radius of curvature of 0.1 mm is less than the cell's corner at 0.115 mm, and more than a pinhole's.
    small, model = pl.optics.MicrolensAperture(Shape.CIRCLE, 0.5), pl.optics.MicrolensModel.SPHERICAL
    opened = pl.MicrolensArray(pitch=0.2, focal_lengths=(0.2,), model=model, aperture=small)
    assert opened.opening.reach < opened.radius == pytest.approx(0.1, rel=4 * EPS)


def test_impossible_apertures():
    for changes, message in (
        ({"shape": 9}, "shape of the aperture is 9; it must be ApertureShape.CELL or"),
        ({"gaps": "dark"}, "gaps is 'dark'; it must be Gaps.OPAQUE or Gaps.CLEAR"),
        ({"fill_factor": 0.0}, "fill_factor is 0; it must be above 0"),
        ({"fill_factor": 1.01}, "fill_factor is 1.01; an opening covers at most the whole cell"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=message):
            pl.optics.MicrolensAperture(**changes)
