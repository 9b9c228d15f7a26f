"""Circles, blades straight and curved, stars and masks: their openings, and lenses that have them."""

import dataclasses
import itertools
import math
import pathlib
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.path import Path

import plenoptic as pl
from plenoptic.errors import FileError, InvalidValueError
from plenoptic.optics.element_record import CIRCLE
from plenoptic.optics.lens.lens_record import lens_record
from plenoptic.optics.lens.trace import trace_part
from plenoptic.optics.microlens.lattice import polygon_area
from plenoptic.optics.stops.mask import MaskStop
from plenoptic.optics.stops.star import StarStop
from plenoptic.optics.stops.stop_registry import STOPS as STOP_KINDS
from plenoptic.optics.stops.stop_registry import circle_around, is_circle, is_convex, stop_kind
from plenoptic.plots.lens import plot_stop

EPS = np.finfo(float).eps
GAUSS = pl.load_lens("double-gauss-100mm-f2")
RNG = np.random.default_rng(4)
HALF = np.array([[0.0, 1.0, 0.25], [1.0, 0.5, 0.0]])


def curved(blades, size, rotation, beyond, sign):
    """Blades whose radius is `beyond` times the smallest one."""
    min_radius = size if sign > 0 else size * math.tan(math.pi / blades)
    return pl.PolygonStop(blades, size, rotation, blade_radius=sign * min_radius * beyond)


SIZES, TURNS = st.floats(1e-3, 1e3), st.floats(-7.0, 7.0)
POLYGONS = st.builds(pl.PolygonStop, st.integers(3, 40), SIZES, TURNS)
STOPS = st.one_of(st.builds(pl.CircularStop, SIZES), POLYGONS)
CURVED = st.builds(curved, st.integers(3, 20), SIZES, TURNS, st.floats(1.0, 1e6), st.sampled_from([1.0, -1.0]))
STARS = st.builds(
    lambda n, size, share, turn: StarStop(n, size, share * size * math.cos(math.pi / n), turn),
    *(st.integers(3, 20), SIZES, st.floats(0.05, 1.0), TURNS),
)


def any_mask(seed, rows, columns, size):
    cells = np.random.default_rng(seed).choice([0.0, 0.3, 1.0], (rows, columns))
    return MaskStop(cells if cells.any() else 1.0 - cells, size)


MASKS = st.builds(any_mask, st.integers(0, 1000), st.integers(1, 9), st.integers(1, 9), SIZES)
SHAPES = {"straight": pl.PolygonStop(4, 4.0, 0.2), "curved outwards": pl.PolygonStop(5, 4.0, 0.3, blade_radius=6.0)}
SHAPES |= {"curved inwards": pl.PolygonStop(7, 4.0, 0.3, blade_radius=-9.0), "star": StarStop(5, 4.0, 2.0, 0.3)}
SHAPES |= {"mask": MaskStop(RNG.choice([0.0, 0.4, 1.0], (13, 9)), 4.0)}


KINDS = SHAPES | {"circle": pl.CircularStop(4.0), "ring": pl.optics.RingStop(4.0, 1.0)}


def test_the_registry_tells_the_truth_about_holes():
    """By points in a square around each: where light passes, between two that pass, and along the rim."""
    assert {type(stop) for stop in KINDS.values()} == {kind.stop for kind in STOP_KINDS.values()}
    for name, stop in KINDS.items():
        kind, points = stop_kind(stop), RNG.uniform(-4.0, 4.0, (20_000, 2))
        passing = stop.transmission_at(*points.T)
        inside = points[passing > 0]
        middle = 0.5 * (inside + RNG.permutation(inside))
        assert stop.contains(*middle.T).all() == is_convex(stop), name
        assert stop.contains(*(0.999 * pl.CircularStop(4.0).outline(500)).T).all() == kind.has_round_edge, name
        within = Path(stop.outline(4000)).contains_points(points)
        # Points between a chord of the outline and its arc, 8e-7 of the radius apart, are too few to be met.
        assert np.array_equal(within, passing == 1.0) == kind.fills_outline, name
        assert is_circle(stop) == (circle_around(stop) is stop) == (name == "circle"), name


def test_no_other_file_tells_stops_apart():
    """Files of lenses may: each format knows its own stops."""
    package, names = pathlib.Path(pl.__file__).parent, [kind.stop.__name__ for kind in STOP_KINDS.values()]
    asks = re.compile(rf"(isinstance|type)\([^\n]*\b({'|'.join(names)})\b")
    rooms = [path for path in package.rglob("*.py") if path.parent.name not in ("stops", "files")]
    assert [path.name for path in rooms if asks.search(path.read_text("utf-8"))] == []


@given(stop=st.one_of(STOPS, CURVED, STARS))
def test_the_outline_is_the_border(stop):
    outline = stop.outline(50)
    # Along the radius: points are off by a few eps of size and angle, over the cosine between border and radius, at
    # least sin(pi / 20) (1 - 0.05) for a star and vanishing only at the tips of blades that touch, which are left out.
    radius = np.hypot(*outline.T)
    inner = outline[radius < 0.999 * stop.semi_diameter]
    assert stop.contains(*(outline * (1 - 1e-12)).T).sum() >= len(inner)
    assert stop.contains(*(inner * (1 - 1e-12)).T).all() and not stop.contains(*(outline * (1 + 1e-12)).T).any()
    assert radius.max() == pytest.approx(stop.semi_diameter, rel=8 * EPS)
    assert stop.contains(np.zeros((4, 1)), np.zeros(3)).shape == (4, 3) and not stop.contains(math.nan, 0.0)


def test_many_blades_are_a_circle():
    # cos(pi / n) = 1 - pi^2 / (2 n^2), and sin(x) / x = 1 - x^2 / 6 with x = 2 pi / 1000.
    circle, many = pl.CircularStop(5.0), pl.PolygonStop(1000, 5.0)
    assert many.apothem == pytest.approx(5.0, rel=math.pi**2 / 2e6 * 1.001)
    assert many.area == pytest.approx(circle.area, rel=(2 * math.pi / 1000) ** 2 / 6 * 1.001)
    assert polygon_area(circle.outline(10000)) == pytest.approx(25 * math.pi, rel=1e-6)
    # The first corner is at the rotation.
    assert pl.PolygonStop(5, 2.0, rotation=0.3).outline(5)[0] == pytest.approx([2 * math.cos(0.3), 2 * math.sin(0.3)])


@given(stop=st.one_of(POLYGONS, STARS))
def test_a_star_has_the_area_of_its_outline(stop):
    # Sums of 40 terms, and angles of up to 14 that are good to an eps of 14, over a share of 0.05.
    assert polygon_area(stop.outline(3)) == pytest.approx(stop.area, rel=1e4 * EPS)
    assert len(stop.outline(3)) == (2 * stop.points if isinstance(stop, StarStop) else stop.blades)


@given(stop=CURVED)
def test_curved_blades_have_the_area_of_their_outline(stop):
    # Chords of an arc of the angle a that is divided by n cut off (a / n)^2 / 6 of the segment, relatively, at
    # most; a < 2 pi / 3 for outward blades, pi for inward ones; the segment is below the square of the semi-diameter.
    n = 200
    tolerance = stop.blades * (math.pi / n) ** 2 / 6 * stop.semi_diameter**2
    assert polygon_area(stop.outline(n * stop.blades)) == pytest.approx(stop.area, abs=tolerance)


@given(blades=st.integers(3, 12), size=SIZES, rotation=TURNS)
def test_blades_of_the_radius_of_the_stop_are_a_circle(blades, size, rotation):
    stop, circle = pl.PolygonStop(blades, size, rotation, blade_radius=size), pl.CircularStop(size)
    assert stop.area == pytest.approx(circle.area, rel=64 * EPS)
    assert stop.apothem == pytest.approx(size, rel=8 * EPS)
    ring = circle.outline(97)
    assert stop.contains(*(ring * (1 - 64 * EPS)).T).all()
    assert not stop.contains(*(ring * (1 + 64 * EPS)).T).any()


def test_blades_become_straight_with_order_1_of_the_curvature():
    straight, radii = pl.PolygonStop(6, 5.0), np.geomspace(1e3, 1e9, 7)
    # The height of an arc over its half chord h is h^2 / 2 R, and its area 2 / 3 of height times chord.
    high = 2.5**2 / 2
    for sign in (1.0, -1.0):
        stops = [pl.PolygonStop(6, 5.0, blade_radius=sign * r) for r in radii]
        differences = np.array([stop.apothem for stop in stops]) - straight.apothem
        assert differences * radii == pytest.approx(np.full(7, sign * high), rel=1e-5, abs=8 * EPS * 5e9)
        differences = np.array([stop.area for stop in stops]) - straight.area
        assert differences * radii == pytest.approx(np.full(7, sign * 20 * high), rel=1e-5, abs=64 * EPS * 65e9)
    assert pl.PolygonStop(6, 5.0, blade_radius=-math.inf) == straight


def test_the_blunt_star_is_a_polygon():
    star, polygon = StarStop(5, 3.0, 3.0 * math.cos(math.pi / 5), 0.2), pl.PolygonStop(5, 3.0, 0.2)
    x, y = RNG.uniform(-3, 3, (2, 5000))
    clear = np.abs(np.max(np.stack([x, y], axis=1) @ polygon.normals.T, axis=1) - polygon.apothem) > 1e-12
    assert np.array_equal(star.contains(x, y)[clear], polygon.contains(x, y)[clear])
    assert star.area == pytest.approx(polygon.area, rel=16 * EPS)


def test_a_mask_looks_like_its_image_from_behind():
    # From the sensor along -z, with y up, x runs to the right: row 0 is up, column 0 on the left.
    mask = MaskStop([[1.0, 0.0], [0.25, 0.5]], semi_diameter=2 * math.sqrt(2))
    assert mask.cell_size == pytest.approx(2.0, rel=4 * EPS)
    assert mask.transmission_at([-1, 1, -1, 1], [1, 1, -1, -1]).tolist() == [1.0, 0.0, 0.25, 0.5]
    assert mask.contains([-1, 1, -2.1], [1, 1, 1]).tolist() == [True, False, False]
    assert mask.area == pytest.approx(4 * 1.75, rel=8 * EPS) and not mask.contains(math.nan, 0.0)


def test_the_semi_diameter_is_that_of_the_opening():
    bare, framed = MaskStop(HALF, 3.0), MaskStop(np.pad(HALF, ((1, 1), (3, 3))), 3.0)
    assert bare.cell_size == framed.cell_size
    x, y = RNG.uniform(-4, 4, (2, 1000))
    assert np.array_equal(bare.transmission_at(x, y), framed.transmission_at(x, y))
    assert MaskStop.of_cells(HALF, 0.5).cell_size == pytest.approx(0.5, rel=4 * EPS)
    # The outermost corner of an open cell: 1 cell up and 1.5 to the right.
    assert MaskStop.of_cells(HALF, 0.5).semi_diameter == pytest.approx(0.5 * math.hypot(1.0, 1.5), rel=4 * EPS)


@given(mask=MASKS)
def test_the_outline_of_a_mask_holds_its_opening(mask):
    outline = mask.outline(20)
    assert np.hypot(*outline.T).max() == pytest.approx(mask.semi_diameter, rel=8 * EPS)
    rows, columns = np.nonzero(mask.transmission)
    height, width = np.shape(mask.transmission)
    centres = mask.cell_size * np.stack([columns + 0.5 - width / 2, height / 2 - rows - 0.5], axis=1)
    along = np.roll(outline, -1, axis=0) - outline
    # Half a cell inside each side of a convex polygon that runs counter-clockwise.
    to = centres[:, None] - outline[None]
    away = (along[:, 0] * to[..., 1] - along[:, 1] * to[..., 0]) / np.hypot(*along.T)
    assert away.min() >= 0.5 * mask.cell_size * (1 - 1e-9)


def test_masks_come_from_images(tmp_path):
    grey = np.array([[0, 65535], [32768, 65535]], dtype=np.uint16)[..., None]
    pl.images.write_16bit(tmp_path / "mask.png", np.repeat(grey, 3, axis=2))
    mask = MaskStop.load(tmp_path / "mask.png", 5.0, thickness=1.0)
    assert mask.transmission.tolist() == [[0.0, 1.0], [pytest.approx(0.214, abs=1e-3), 1.0]]
    assert (mask.semi_diameter, mask.thickness) == (5.0, 1.0)
    pl.images.write_channels(tmp_path / "mask.exr", {"Y": 2.0 * np.ones((2, 2))})
    with pytest.raises(InvalidValueError, match="transmission holds 2; it must be from 0"):
        MaskStop.load(tmp_path / "mask.exr", 5.0)
    with pytest.raises(FileError, match="does not exist"):
        MaskStop.load(tmp_path / "none.png", 5.0)


def test_what_cannot_be_is_refused():
    hole = np.pad([[1.0]], ((0, 400), (0, 400)))  # in a corner
    for make, message in (
        (lambda: pl.PolygonStop(6, 5.0, thickness=math.inf), "thickness is"),
        (lambda: pl.CircularStop(5.0).outline(2), "n is 2"),
        (lambda: StarStop(2, 5.0, 2.0), "points is 2; it must be at least 3"),
        (lambda: StarStop(5, 5.0, 4.1), r"is 4\.1 mm; a star of 5 points .* has at most 4\.04508 mm"),
        (lambda: StarStop(5, 5.0, 0.0), "inner_semi_diameter is 0 mm"),
        (lambda: pl.PolygonStop(6, 5.0, blade_radius=4.9), r"is 4\.9 mm; for 6 blades it must be at least 5"),
        (lambda: pl.PolygonStop(3, 2.0, blade_radius=-3.4), r"is -3\.4 mm; for 3 blades it must be at least 2 mm"),
        (lambda: MaskStop(np.zeros((2, 2)), 5.0), "transmission is 0 everywhere"),
        (lambda: MaskStop([[1.0]], 0.0), "semi_diameter is 0 mm"),
        (lambda: pl.aberrations.vignetting(GAUSS.with_stop(MaskStop(hole, 6.0)), [0.0], grid=8), "none of its points"),
    ):
        with pytest.raises(InvalidValueError, match=message):
            make()


def plate(stop):
    """A stop and a surface that does nothing."""
    return pl.LensStack([stop, pl.Surface(math.inf, semi_diameter=50.0)])


def along_axis(x, y, z):
    along = np.tile([0.0, 0.0, -math.copysign(1.0, z)], (len(x), 1))
    return pl.RayBundle(np.column_stack([x, y, np.full(len(x), z)]), along, weight=np.full(len(x), 3.0))


def transmission(stop, x, y):
    return stop.transmission_at(x, y) if isinstance(stop, MaskStop) else stop.contains(x, y).astype(float)


def far_from_borders(stop, x, y, by):
    """True where the transmission is constant within `by` mm."""
    neighbours = [transmission(stop, x + by * dx, y + by * dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1)]
    return np.ptp(neighbours, axis=0) == 0


def test_rays_pass_where_the_stop_is_open():
    for name, stop in SHAPES.items():
        x, y = RNG.uniform(-5, 5, (2, 5000))
        expected = transmission(stop, x, y)
        # Axial rays reach the stop at the very x, y of their origin: only rounding in the border decides otherwise.
        unambiguous = far_from_borders(stop, x, y, 1e-12)
        assert np.count_nonzero(~unambiguous) < 5 and np.count_nonzero(expected) > 500, name
        for reverse in (False, True):
            rays, lens = along_axis(x, y, 3.0 if reverse else -3.0), plate(stop)
            out = lens.trace_reverse(rays) if reverse else lens.trace(rays)
            assert np.array_equal(out.weight[unambiguous], 3.0 * expected[unambiguous]), name
            assert np.array_equal(out.status[unambiguous] == 0, expected[unambiguous] > 0), name
            assert set(out.status[out.status != 0].tolist()) == {int(pl.RayStatus.CLIPPED)}, name


def test_a_moved_stop_is_open_elsewhere():
    turn = 0.4
    for name, stop in SHAPES.items():
        lens = plate(stop).moved(0, shift=(0.5, -0.3, 0.0), tilt=(0.0, 0.0, turn))
        x, y = RNG.uniform(-5, 5, (2, 3000))
        u, v = x - 0.5, y + 0.3
        local = math.cos(turn) * u + math.sin(turn) * v, math.cos(turn) * v - math.sin(turn) * u
        unambiguous = far_from_borders(stop, *local, 1e-12)
        out = lens.trace(along_axis(x, y, -3.0))
        assert np.array_equal(out.weight[unambiguous], 3.0 * transmission(stop, *local)[unambiguous]), name


def test_irises_and_further_stops_of_any_shape():
    open_lens = GAUSS.with_stop(pl.CircularStop(12.0))
    for name, stop in SHAPES.items():
        lens = GAUSS.with_stop(stop).inserted(stop, z=31.0)
        assert lens.stop == dataclasses.replace(stop, thickness=lens.stop.thickness), name
        x, y = RNG.uniform(-8, 8, (2, 3000))
        rays = along_axis(x, y, -100.0)
        at_iris = trace_part(open_lens, rays, 0, open_lens.iris_index).origin[:, :2].T
        at_stop = open_lens.trace(rays).at_z(31.0)[:, :2].T
        expected = transmission(stop, *at_iris) * transmission(stop, *at_stop)
        unambiguous = far_from_borders(stop, *at_iris, 1e-10) & far_from_borders(stop, *at_stop, 1e-10)
        assert np.count_nonzero(expected[unambiguous]) > 100, name
        assert lens.trace(rays).weight[unambiguous] == pytest.approx(3.0 * expected[unambiguous], rel=4 * EPS), name


def test_ideal_lenses_show_the_image_of_the_iris():
    models = (pl.LensModel.THIN, pl.LensModel.PARAXIAL, pl.LensModel.NONE)
    for (name, stop), model in itertools.product(SHAPES.items(), models):
        lens = GAUSS.with_stop(stop)
        ideal = lens.with_model(model)
        rows = lens_record(ideal, 587.6, reverse=True).rows
        opening = rows[rows["semi_diameter2"] < math.inf][0]
        larger = math.sqrt(opening["semi_diameter2"]) / lens.stop.semi_diameter
        scale = 1.0 if model is pl.LensModel.NONE else larger
        plane, x, y = float(opening["z"]), *(scale * RNG.uniform(-4, 4, (2, 2000)))
        # Rays towards the scene that cross the plane of the iris's image at (x, y).
        aim = np.column_stack([x, y, np.full(2000, plane)])
        direction = aim - [0.0, 0.0, plane + 60.0]
        out = ideal.trace_reverse(pl.RayBundle(aim - 0.5 * direction, direction))
        unambiguous = far_from_borders(stop, x / scale, y / scale, 1e-11)
        expected = transmission(stop, x / scale, y / scale)
        assert np.count_nonzero(expected) > 400, (name, model)
        assert np.array_equal(out.weight[unambiguous], expected[unambiguous]), (name, model)


def test_an_inverted_image_of_the_iris_is_turned():
    # The iris stands two focal lengths before a thin lens: its image stands as far behind, inverted.
    glass = pl.ConstantMedium(1.5)
    surfaces = [pl.Surface(100.0, 1e-9, glass, semi_diameter=40.0), pl.Surface(-100.0, semi_diameter=40.0)]
    for name, stop in SHAPES.items():
        lens = pl.LensStack([dataclasses.replace(stop, thickness=200.0), *surfaces], model=pl.LensModel.PARAXIAL)
        x, y = RNG.uniform(-4, 4, (2, 2000))
        out = lens.trace_reverse(along_axis(x, y, 400.0))
        # The magnification is -1 to 1e-11, by the thickness of the lens.
        unambiguous = far_from_borders(stop, -x, -y, 1e-8)
        assert np.array_equal(out.weight[unambiguous], 3.0 * transmission(stop, -x, -y)[unambiguous]), name


def test_bounds_are_made_of_the_circle_around():
    reference = lens_record(GAUSS.with_stop(pl.CircularStop(4.0)), 587.6, reverse=True)
    for name, stop in SHAPES.items():
        lens = GAUSS.with_stop(stop)
        record = lens_record(lens, 587.6, reverse=True, round_stops=True)
        assert all(a is b is None or np.array_equal(a, b) for a, b in zip(record, reference, strict=True)), name
        record = lens_record(lens, 587.6, reverse=True, clipping=False)
        assert record.masks is None and record.rows[5]["kind"] == CIRCLE and not len(record.edges), name


def test_lenses_draw_and_check_with_any_stop():
    for name, stop in SHAPES.items():
        lens = GAUSS.with_stop(stop)
        assert lens.check() == (), name
        vignetting = pl.aberrations.vignetting(lens, [0.0], grid=64)
        assert (vignetting.fraction[0], vignetting.standard_error[0]) == (1.0, 0.0), name  # on the axis all is filled
        assert plot_stop(lens.stop).get_title() == type(lens.stop).__name__, name
        ax = lens.layout(fields=[0.0, 0.1])
        # Bars of the iris end where the circle around the opening begins.
        ends = {round(abs(float(y)), 9) for line in ax.lines for y in np.asarray(line.get_ydata(), dtype=float)}
        assert 4.0 in ends, name


def test_a_grey_mask_dims():
    clear, grey = (GAUSS.with_stop(MaskStop(t * np.ones((3, 3)), 6.0)) for t in (1.0, 0.25))
    fields = [0.0, 0.1]
    white, dim = (pl.aberrations.relative_illumination(lens, fields, grid=24) for lens in (clear, grey))
    # Every ray is dimmed alike; 0.25 is a power of 2, so that no bit is lost.
    assert np.array_equal(dim.projected_solid_angle, 0.25 * white.projected_solid_angle)
    # A second filter of 0.25 behind the lens takes as much of what the iris lets through.
    both = grey.inserted(MaskStop(0.25 * np.ones((1, 1)), 60.0), z=31.0)
    vignetting = pl.aberrations.vignetting(both, [0.0], grid=32)
    assert vignetting.fraction[0] == pytest.approx(0.25, rel=4 * EPS)
    assert pl.aberrations.vignetting(grey, [0.0], grid=32).fraction[0] == 1.0
