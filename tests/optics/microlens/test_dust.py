import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import plenoptic as pl
from plenoptic.core.kernels.ray_blocks import BLOCK
from plenoptic.core.motions.rotation import rotation_about
from plenoptic.optics.microlens.dust import Blemishes, BlemishSite, dust_record, plane_axes
from plenoptic.optics.microlens.kernels.dust_transmission import fill_aim_transmission, fill_ray_transmission
from plenoptic.optics.microlens.microlens_record import SensorPlane

EPS = np.finfo(float).eps
SENSOR = BlemishSite.SENSOR


def blocks_of(columns):
    """Rows of rays (n, 8) as kernels want them."""
    n = len(columns)
    rows = np.zeros((8, -(-n // BLOCK) * BLOCK))
    rows[:, :n] = columns.T
    return np.ascontiguousarray(rows.reshape(8, -1, BLOCK).transpose(1, 0, 2)).reshape(-1)


def weights_of(blocks, n):
    return blocks.reshape(-1, 8, BLOCK)[:, 6].reshape(-1)[:n]


def aims(points, sensor):
    n = len(points)
    return blocks_of(np.column_stack([points, np.zeros(n), points - sensor, np.zeros(n), np.ones(n), np.zeros(n)]))


def dimmed(blemishes, points, sensor, *, distance, tilt=None, height=None, axes=None):
    """Weights of paths of weight 1."""
    blocks = aims(points, sensor)
    fill_aim_transmission(blocks, SensorPlane(distance, tilt), height, axes, dust_record(blemishes))
    return weights_of(blocks, len(points))


def distances(blemishes, points):
    """(n, m): of points from the segments of blemishes."""
    along = blemishes.end - blemishes.start
    length = np.linalg.norm(along, axis=1)
    unit = along / np.where(length > 0, length, 1.0)[:, None]
    off = points[:, None] - blemishes.start
    t = np.clip(np.einsum("nmk,mk->nm", off, unit), 0.0, length)
    return np.linalg.norm(off - t[..., None] * unit, axis=2)


def passing(blemishes, points):
    """Transmission, blemish by blemish without a grid."""
    return np.where(distances(blemishes, points) < blemishes.radius, blemishes.transmission, 1.0).prod(axis=1)


def clear_of_edges(blemishes, points, off):
    return (np.abs(distances(blemishes, points) - blemishes.radius) > off).all(axis=1)


def some_blemishes(rng, n, *, size, spread, **fields):
    """Grains and scratches of radii and lengths over several powers of ten."""
    start = rng.uniform(-size, size, (n, 2))
    long = rng.integers(0, 2, n) * size * 10.0 ** rng.uniform(-spread, 0.5, n)
    angle = rng.uniform(0, 2 * math.pi, n)
    end = start + long[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    radius = size * 10.0 ** rng.uniform(-spread, 0, n)
    return Blemishes(SENSOR, start, end, radius, rng.uniform(0, 1, n), **fields)


def test_the_area_of_a_scratch():
    radius, side, n, along = 0.1, 2.0, 100_000, np.array([math.cos(0.7), math.sin(0.7)])
    for length in (0.0, 0.5, 1.2):
        scratch = Blemishes(SENSOR, [-0.5 * length * along], [0.5 * length * along], [radius], [0.25])
        points = np.random.default_rng(2).uniform(-side / 2, side / 2, (n, 2))
        fraction = (math.pi * radius**2 + 2 * radius * length) / side**2
        lost = (1 - scratch.at(points)).mean() / 0.75
        assert abs(lost - fraction) < 4 * math.sqrt(fraction * (1 - fraction) / n), length


def overlap(r, rho, d):
    """Area that discs of radii r and rho share, centres d apart."""
    if d >= r + rho:
        return 0.0
    if d <= abs(r - rho):
        return math.pi * min(r, rho) ** 2
    a = math.acos((d * d + r * r - rho * rho) / (2 * d * r))
    b = math.acos((d * d + rho * rho - r * r) / (2 * d * rho))
    return r * r * (a - math.sin(2 * a) / 2) + rho * rho * (b - math.sin(2 * b) / 2)


def test_dust_at_a_height_has_a_penumbra():
    for height in [0.2, 0.6]:
        # A cone from a disc of radius a, at a distance D, is at a height g a disc of radius rho = g a / D: what a grain
        # takes of it is the overlap of two discs. The penumbra is 2 rho wide.
        aperture, distance, radius, n = 0.3, 2.0, 0.05, 40_000
        grain = Blemishes(SENSOR, [(0, 0)], [(0, 0)], [radius], [0.0], height=height)
        rng = np.random.default_rng(3)
        rho = height * aperture / distance
        for d in (0.0, 0.5 * rho, abs(radius - rho), radius, max(radius, rho), radius + 0.5 * rho, radius + 1.01 * rho):
            sensor = np.tile((d, 0.0), (n, 1))
            r, angle = aperture * np.sqrt(rng.uniform(0, 1, n)), rng.uniform(0, 2 * math.pi, n)
            points = sensor + np.stack([r * np.cos(angle), r * np.sin(angle)], axis=1)
            lost = 1 - dimmed(grain, points, sensor, distance=distance, height=height).mean()
            fraction = overlap(radius, rho, d) / (math.pi * rho**2)
            # Binomial, and none at all beyond the penumbra.
            assert abs(lost - fraction) <= 4 * math.sqrt(fraction * (1 - fraction) / n) + 1e-12, height


def test_the_array_s_plane_is_where_paths_are_aimed():
    rng = np.random.default_rng(5)
    listed = some_blemishes(rng, 200, size=1.0, spread=2.0)
    points, sensor = rng.uniform(-1, 1, (2, 1000, 2))
    assert np.array_equal(dimmed(listed, points, sensor, distance=1.7), listed.at(points))
    # A plane at the array's distance is the same one, to rounding.
    clear = clear_of_edges(listed, points, 8 * EPS)
    assert np.array_equal(dimmed(listed, points, sensor, distance=1.7, height=1.7)[clear], listed.at(points)[clear])
    # Axes that are the same are none.
    assert plane_axes(np.eye(3), np.array([0.0, 0.0, 5.0]), height=1.0) is None
    moved = plane_axes(np.eye(3), np.array([0.5, 0.0, 5.0]), height=1.0)
    assert moved is not None and moved.tolist() == [[1, 0, -0.5], [0, 1, 0]]


@settings(max_examples=30)
@given(seed=st.integers(0, 10_000), height=st.floats(0.0, 0.9))
def test_a_tilted_and_decentred_sensor(seed, height):
    rng = np.random.default_rng(seed)
    turn, shift = rotation_about(rng.normal(size=3), rng.uniform(-0.3, 0.3)), np.array([0.3, -0.2, 2.0])
    listed = some_blemishes(rng, 50, size=1.0, spread=1.0, height=height)

    flat = np.column_stack([rng.uniform(-1, 1, (300, 2)), np.zeros(300)])
    start = flat @ turn.T + shift
    aim = np.column_stack([start[:, :2] + rng.uniform(-1, 1, (300, 2)), np.zeros(300)])
    # Where the straight line meets the plane z = -height of the sensor's own axes.
    ahead = (aim - shift) @ turn
    t = -height / ahead[:, 2]
    crossing = flat[:, :2] + t[:, None] * (ahead[:, :2] - flat[:, :2])
    clear = clear_of_edges(listed, crossing, 64 * EPS)

    slopes = -turn[:2, 2] / turn[2, 2]
    plane = {"distance": shift[2] - slopes @ shift[:2], "tilt": slopes, "height": height}
    weights = dimmed(listed, aim[:, :2], start[:, :2], axes=plane_axes(turn, shift, height=height), **plane)
    # Points of a few mm through some twenty operations; products of up to 50 numbers.
    assert weights[clear] == pytest.approx(passing(listed, crossing)[clear], rel=64 * EPS) and clear.sum() > 290


def test_rays_are_dimmed_where_they_cross_a_plane():
    rng = np.random.default_rng(6)
    listed = some_blemishes(rng, 300, size=1.0, spread=2.0)
    n, z = 1000, 3.0
    origin = rng.uniform(-1, 1, (n, 3)) + np.array([0.0, 0.0, 5.0])
    along = np.column_stack([rng.uniform(-0.3, 0.3, (n, 2)), -np.ones(n)])
    along /= np.linalg.norm(along, axis=1)[:, None]
    weight = rng.uniform(0.5, 2.0, n)
    status = np.zeros(n)
    lost = rng.uniform(size=n) < 0.1
    status[lost] = pl.RayStatus.MISSED
    origin[lost] = rng.choice([np.nan, np.inf, -np.inf, 1e300], (lost.sum(), 3))
    along[lost] = rng.choice([np.nan, 0.0, 1.0], (lost.sum(), 3))
    rays = np.column_stack([origin, along, weight, status])
    turned = np.array([[0.8, -0.6, 0.1], [0.6, 0.8, -0.2]])
    blocks = blocks_of(rays)
    fill_ray_transmission(blocks, z, turned, dust_record(listed))
    with np.errstate(all="ignore"):  # of lost rays
        crossing = origin + ((z - origin[:, 2]) / along[:, 2])[:, None] * along
        local = crossing[:, :2] @ turned[:, :2].T + turned[:, 2]
    clear = ~lost
    clear[~lost] = clear_of_edges(listed, local[~lost], 64 * EPS)
    expected = weight[clear] * passing(listed, local[clear])
    assert weights_of(blocks, n)[clear] == pytest.approx(expected, rel=64 * EPS)
    # Nothing but weights changes.
    rays_out = blocks.reshape(-1, 8, BLOCK).transpose(1, 0, 2).reshape(8, -1)[:, :n].T
    assert np.array_equal(np.delete(rays_out, 6, axis=1), np.delete(rays, 6, axis=1), equal_nan=True)


@settings(max_examples=40)
@given(
    seed=st.integers(0, 10_000),
    n=st.integers(0, 120),
    size=st.sampled_from([1e-6, 1.0, 1e6]),
    spread=st.sampled_from([0.0, 1.0, 4.0]),
    far=st.sampled_from([0.0, 1e3]),
)
def test_bins_find_what_a_search_of_all_finds(seed, n, size, spread, far):
    rng = np.random.default_rng(seed)
    listed = some_blemishes(rng, n, size=size, spread=spread)
    offset = far * size * rng.uniform(-1, 1, 2)
    listed = Blemishes(SENSOR, listed.start + offset, listed.end + offset, listed.radius, listed.transmission)
    points = offset + rng.uniform(-3 * size, 3 * size, (200, 2))
    if n:
        # Close to segments and edges too, where the bins' own edges matter.
        k = rng.integers(0, n, 400)
        t, angle = rng.uniform(0, 1, 400)[:, None], rng.uniform(0, 2 * math.pi, 400)
        offsets = (
            np.stack([np.cos(angle), np.sin(angle)], axis=1) * (listed.radius[k] * rng.uniform(0, 1, 400))[:, None]
        )
        points = np.concatenate([points, listed.start[k] + t * (listed.end[k] - listed.start[k]) + offsets])
    clear = clear_of_edges(listed, points, 32 * EPS * size * (1 + far))
    assert listed.at(points)[clear] == pytest.approx(passing(listed, points)[clear], rel=2 * max(n, 1) * EPS)


def test_the_grid_stays_small():
    n = 20_000
    for radius in (1e-4, 0.02, 5.0):
        rng = np.random.default_rng(7)
        start = rng.uniform(-5, 5, (n, 2))
        end = start + [[8.0, 3.0]] * (rng.uniform(size=(n, 1)) < 0.01)
        tables = dust_record(Blemishes(SENSOR, start, end, radius, 0))
        # At most 2 n bins, one more along each side of the grid, at most 2 n long; 16 entries for each blemish.
        assert tables.first.size <= 6 * n + 2 and tables.members.size == tables.first[-1] <= 16 * n, radius
        # A bin on average holds less than its share of grains and the scratches that cross it.
        assert radius > 1e-4 or np.diff(tables.first).mean() < 4


def test_a_row_of_grains_makes_a_row_of_bins():
    start = np.column_stack([np.arange(1000.0), np.zeros(1000)])
    row = Blemishes(SENSOR, start, start, 1e-3, 0.5)
    assert dust_record(row).first.size <= 6002
    assert row.at(start).tolist() == [0.5] * 1000 and row.at(start + np.array([0.5, 0.0])).tolist() == [1.0] * 1000
    # One grain larger than the sensor, and none.
    cap = Blemishes(SENSOR, [(0, 0)], [(0, 0)], 100.0, 0.5)
    assert cap.at([(0, 0), (99.9, 0), (100.1, 0), (-1e9, 1e9)]).tolist() == [0.5, 0.5, 1.0, 1.0]
    none = Blemishes(SENSOR, [], [], [], [])
    points, sensor = np.random.default_rng(8).uniform(-1, 1, (2, 300, 2))
    assert len(none) == 0 and np.all(dimmed(none, points, sensor, distance=1.0, height=0.3) == 1.0)
    blocks = aims(points, sensor)
    fill_ray_transmission(blocks, 0.0, None, dust_record(none))
    assert np.all(weights_of(blocks, 300) == 1.0)


GRAIN = {"site": SENSOR, "start": [(0, 0)], "end": [(0, 0)], "radius": [0.1], "transmission": [0.5]}


def test_impossible_blemishes():
    for changes, message in (
        ({"end": []}, r"end of the blemishes has shape \(0, 2\); it must have shape \(1, 2\)"),
        ({"end": [(0, math.inf)]}, "end of the blemishes holds a number that is not finite"),
        ({"radius": [0.0]}, "radius of a blemish is 0 mm; it must be above 0"),
        ({"transmission": [1.5]}, "transmission of the blemishes holds a number outside 0 to 1"),
        ({"height": -0.1}, "height of the blemishes is -0.1 mm; it must be at least 0"),
        ({"height": 0.1, "site": BlemishSite.ARRAY}, "height of the blemishes is 0.1 mm at the site ARRAY"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=message):
            Blemishes(**(GRAIN | changes))
    for changes, message in (
        ({"half_size": (0.0, 1.0)}, "half_size is 0 mm; it must be above 0"),
        ({"dust_per_mm2": -1.0}, "dust_per_mm2 is -1; it must be at least 0"),
        ({"dust_per_mm2": 1e9}, "some 2e[+]11 blemishes are asked for, and the limit is 5000000"),
        ({"dust_radius": 0.0}, "dust_radius is 0 mm"),
        ({"dust_spread": -0.1}, "dust_spread is -0.1; it must be at least 0"),
        ({"scratch_length": 0.0}, "scratch_length is 0 mm"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=message):
            scattered(**changes)


def scattered(**changes):
    fields = {"half_size": (10.0, 5.0), "dust_per_mm2": 20.0, "scratches": 300, "seed": 3} | changes
    return Blemishes.scattered(SENSOR, **fields)


def test_a_seed_gives_the_same_blemishes():
    assert scattered() == scattered() and scattered(seed=4) != scattered()
    # Scratches do not move the dust.
    dust = len(scattered(scratches=0))
    assert np.array_equal(scattered(scratches=0).start, scattered().start[:dust])
    assert len(scattered()) == dust + 300


def test_dust_is_poisson_in_number_and_log_normal_in_size():
    counts = np.array([len(scattered(scratches=0, dust_per_mm2=0.5, seed=seed)) for seed in range(300)])
    mean = 0.5 * 200.0
    # Poisson: variance = mean; the variance's own standard deviation over its value is sqrt(2/300 + 1/(300 mean)).
    assert abs(counts.mean() - mean) < 4 * math.sqrt(mean / 300)
    assert abs(counts.var(ddof=1) / mean - 1) < 4 * math.sqrt(2 / 300 + 1 / (300 * mean))
    dust = scattered(scratches=0, dust_radius=0.02, dust_spread=0.7)
    n, logs = len(dust), np.log(dust.radius / 0.02)
    assert abs(logs.mean()) < 4 * 0.7 / math.sqrt(n) and abs(logs.std() / 0.7 - 1) < 4 / math.sqrt(2 * n)
    # Uniform: variance side^2 / 12 over a side.
    assert np.all(np.abs(dust.start) <= [10.0, 5.0])
    assert np.all(np.abs(dust.start.mean(axis=0)) < 4 * np.array([20.0, 10.0]) / math.sqrt(12 * n))
    assert np.array_equal(dust.start, dust.end)
    assert np.all(scattered(scratches=0, dust_spread=0.0).radius == 0.005)


def test_scratches_have_their_length_width_and_any_direction():
    lines = scattered(dust_per_mm2=0.0, scratches=2000, scratch_length=0.8, scratch_width=0.03)
    along = lines.end - lines.start
    # Ends are good to an eps of up to 10.4 mm each.
    assert np.linalg.norm(along, axis=1) == pytest.approx(0.8, abs=32 * EPS * 10.4)
    assert np.all(lines.radius == 0.015) and np.all(lines.transmission == 0.0)
    assert np.all(np.abs(0.5 * (lines.start + lines.end)) <= [10.0 + 1e-12, 5.0 + 1e-12])
    # Directions without a sign: the mean of exp(2 i angle) has real and imaginary parts of variance 1 / (2 n).
    doubled = np.exp(2j * np.arctan2(along[:, 1], along[:, 0])).mean()
    assert max(abs(doubled.real), abs(doubled.imag)) < 4 / math.sqrt(2 * 2000)


def test_the_area_that_dust_covers():
    # Grains of one radius placed at random: the share of the plane they leave open is exp(-density pi r^2).
    radius, density = 0.05, 30.0
    dust = scattered(scratches=0, dust_per_mm2=density, dust_radius=radius, dust_spread=0.0)
    points = np.random.default_rng(9).uniform(-1, 1, (20_000, 2)) * [9.9, 4.9]
    open_share = math.exp(-density * math.pi * radius**2)
    # Points closer than 2 r share grains: some 200 / (pi (2 r)^2) independent places.
    places = 4 * 9.9 * 4.9 / (math.pi * (2 * radius) ** 2)
    sigma = math.sqrt(open_share * (1 - open_share) * (1 / places + 1 / 20_000))
    assert abs(dust.at(points).mean() - open_share) < 4 * sigma
