import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import plenoptic as pl
from plenoptic.core.kernels.polygons import cut
from plenoptic.optics.microlens import lattice as lattices
from plenoptic.optics.microlens.lattice import cell_polygon, lattice_basis, polygon_area, polygon_edges

EPS = np.finfo(float).eps
HEXAGONAL, SQUARE, RECTANGULAR = pl.Lattice.HEXAGONAL, pl.Lattice.SQUARE, pl.Lattice.RECTANGULAR
LATTICES = [(HEXAGONAL, (1.0, 1.0)), (SQUARE, (1.0, 1.0)), (RECTANGULAR, (0.4, 1.7)), (RECTANGULAR, (3.0, 0.2))]
NEIGHBOURS = {
    HEXAGONAL: [(0, 1), (1, 0), (1, -1), (0, -1), (-1, 0), (-1, 1)],
    SQUARE: [(0, 1), (1, 0), (0, -1), (-1, 0)],
}


def cut_polygon(corners, edges):
    """The part of a convex polygon inside all edges (k, 3), cut by the kernel."""
    polygon, n = np.zeros((3, 32)), len(corners)
    polygon[:2, :n] = corners.T
    for a, b, limit in edges:
        n = cut(polygon, 0, n, a, b, limit)
    return polygon[:2, :n].T


def test_a_cell_has_the_area_of_the_basis():
    for (lattice, pitch), size in itertools.product(LATTICES, (1e-6, 1.0, 1e6)):
        pitches, case = (size * pitch[0], size * pitch[1]), (lattice, pitch, size)
        basis, cell = lattice_basis(lattice, pitches), cell_polygon(lattice, pitches)
        assert polygon_area(cell) == pytest.approx(abs(np.linalg.det(basis)), rel=32 * EPS), case
        # All sizes have the same shape: scaling a cell or a basis costs a rounding for each of some four factors.
        scaled = size * cell_polygon(lattice, pitch)
        assert cell == pytest.approx(scaled, rel=8 * EPS, abs=8 * EPS * size), case
        assert basis == pytest.approx(size * lattice_basis(lattice, pitch), rel=8 * EPS), case


def test_cells_tile_the_plane():
    for lattice, pitch in LATTICES:
        basis, edges = lattice_basis(lattice, pitch), polygon_edges(cell_polygon(lattice, pitch))
        i, j = np.mgrid[-4:5, -4:5]
        centres = np.stack([i.ravel(), j.ravel()], axis=1) @ basis
        # Points of one period of the lattice, wherever its corner is.
        points = np.random.default_rng(1).uniform(-0.5, 0.5, (3000, 2)) @ basis
        over = ((points[:, None] - centres) @ edges[:, :2].T - edges[:, 2]).max(axis=2)
        clear = np.abs(over).min(axis=1) > 1e-12
        assert np.all((over[clear] < 0).sum(axis=1) == 1) and clear.mean() > 0.99, (lattice, pitch)


def test_edges_are_half_way_to_neighbours():
    for lattice, pitch in LATTICES:
        offsets = np.array(NEIGHBOURS.get(lattice, NEIGHBOURS[SQUARE])) @ lattice_basis(lattice, pitch)
        edges = polygon_edges(cell_polygon(lattice, pitch))
        half_way = {tuple(np.round(o / 2, 12) + 0.0) for o in offsets}
        midpoints = {tuple(np.round(n * d, 12) + 0.0) for n, d in zip(edges[:, :2], edges[:, 2], strict=True)}
        assert midpoints == half_way, (lattice, pitch)


def test_neighbours_of_a_hexagonal_lattice_differ():
    for types in [3, 4, 5, 7]:
        pattern = lattices.default_pattern(types)
        for (i, j), (di, dj) in itertools.product(np.ndindex(types, types), NEIGHBOURS[HEXAGONAL]):
            assert pattern[i, j] != pattern[(i + di) % types, (j + dj) % types], types
        # All types are equally frequent.
        assert np.bincount(pattern.ravel()).tolist() == [types] * types, types


def test_three_types_surround_each_other_in_turn():
    # As in the multi-focus cameras of Raytrix: around each lens the two other types alternate.
    pattern = lattices.default_pattern(3)
    for i, j in np.ndindex(3, 3):
        ring = [pattern[(i + di) % 3, (j + dj) % 3] for di, dj in NEIGHBOURS[HEXAGONAL]]
        assert ring[0::2] == [ring[0]] * 3 and ring[1::2] == [ring[1]] * 3
        assert {ring[0], ring[1], pattern[i, j]} == {0, 1, 2}


def test_two_types_are_a_checkerboard():
    pattern = lattices.default_pattern(2)
    for (i, j), (di, dj) in itertools.product(np.ndindex(2, 2), NEIGHBOURS[SQUARE]):
        assert pattern[i, j] != pattern[(i + di) % 2, (j + dj) % 2]


def test_a_pattern_repeats_over_the_array():
    given_pattern = [[0, 1, 1], [2, 0, 2]]
    for lattice in (HEXAGONAL, SQUARE):
        array = pl.MicrolensArray(pitch=1.0, focal_lengths=(1.0, 2.0, 3.0), lattice=lattice, pattern=given_pattern)
        lenses = array.lenses((-6.0, -6.0), (6.0, 6.0))
        assert lenses.index.min() < 0, lattice
        assert lenses.type.tolist() == [given_pattern[i % 2][j % 3] for i, j in lenses.index.tolist()], lattice
        assert lenses.power.tolist() == [1.0 / (1.0 + t) for t in lenses.type.tolist()], lattice
        assert array.focal_length == 1.0, lattice
    # The lens on the axis is of the pattern's first type.
    array = pl.MicrolensArray(pitch=1.0, focal_lengths=(1.0, 2.0), lattice=SQUARE, pattern=[[1, 0]])
    assert array.focal_length == 2.0 and array.lenses((-0.1, -0.1), (0.1, 0.1)).power.tolist() == [0.5]


@settings(max_examples=60)
@given(seed=st.integers(0, 10_000), size=st.sampled_from([1e-6, 1.0, 1e6]))
def test_cuts_one_after_the_other_keep_what_lies_within_all(seed, size):
    rng = np.random.default_rng(seed)
    sides, count = int(rng.integers(3, 13)), int(rng.integers(1, 5))
    corners = lattices.regular_polygon(sides, size, rng.uniform(0, 6))
    edges = rng.normal(size=(count, 3)) * [1.0, 1.0, size]
    polygon = cut_polygon(corners, edges)
    bounds = np.concatenate([polygon_edges(corners), edges])
    assert np.all(polygon @ bounds[:, :2].T <= bounds[:, 2] + 1e-12 * size)
    # A cut adds at most one corner.
    assert len(polygon) <= sides + count
    # Nothing that lies within is lost.
    points = size * rng.uniform(-1, 1, (200, 2))
    within = np.all(points @ bounds[:, :2].T <= bounds[:, 2] - 1e-9 * size, axis=1)
    if within.any():
        # Corners are counter-clockwise: a point inside lies to the left of every edge.
        (x, y), (along_x, along_y) = polygon.T, (np.roll(polygon, -1, axis=0) - polygon).T
        px, py = points[within].T[..., None]
        assert np.all(along_x * (py - y) - along_y * (px - x) >= -1e-12 * size**2)
    # Cutting everything away leaves nothing.
    assert cut_polygon(corners, np.array([[1.0, 0.0, -2.0 * size], [0.0, 1.0, 0.5 * size]])).shape == (0, 2)
