"""Optical paths: of the rays that are traced, as Fermat and Malus have them, there and back."""

import dataclasses
import itertools

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.aberrations import optical_path
from plenoptic.errors import InvalidValueError

EPS = np.finfo(float).eps
LENSES = ("double-gauss-100mm-f2", "asphere-15mm-f0.9", "fisheye-100mm-f8", "mirror-1000mm-f7.5", "zoom-14mm-f4")


def rays_of(lens, n=64, seed=0, spread=0.01):
    """Rays towards the middle of the front of a lens, from 30 mm before it."""
    random = np.random.default_rng(seed)
    size = 0.5 * pl.paraxial.cardinal_points(lens).entrance_pupil_semi_diameter
    origin = np.column_stack([random.uniform(-size, size, (n, 2)), np.full(n, lens.vertices[0] - 30.0)])
    return pl.RayBundle(origin, np.column_stack([random.normal(0, spread, (n, 2)), np.ones(n)]))


def kinds():
    found = {name: pl.load_lens(name) for name in LENSES}
    gauss = found["double-gauss-100mm-f2"]
    turned = gauss.moved(2, shift=(0.3, -0.2, 0.1), tilt=(0.02, -0.01, 0.0))
    found["decentred and tilted"] = turned.moved(7, tilt=(0, 0.03, 0))
    freeform = pl.optics.ZernikeSag((0.0, 0.0, 0.0, 1e-3, 5e-3, -2e-3), 25.0)
    bent = dataclasses.replace(gauss.elements[0], freeform=freeform)
    found["freeform"] = dataclasses.replace(gauss, elements=(bent, *gauss.elements[1:]))
    return found


KINDS = kinds()


def test_the_rays_are_those_of_trace():
    for name, lens in KINDS.items():
        there = rays_of(lens, 300)
        behind = lens.trace(there)
        behind = behind.selected(behind.status == 0)
        back = pl.RayBundle(behind.origin + 5 * behind.direction, -behind.direction)
        for rays, traced in ((there, lens.trace(there)), (back, lens.trace_reverse(back))):
            found, path = optical_path(lens, rays, reverse=rays is back)
            for field in ("origin", "direction", "weight", "status", "lost_at"):
                np.testing.assert_array_equal(getattr(found, field), getattr(traced, field), err_msg=name)
            assert np.array_equal(np.isnan(path), traced.status != 0) and (path > 0).any(), name


def test_there_and_back_is_as_long_and_neighbours_obey_malus_and_dupin():
    for name, lens in KINDS.items():
        rays = rays_of(lens)
        behind, path = optical_path(lens, rays)
        passed = np.flatnonzero(behind.status == 0)
        assert len(passed) > 20, name
        kept = behind.selected(passed)
        back, again = optical_path(lens, pl.RayBundle(kept.origin, -kept.direction), reverse=True)
        # They stand on the first element: from there the way to the origins is left.
        missing = np.linalg.norm(rays.origin[passed] - back.origin, axis=1)
        np.testing.assert_allclose(again + missing, path[passed], rtol=0, atol=100 * EPS * path[passed].max())
        # The trapezium leaves the third order: some h^3 over squares of radii, of 5 mm and more, and paths in glass.
        assert malus_and_dupin(lens, rays, np.random.default_rng(5), 30) > 20, name


def malus_and_dupin(lens, rays, random, allowed, reverse=False):
    """Paths change by n' d' . dE - n d . dO from a ray to its neighbour: wavefronts are perpendicular to rays."""
    h, n = 1e-3, len(rays)
    moved = rays.origin + h * random.normal(size=(n, 3)) * [1, 1, 0.5]
    other = pl.RayBundle(moved, rays.direction + h / 30 * random.normal(size=(n, 3)))
    (one, path), (two, there) = (optical_path(lens, part, reverse=reverse) for part in (rays, other))
    both = (one.status == 0) & (two.status == 0)
    mean, before = 0.5 * (one.direction + two.direction), 0.5 * (rays.direction + other.direction)
    expected = ((two.origin - one.origin) * mean).sum(axis=1) - ((other.origin - rays.origin) * before).sum(axis=1)
    np.testing.assert_allclose((there - path)[both], expected[both], rtol=0, atol=allowed * h**3)
    return np.count_nonzero(np.abs(expected[both]) > 0.1 * h)


def test_a_parabola_brings_parallel_light_to_its_focus_in_step():
    focal = 500.0
    mirror = pl.Surface(-2 * focal, thickness=400.0, medium=pl.optics.MIRROR, semi_diameter=60.0, conic=-1.0)
    lens = pl.LensStack([pl.CircularStop(50.0, thickness=450.0), mirror, pl.CircularStop(100.0)])
    random = np.random.default_rng(1)
    origin = np.column_stack([random.uniform(-30, 30, (50, 2)), np.full(50, -20.0)])
    behind, path = optical_path(lens, pl.RayBundle(origin, np.tile([0, 0, 1.0], (50, 1))))
    z = lens.vertices[1] + focal  # unfolded: light goes on towards +z
    left = (z - behind.origin[:, 2]) / behind.direction[:, 2]
    np.testing.assert_allclose(behind.origin[:, :2] + left[:, None] * behind.direction[:, :2], 0, atol=1e-9)
    np.testing.assert_allclose(path + left, 20.0 + 450.0 + focal, rtol=0, atol=20 * EPS * 1000)


def test_origins_behind_the_lens_have_negative_paths():
    z = np.array([-50.0, 0.0, 80.0])
    rays = pl.RayBundle(np.column_stack([np.zeros((3, 2)), z]), np.tile([0, 0, 1.0], (3, 1)))
    _, path = optical_path(pl.load_lens("singlet-100mm-f4"), rays)
    np.testing.assert_allclose(path[0] - path, z - z[0], atol=1e-13)
    assert path[2] < 0


def test_ideal_lenses_take_a_point_to_its_image_in_step():
    for model, side in itertools.product((pl.LensModel.THIN, pl.LensModel.PARAXIAL), (-1.0, 1.0)):
        lens = pl.load_lens("double-gauss-100mm-f2").with_model(model)
        point = np.array([3.0, -2.0, 250.0 * side])
        random = np.random.default_rng(2)
        away = np.column_stack([random.uniform(-5, 5, (20, 2)), np.zeros(20)]) - point
        rays = pl.RayBundle(point + random.uniform(0, 0.1, (20, 1)) * away, away)
        behind, path = optical_path(lens, rays, reverse=side > 0, point=point)
        # Where two of them meet is the image of all.
        a, b = behind.origin[0], behind.origin[1]
        u, v = behind.direction[0], behind.direction[1]
        image = a + np.linalg.lstsq(np.column_stack([u, -v]), b - a, rcond=None)[0][0] * u
        left = ((image - behind.origin) * behind.direction).sum(axis=1)
        whole = np.linalg.norm(rays.origin - point, axis=1) + path + left
        np.testing.assert_allclose(whole, whole[0], rtol=0, atol=1e-11)


def test_what_cannot_be_said_is_said():
    lens = pl.load_lens("double-gauss-100mm-f2")
    rays = pl.RayBundle([[0, 0, -400.0]], [[0, 0, 1.0]])
    thin, paraxial = (lens.with_model(model) for model in (pl.LensModel.THIN, pl.LensModel.PARAXIAL))
    focus = pl.paraxial.cardinal_points(lens).front_focus
    from_focus = pl.RayBundle([[0, 0, focus]], [[0, 0, 1.0]])
    for traced, given_rays, point, text in (
        (thin, rays, None, "defines no path of a single ray; give the point"),
        (lens, rays, (0, 0, -400), "point is for ideal lenses"),
        (thin, rays, (0, 1, -400), r"a ray misses the point \[0.0, 1.0, -400.0\] by 1 mm"),
        (paraxial, from_focus, (0, 0, focus), "is in the focal plane"),
    ):
        with pytest.raises(InvalidValueError, match=text):
            optical_path(traced, given_rays, point=point)
