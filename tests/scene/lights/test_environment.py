"""Environment maps: which way they lie, and directions drawn by their light."""

import itertools
import math

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.core.kernels.vectors import row_vector
from plenoptic.core.numba.jit import kernel
from plenoptic.scene.lights.build_lights import _guide, environment_record, texel_solid_angles
from plenoptic.scene.lights.environment import MAX_TEXELS, EnvironmentMap
from plenoptic.scene.lights.kernels.sky import (
    map_angles,
    map_axes,
    sample_cdf,
    sample_environment,
    sample_guided_cdf,
    texel_at,
)

LAST = 1 - 2.0**-32
"""The largest coordinate of a sampling point."""
AHEAD, RIGHT, UP = np.array([0.0, 0, -1]), np.array([1.0, 0, 0]), np.array([0.0, 1, 0])


@kernel
def fill_draws(directions, cells, points, environment):
    for i in range(points.shape[0]):
        w, row, column = sample_environment(points[i, 0], points[i, 1], environment)
        directions[i, 0], directions[i, 1], directions[i, 2] = w
        cells[i, 0], cells[i, 1] = row, column


@kernel
def fill_lookups(cells, densities, directions, density, rotation):
    axes = map_axes(rotation)
    for i in range(directions.shape[0]):
        angles = map_angles(row_vector(directions, i, 0), axes)
        row, column = texel_at(angles, density.shape[0], density.shape[1])
        cells[i, 0], cells[i, 1] = row, column
        densities[i] = density[row, column]


@kernel
def count_differences(cdf, guide, u):
    differences = 0
    for i in range(u.size):
        if sample_cdf(cdf, u[i]) != sample_guided_cdf(cdf, guide, u[i]):
            differences += 1
    return differences


def draws(tables, points):
    directions, cells = np.empty((len(points), 3)), np.empty((len(points), 2), dtype=np.int64)
    fill_draws(directions, cells, points, tables)
    return directions, cells


def lookups(tables, directions):
    cells, densities = np.empty((len(directions), 2), dtype=np.int64), np.empty(len(directions))
    fill_lookups(cells, densities, np.asarray(directions, dtype=np.float64), tables.pdf, tables.rotation)
    return cells, densities


def some_rotation(rng):
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return rotation * np.sign(np.linalg.det(rotation))


def some_map(seed, *, shape=None, rotated=True):
    """Radiances over six orders of magnitude, with black texels, black rows and coloured channels."""
    rng = np.random.default_rng(seed)
    rows, columns = rng.integers(1, 9, size=2) if shape is None else shape
    texels = 10 ** rng.uniform(-3, 3, size=(rows, columns, 3)) * (rng.random((rows, columns, 1)) < 0.7)
    texels[rng.random(rows) < 0.2] = 0.0
    texels[rng.integers(rows), rng.integers(columns)] += 1.0
    return EnvironmentMap(texels, some_rotation(rng) if rotated else None)


MAPS = [some_map(seed, rotated=seed % 2 == 0) for seed in range(6)]
LARGE = some_map(99, shape=(256, 2048))
SINGLE = EnvironmentMap(np.full((1, 1, 1), 2.0))


def test_the_middle_lies_ahead_and_columns_run_to_the_right():
    texels = np.arange(1.0, 33).reshape(4, 8, 1)
    world = EnvironmentMap(texels)
    for direction, row, column in (
        ((0, 1, 0), 0, None),
        ((0, -1, 0), 3, None),
        # A little to the right and to the left of straight ahead, above and below the horizon.
        ((0.1, 0.1, -1), 1, 4),
        ((-0.1, -0.1, -1), 2, 3),
        ((1, 0.1, -0.1), 1, 5),
        ((1, 0.1, 0.1), 1, 6),
        ((-1, 0.1, -0.1), 1, 2),
        # The borders of the image lie behind.
        ((0.1, 0.1, 1), 1, 7),
        ((-0.1, 0.1, 1), 1, 0),
    ):
        cells, _ = lookups(environment_record(world, 1), [direction, 7.5 * np.array(direction)])
        assert cells[:, 0].tolist() == [row, row], direction
        if column is not None:
            assert cells[:, 1].tolist() == [column, column], direction
            assert world.radiance([direction]).tolist() == [[texels[row, column, 0]]]
    odd = EnvironmentMap(np.array([[[1.0], [2.0], [3.0]]]))
    assert odd.radiance([AHEAD, AHEAD + 1.7 * RIGHT, AHEAD + 1.8 * RIGHT]).tolist() == [[2], [2], [3]]


def test_rotations_take_the_map_to_the_world():
    # Columns are where the map's axes go: its x to the world's y, its y to z, its z to x.
    rotation = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    texels = np.ones((4, 8, 3))
    texels[0] = 5.0
    assert EnvironmentMap(texels, rotation).radiance([rotation @ UP, UP])[:, 0].tolist() == [5.0, 1.0]
    # And the other way to turn there: about -z, then as by hand.
    plain = EnvironmentMap(texels)
    turned = plain.rotated(UP, math.pi / 2)
    assert turned.rotation @ AHEAD == pytest.approx(-RIGHT)
    expected = plain.rotated_deg(AHEAD, math.degrees(0.3)).rotation @ turned.rotation
    assert turned.rotated(AHEAD, 0.3).rotation == pytest.approx(expected)


def drawn_light(texels, solid_angle):
    """Light of each texel, as far as it exceeds three quarters of the mean: by it directions are drawn."""
    radiance = texels.mean(axis=2, dtype=np.float64)
    return np.maximum(radiance - 0.75 * (radiance * solid_angle).sum() / (4 * math.pi), 0.0) * solid_angle


def test_the_density_integrates_to_one_and_is_proportional_to_the_light_above_the_mean():
    for world in (*MAPS, LARGE, SINGLE):
        rows, columns, channels = world.texels.shape
        tables = environment_record(world, channels)
        solid_angle = texel_solid_angles(rows, columns)[:, None]
        edges = np.cos(np.pi * np.arange(rows + 1) / rows)
        # Cosines of neighbours cancel: to some eps.
        np.testing.assert_allclose(solid_angle[:, 0], 2 * np.pi / columns * -np.diff(edges), rtol=1e-14, atol=1e-15)
        share = tables.pdf * solid_angle
        # Sums of up to 5e5 steps of cumulative sums: each is right to an eps of the sum, and they telescope.
        assert share.sum() == pytest.approx(1.0, abs=1e-12)
        light = world.texels.mean(axis=2, dtype=np.float64) * solid_angle
        assert tables.total == pytest.approx(light.sum(), rel=1e-12)
        drawn = drawn_light(world.texels, solid_angle)
        np.testing.assert_allclose(share, drawn / drawn.sum(), atol=1e-13)
        assert not share[drawn == 0].any()
        assert (solid_angle * np.ones(columns)).sum() == pytest.approx(4 * math.pi, rel=1e-13)


def test_draws_follow_the_density_between_texels_and_within():
    n = 200_000
    for world in (*MAPS, SINGLE):
        directions, _ = draws(environment_record(world, 3), np.random.default_rng(7).random((n, 2)))
        x, y, z = (directions if world.rotation is None else directions @ world.rotation).T
        rows, columns, _ = world.texels.shape
        # Each texel in 2 x 2 parts of equal solid angle, by another formula than the kernel's.
        edges = np.cos(np.pi * np.arange(rows + 1) / rows)
        halves = np.sort(np.concatenate([edges, 0.5 * (edges[1:] + edges[:-1])]))
        row = 2 * rows - np.searchsorted(halves, y).clip(1, 2 * rows)
        column = np.floor((np.angle(-z + 1j * x) / (2 * np.pi) + 0.5) * 2 * columns).astype(int)
        counts = np.zeros((2 * rows, 2 * columns))
        np.add.at(counts, (row, column.clip(0, 2 * columns - 1)), 1)
        light = drawn_light(world.texels, -2 * math.pi / columns * np.diff(edges)[:, None])
        expected = np.kron(n * light / light.sum(), np.full((2, 2), 0.25))
        assert not counts[expected == 0].any()
        # Where few are expected, a count is not normal: these are counted together, as Poisson numbers are.
        rare = expected < 20
        total = expected[rare].sum()
        assert abs(counts[rare].sum() - total) < 5 * math.sqrt(total) + 5
        # The cube root of chi-square over its degrees of freedom k is normal, with mean 1 - 2/(9k) and variance 2/(9k)
        # (E. B. Wilson and M. M. Hilferty, 1931): 5 standard deviations.
        chi2 = ((counts - expected)[~rare] ** 2 / expected[~rare]).sum()
        freedom = (~rare).sum() - 1
        spread = 2 / (9 * freedom)
        assert freedom > 2 and (chi2 / freedom) ** (1 / 3) < 1 - spread + 5 * math.sqrt(spread), world


def test_both_ways_to_search_a_table_find_the_same():
    for entries, power in itertools.product((1, 2, 3, 5, 17, 300, 4096), (0, 1, 30)):
        rng = np.random.default_rng(entries)
        # From all alike to a few that hold nearly everything; a third is 0, and both ends are at times.
        share = rng.random(entries) ** power * (rng.random(entries) < 0.67)
        share[rng.integers(entries)] = 1.0
        cdf = np.cumsum(share) / share.sum()
        cdf[np.flatnonzero(share)[-1] :] = 1.0
        # Random numbers, all borders, and what lies just beside them.
        u = np.concatenate([rng.random(20_000), cdf, np.nextafter(cdf, 0), np.nextafter(cdf, 1), [0.0, LAST]])
        for size in {1, (entries + 3) // 4, entries, 5000}:
            assert count_differences(cdf, _guide(cdf, size), u[u < 1]) == 0, (entries, power, size)


def test_lookups_find_the_texels_that_were_drawn():
    for world in (*MAPS, LARGE, SINGLE):
        tables = environment_record(world, 3)
        points = np.random.default_rng(3).random((20_000, 2))
        # All combinations of the ends of both intervals, where rounding counts.
        ends = np.array([0.0, 2.0**-32, 0.25, 0.5, LAST])
        points[:25] = np.stack(np.meshgrid(ends, ends), axis=-1).reshape(-1, 2)
        directions, cells = draws(tables, points)
        found, densities = lookups(tables, directions)
        np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, atol=2e-15)
        np.testing.assert_array_equal(found[:, 0], cells[:, 0])
        if world.rotation is not None:
            # An azimuth has an error of some 2 eps / sine there, and must be right to 2^-30 of a column at its borders,
            # 3e-12 for 2048 columns. Only draws from the ends come so near to a pole.
            local = directions @ world.rotation
            sure = np.hypot(local[:, 0], local[:, 2]) > 5e-4
            assert sure[25:].all()
            directions, cells, found, densities = directions[sure], cells[sure], found[sure], densities[sure]
        np.testing.assert_array_equal(found, cells)
        np.testing.assert_array_equal(densities, tables.pdf[cells[:, 0], cells[:, 1]])
        assert (densities > 0).all()
        np.testing.assert_array_equal(world.radiance(directions), world.texels[cells[:, 0], cells[:, 1]])
    # Lookups on axes and borders stay inside.
    directions = np.array([UP, -UP, AHEAD, -AHEAD, RIGHT, -RIGHT, [0, 0, 1.0], [-0.0, 0, 1.0], [0, 1, -0.0]])
    one_texel = (directions[:, 0] != 0) | (
        directions[:, 2] < 0
    )  # others lie at a pole, or on the left border and the right
    for world in (*MAPS[1::2], SINGLE):
        rows, columns, _ = world.texels.shape
        plain = EnvironmentMap(world.texels)
        (row, column), _ = (part.T for part in lookups(environment_record(plain, 3), directions))
        assert (row >= 0).all() and (row < rows).all() and (column >= 0).all() and (column < columns).all()
        np.testing.assert_array_equal(plain.radiance(directions)[one_texel], world.texels[row, column][one_texel])


def test_a_texel_at_the_pole_keeps_its_digits():
    texels = np.zeros((8192, 4, 1))
    texels[[0, -1]] = 1.0
    directions, cells = draws(environment_record(EnvironmentMap(texels), 1), np.random.default_rng(5).random((1000, 2)))
    up = cells[:, 0] == 0
    assert np.isin(cells[:, 0], [0, 8191]).all() and 400 < up.sum() < 600
    np.testing.assert_array_equal(directions[:, 1] > 0, up)
    # Uniform in solid angle: the squared sine, here angle^2, is uniform from 0 to (pi / 8192)^2; 5 standard errors.
    part = (directions[:, 0] ** 2 + directions[:, 2] ** 2) / math.sin(math.pi / 8192) ** 2
    assert part.max() <= 1.0 + 1e-6
    assert part.mean() == pytest.approx(0.5, abs=5 / math.sqrt(12 * 1000))


def test_tables_have_the_channels_of_the_scene_and_nothing_they_need_not():
    grey = EnvironmentMap(np.ones((2, 4, 3)))
    assert grey.is_grey and not MAPS[0].is_grey
    assert environment_record(grey, 1).texels.shape == (2, 4, 1)
    single = environment_record(SINGLE, 3)
    assert single.texels.tolist() == [[[2.0, 2.0, 2.0]]] and single.rotation is None
    assert EnvironmentMap(SINGLE.texels, np.eye(3)) == SINGLE
    assert environment_record(EnvironmentMap(np.zeros((3, 4, 3))), 3) is None
    # Brightness changes nothing but the total.
    texels = np.random.default_rng(4).random((3, 5, 1)).astype(np.float32)
    for brightness in (1e-38, 1e38):
        plain, scaled = (environment_record(EnvironmentMap(texels * np.float32(f)), 1) for f in (1, brightness))
        # 1e-38 is next to float32's denormals, which have fewer digits.
        np.testing.assert_allclose(scaled.pdf, plain.pdf, rtol=1e-5)
        assert scaled.total == pytest.approx(plain.total * brightness, rel=1e-5)


def test_environments_come_from_image_files(tmp_path):
    texels = np.random.default_rng(6).random((2, 4, 3)).astype(np.float32)
    path, rotation = tmp_path / "sky.exr", MAPS[0].rotation
    pl.images.write_channels(path, {name: texels[..., k] for k, name in enumerate("RGB")})
    assert EnvironmentMap.load(path, rotation) == EnvironmentMap(texels, rotation)
    pl.images.write_channels(path, {name: texels[..., k] - 0.5 for k, name in enumerate("RGB")})
    with pytest.raises(pl.errors.FileError, match=r"sky\.exr: texels lie between -.*0 or more"):
        EnvironmentMap.load(path)


def test_impossible_environments_are_refused():
    one = np.ones((1, 1, 3))
    for texels, rotation, said in (
        (np.zeros((2, 2, 4)), None, "drop alpha"),
        (np.zeros((2, 2, 3), dtype=np.uint8), None, "EnvironmentMap.load"),
        (one, 2 * np.eye(3), "orthonormal"),
        (one, np.diag([1.0, 1, -1]), "right-handed"),
        (one, np.full((3, 3), np.nan), "orthonormal"),
        (np.zeros((0, 2, 3)), None, "0 x 2 texels"),
        (np.broadcast_to(np.float32(0), (MAX_TEXELS // 2 + 1, 2, 1)), None, "texels"),
        (-0.1 * one, None, "0 or more"),
        (1e39 * one, None, "finite"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=said):
            EnvironmentMap(texels, rotation)
    for directions in ([[0, 0, 0]], [[np.nan, 0, 1]], [[np.inf, 0, 1]]):
        with pytest.raises(pl.errors.SceneError, match="directions"):
            SINGLE.radiance(directions)
