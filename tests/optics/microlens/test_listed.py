import dataclasses
import itertools
import math
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import plenoptic as pl
from plenoptic.optics.microlens.lattice import polygon_area
from plenoptic.optics.microlens.microlens_record import array_record

EPS = np.finfo(float).eps
REGULAR = [pl.Lattice.HEXAGONAL, pl.Lattice.SQUARE, pl.Lattice.RECTANGULAR]
SPOILED = pl.MicrolensImperfections(
    pitch_jitter=0.02, decentre=0.01, focal_length_spread=0.1, missing=0.1, dark=0.1, seed=5
)


def array_of(lattice, size=1.0, **fields):
    both = (1.5 * size, size) if lattice is pl.Lattice.RECTANGULAR else size
    return pl.MicrolensArray(pitch=both, **({"focal_lengths": (2.0,), "lattice": lattice} | fields))


def free_array(n, seed, **fields):
    centres = np.random.default_rng(seed).uniform(-2, 2, (n, 2))
    return array_of(pl.Lattice.FREE, 0.5, centres=centres, **fields)


def tables_of(array, reach):
    return array_record(array, turn=np.eye(2), origin=np.zeros(2), reach=reach, margin=0.0)


def test_cells_with_very_many_sides_are_refused():
    for n_neighbours in (50, 100):
        angle = np.arange(n_neighbours) * 2 * np.pi / n_neighbours
        centres = np.concatenate([[[0.0, 0.0]], np.stack([np.cos(angle), np.sin(angle)], axis=1)])
        with pytest.raises(pl.errors.InvalidValueError, match="sides or more, and the limit is 40"):
            tables_of(array_of(pl.Lattice.FREE, 1.0, centres=centres), 1.0)


@settings(max_examples=40)
@given(lattice=st.sampled_from(REGULAR), size=st.sampled_from([1e-6, 1.0, 1e6]), seed=st.integers(0, 1000))
def test_a_box_holds_the_lenses_whose_centres_lie_in_it(lattice, size, seed):
    array = array_of(lattice, size)
    low, high = np.sort(np.random.default_rng(seed).uniform(-6 * size, 6 * size, (2, 2)), axis=0)
    i, j = np.mgrid[-20:21, -20:21]
    index = np.stack([i.ravel(), j.ravel()], axis=1)
    centres = index @ array.basis
    inside = ((centres >= low) & (centres <= high)).all(axis=1)
    lenses = array.lenses(low, high)
    # Ordered by their indices, as the grid is; centres on the border to 1e-9 of a pitch cannot be drawn by chance.
    assert np.array_equal(lenses.index, index[inside])
    np.testing.assert_allclose(lenses.design, centres[inside], rtol=0, atol=60 * EPS * size)
    assert len(lenses) == inside.sum()
    # Lenses as designed.
    assert np.array_equal(lenses.centre, lenses.design) and np.array_equal(lenses.axis, lenses.design)
    assert np.all(lenses.power == 0.5) and np.all(lenses.transmission == 1.0) and np.all(lenses.type == 0)


def test_lenses_on_the_border_belong_to_the_box():
    for lattice, size in itertools.product(REGULAR, (1e-6, 0.217, 1e6)):
        array = array_of(lattice, size)
        for corner in np.array([(3, 1), (-7, 2), (11, -5), (0, 0)]) @ array.basis:
            for lenses in (array.lenses(corner, corner), array.lenses(corner, corner + size / 3)):
                # Products of matrices are rounded differently on different processors: sums of two products of up to
                # 11 size.
                np.testing.assert_allclose(lenses.centre, [corner], rtol=0, atol=30 * EPS * size)


def test_boxes_side_by_side_list_the_same_lenses_as_one():
    for lattice in REGULAR:
        array = array_of(lattice, 0.217, imperfections=SPOILED, focal_lengths=(1.0, 2.0, 3.0))
        whole = array.lenses((-2.0, -2.0), (2.0, 2.0))
        cut = 0.1234
        parts = [array.lenses((-2.0, -2.0), (cut, 2.0)), array.lenses((cut, -2.0), (2.0, 2.0))]
        index = np.concatenate([part.index for part in parts])
        order = np.lexsort(index.T[::-1])
        for field in dataclasses.fields(whole):
            together = np.concatenate([getattr(part, field.name) for part in parts])
            assert np.array_equal(together[order], getattr(whole, field.name)), lattice


def test_too_many_lenses_and_no_box():
    array, free = array_of(pl.Lattice.HEXAGONAL, 1e-6), free_array(5, 1)
    for microlenses, low, high, text in (
        (array, (-1.0, -1.0), (1.0, 1.0), "the box holds some .* microlenses, and the limit is 20000000"),
        *((array_of(lattice), (0.0, 0.0), (math.inf, 1.0), "is infinite, and so is") for lattice in REGULAR),
        (array, (math.nan, 0.0), (1.0, 1.0), "has a corner that is no number"),
        (free, (math.nan, 0.0), (1.0, 1.0), "has a corner that is no number"),
        (array, (0, 0, 0), (1, 1), r"low has shape \(3,\); it must have shape \(2,\)"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=text):
            microlenses.lenses(low, high)
    assert len(free.lenses((-math.inf, -math.inf), (math.inf, math.inf))) == 5
    for microlenses in (array_of(pl.Lattice.SQUARE, imperfections=SPOILED), free_array(5, 1, imperfections=SPOILED)):
        lenses = microlenses.lenses((0.4, 100.4), (0.6, 100.6))  # between lenses
        assert len(lenses) == 0 and lenses.centre.shape == (0, 2) and lenses.power.shape == (0,)
    assert len(array_of(pl.Lattice.SQUARE).lenses((1.0, 1.0), (-1.0, -1.0))) == 0


def test_listed_deviations_change_their_lenses_and_no_others():
    places = {"shift": [(0.01, 0.02), (0.0, 0.0)], "decentre": [(0.0, 0.04), (-0.03, 0.0)]}
    light = {"focal_length_factor": [2.0, math.inf], "transmission": [0.25, 1.0]}
    listed = pl.optics.MicrolensDeviations(index=[(1, 0), (0, -1)], **places, **light)
    opening = pl.optics.MicrolensAperture(fill_factor=0.5)
    plain, changed, opened = (
        array_of(pl.Lattice.SQUARE, imperfections=which, aperture=opening_of).lenses((-1.5, -1.5), (1.5, 1.5))
        for which, opening_of in ((None, None), (listed, None), (listed, opening))
    )
    both = [plain.index.tolist().index(pair) for pair in ([1, 0], [0, -1])]
    unchanged = np.delete(np.arange(len(plain)), both)
    for field in dataclasses.fields(plain):
        assert np.array_equal(getattr(changed, field.name)[unchanged], getattr(plain, field.name)[unchanged]), (
            field.name
        )
    # The shift takes the axis along, and an opening of its own; the decentre the axis alone.
    assert np.array_equal(changed.design, plain.design) and np.array_equal(changed.centre, plain.design)
    assert opened.centre[both].tolist() == [[1.01, 0.02], [0.0, -1.0]]
    assert changed.axis[both].tolist() == opened.axis[both].tolist() == [[1.01, 0.06], [-0.03, -1.0]]
    assert changed.power[both].tolist() == [0.25, 0.0] and changed.transmission[both].tolist() == [0.25, 1.0]


def test_drawn_deviations_are_those_of_their_index():
    array = array_of(pl.Lattice.HEXAGONAL, focal_lengths=(1.0, 2.0, 4.0), imperfections=SPOILED)
    lenses = array.lenses((-5, -5), (5, 5))
    drawn = SPOILED.deviations(lenses.index)
    assert np.array_equal(lenses.centre, lenses.design)
    assert np.array_equal(lenses.axis, lenses.design + drawn.shift + drawn.decentre)
    # A spread of focal lengths multiplies that of the type; missing lenses have no power.
    assert np.array_equal(lenses.power, 1.0 / np.array([1.0, 2.0, 4.0])[lenses.type] / drawn.focal_length_factor)
    assert np.array_equal(lenses.power == 0, np.isinf(drawn.focal_length_factor))
    assert np.array_equal(lenses.transmission, drawn.transmission)


def test_free_lenses_are_numbered():
    array = free_array(50, 2, types=np.arange(50) % 2, focal_lengths=(1.0, -4.0), imperfections=SPOILED)
    inside = ((array.centres >= -1) & (array.centres <= 1)).all(axis=1)
    lenses = array.lenses((-1, -1), (1, 1))
    assert lenses.index.tolist() == [[k, 0] for k in np.flatnonzero(inside)]
    assert np.array_equal(lenses.design, array.centres[inside])
    assert np.array_equal(lenses.type, np.flatnonzero(inside) % 2)
    drawn = SPOILED.deviations(lenses.index)
    assert np.array_equal(lenses.axis, lenses.design + drawn.shift + drawn.decentre) and array.focal_length == 1.0


@settings(max_examples=20)
@given(seed=st.integers(0, 1000), n=st.integers(1, 60))
def test_free_cells_hold_what_is_nearest(seed, n):
    array = free_array(n, seed)
    points = np.random.default_rng(seed + 1).uniform(-2.5, 2.5, (400, 2))
    off = points[:, None] - array.centres
    distance = np.linalg.norm(off, axis=2)
    order = np.sort(distance, axis=1)
    assert array.nearest(points) == pytest.approx(array.centres[distance.argmin(axis=1)], abs=0)
    # A cell is what is nearest, and no farther along x and y than the pitch.
    held = (distance == order[:, :1]) & (np.abs(off) <= 0.5).all(axis=2)
    cells = tables_of(array, 4.0).lens_table
    inside = (np.einsum("mkc,nmc->nmk", cells.cells[..., :2], off) <= cells.cells[..., 2]).all(axis=2)
    clear = np.abs(np.abs(off) - 0.5).min(axis=(1, 2)) > 1e-9
    if n > 1:
        clear &= order[:, 1] - order[:, 0] > 1e-9
    assert np.array_equal(inside[clear], held[clear])
    # Their polygons have the areas of the cells: a share of the points' square. Seeds are drawn: 6.5 standard errors.
    area = sum(polygon_area(corners[0, : count[0]]) for corners, count in zip(cells.corners, cells.counts, strict=True))
    fraction = min(area / 25.0, 1.0)
    assert abs(held.any(axis=1).mean() - fraction) <= 6.5 * math.sqrt(fraction * (1 - fraction) / 400) + 1e-12


def test_arrays_take_no_memory_for_each_lens():
    for fields in [
        {},
        {"focal_lengths": (1.0, 2.0, 3.0)},
        {"aperture": pl.optics.MicrolensAperture(pl.optics.ApertureShape.CIRCLE, 0.5)},
        {"aperture": pl.optics.MicrolensAperture(pl.optics.ApertureShape.SQUARE, 0.5, pl.optics.Gaps.CLEAR)},
    ]:
        # The same 30 mm of an array with some 20 000 and with some 2e10 microlenses.
        coarse, fine = (array_of(pl.Lattice.HEXAGONAL, size, **fields) for size in (0.217, 0.000217))
        sizes = [len(pickle.dumps(tables_of(array, 15.0))) for array in (coarse, fine)]
        assert tables_of(fine, 15.0).lens_table is None and sizes[0] == sizes[1] < 4000, fields
        assert len(pickle.dumps(coarse)) == len(pickle.dumps(fine)) < 2000, fields


def test_individual_lenses_are_listed_as_far_as_they_matter():
    array = array_of(pl.Lattice.SQUARE, imperfections=pl.optics.MicrolensDeviations([(0, 0)], transmission=[0.5]))
    near, far = (tables_of(array, reach).lens_table for reach in (3.0, 30.0))
    assert 7**2 <= len(near.lenses) < 11**2 and 61**2 <= len(far.lenses) < 65**2
    with pytest.raises(pl.errors.InvalidValueError, match="have imperfections, and the limit is 4000000"):
        tables_of(array, 3000.0)
