import functools
import math

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.optics.lens.lens_record import lens_record
from plenoptic.optics.lens.pupil.exit_pupil import PupilBounds, pupil_bounds
from plenoptic.optics.lens.pupil.outline import SIDES, PupilRays, up_to_stops
from plenoptic.optics.microlens.lattice import polygon_area


def stopped(name: str, semi_diameter: float | None) -> pl.LensStack:
    lens = pl.load_lens(name)
    return lens if semi_diameter is None else lens.with_stop(pl.CircularStop(semi_diameter))


LENSES = [*(("double-gauss-100mm-f2", stop) for stop in (5.0, 0.05, None)), ("double-gauss-105mm-f1.4", None)]
LENSES += [("telephoto-100mm-f2.8", None), *(("topogon-100mm-f6.3", stop) for stop in (None, 1.0))]
LENSES += [("singlet-100mm-f4", None)]
CELL = 0.125
RADIUS = 20.0


def behind(lens: pl.LensStack) -> float:
    """A plane of cells somewhat behind the rear focus."""
    return 1.1 * pl.paraxial.cardinal_points(lens).rear_focus


@functools.cache
def bounds_of(lens: pl.LensStack, *, cell: float = CELL, radius: float = RADIUS) -> PupilBounds:
    return pupil_bounds(lens, z_plane=behind(lens), largest_radius=radius, cell_radius=cell, wavelength=587.6)


def rays_at_the_rear(lens: pl.LensStack, start: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Points on the plane of the last vertex, half of them over the whole rear and half around the pupil, and whether
    the rays to them from `start` reach the scene."""
    z, n = float(lens.vertices[-1]), len(start)
    # Rays may leave the rear vertex plane outside the rim of a surface that bulges backwards.
    rim = 1.05 * lens.elements[-1].semi_diameter
    radius, angle = rim * np.sqrt(rng.uniform(size=n)), rng.uniform(0, 2 * math.pi, n)
    aim = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    points = pl.paraxial.cardinal_points(lens)
    share = (start[:, 2] - z) / (start[:, 2] - points.exit_pupil)
    near = np.arange(n) % 2 == 0
    in_pupil = aim / rim * 1.3 * points.exit_pupil_semi_diameter
    through_pupil = start[:, :2] + share[:, None] * (in_pupil - start[:, :2])
    aim[near] = through_pupil[near]
    out = lens.trace_reverse(pl.RayBundle(start, np.column_stack([aim, np.full(n, z)]) - start))
    return aim, out.status == pl.RayStatus.OK


EVERY = [(*lens, cell) for lens in LENSES for cell in (CELL, 0.6)]
SOME = [(*LENSES[0], 0.6), *((*LENSES[k], CELL) for k in (1, 6))]


@pytest.mark.parametrize("cases", [SOME, pytest.param(EVERY, marks=pytest.mark.slow)], ids=["some", "every"])
def test_every_ray_that_passes_is_inside_its_outline(cases):
    for name, stop, cell in cases:
        lens = stopped(name, stop)
        bounds = bounds_of(lens, cell=cell)
        rng = np.random.default_rng(17)
        n = 60000
        # Cells at all distances, more of them near the axis, where outlines turn fastest.
        rho = RADIUS * rng.uniform(size=n) ** 2
        turn = rng.uniform(0, 2 * math.pi, n)
        centre = np.stack([rho * np.cos(turn), rho * np.sin(turn)], axis=1)
        away, angle = cell * np.sqrt(rng.uniform(size=n)), rng.uniform(0, 2 * math.pi, n)
        # Corners are the hardest: a third of the points lie on the cell's rim.
        away[::3] = cell
        start = centre + np.stack([away * np.cos(angle), away * np.sin(angle)], axis=1)
        start = np.column_stack([start, np.full(n, behind(lens))])
        aim, passed = rays_at_the_rear(lens, start, rng)
        assert np.count_nonzero(passed) > 2000, (name, stop, cell)
        interval = np.minimum((rho / bounds.step).astype(int), len(bounds.support) - 1)
        # In axes turned so that the centre lies on +x.
        x = np.cos(turn) * aim[:, 0] + np.sin(turn) * aim[:, 1]
        y = np.cos(turn) * aim[:, 1] - np.sin(turn) * aim[:, 0]
        over = (np.stack([x, y], axis=1) @ bounds.normals.T - bounds.support[interval]).max(axis=1)
        assert np.all(over[passed] <= 0), (name, stop, cell)
        # And within its largest distance from the axis, which sorts cells out beforehand.
        assert np.all(np.hypot(x, y)[passed] <= bounds.reach[interval][passed]), (name, stop, cell)


def test_outlines_waste_little_on_the_axis_and_their_corners_lie_on_two_sides():
    side = 400
    for name, stop in LENSES[::2]:
        lens = stopped(name, stop)
        bounds = bounds_of(lens)
        for support, corners in zip(bounds.support, bounds.corners, strict=True):
            if np.isfinite(support[0]):
                over = np.abs(corners @ bounds.normals.T - support)
                # Numbers of up to 50 mm, divided by the sine of 22.5 degrees.
                assert max(over[k, [k, (k + 1) % SIDES]].max() for k in range(SIDES)) < 1e-12, (name, stop)
        farthest = np.linalg.norm(bounds.corners, axis=2).max(axis=1)
        assert bounds.reach == pytest.approx(farthest, rel=1e-12), (name, stop)
        if stop == 0.05:
            continue
        half = bounds.reach[0]
        x = (np.arange(side) + 0.5) / side * 2 * half - half
        grid = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2)
        sight = up_to_stops(lens_record(lens, 587.6, reverse=True)), np.array([0, 0, behind(lens)])
        passing = PupilRays(*sight, float(lens.vertices[-1])).fates(grid).code == 0
        area = np.count_nonzero(passing) * (2 * half / side) ** 2
        # The circle's 16-gon (1.013), one step of the grid of 128 (about 1.05), and what the cell and the interval of
        # 0.8 mm move: with a stop of 1 mm that is most of it. Counting cells of the grid is good to 2 / 400.
        limit = 1.6 if stop is None or stop >= 5.0 else 4.0
        assert area * 0.99 < polygon_area(bounds.corners[0]) < limit * area, (name, stop)
    # A plane that sees no light has no outline: 150 mm from the axis of a telephoto the barrel cuts everything off.
    bounds = bounds_of(pl.load_lens("telephoto-100mm-f2.8"), radius=150.0)
    assert bounds.reach[0] > 0 and bounds.reach[-1] == 0 and np.all(bounds.support[-1] == -np.inf)


@pytest.mark.slow
def test_tiny_pupils_are_bounded_up_to_the_end_of_the_field():
    lens = stopped("telephoto-100mm-f2.8", 0.1)
    z, rng, n = 42.5, np.random.default_rng(4), 200000
    bounds = pupil_bounds(lens, z_plane=z, largest_radius=25.0, cell_radius=1.5, wavelength=587.6)
    rho = rng.uniform(8.0, 16.0, n)
    start = np.column_stack([rho + rng.uniform(-1.0, 1.0, n), rng.uniform(-1.0, 1.0, n), np.full(n, z)])
    aim, passed = rays_at_the_rear(lens, start, rng)
    assert np.count_nonzero(passed) > 100
    over = (aim @ bounds.normals.T - bounds.support[(rho / bounds.step).astype(int)]).max(axis=1)
    assert np.all(over[passed] <= 0)
