"""Optical paths through microlenses: 50 digits, Malus and Dupin, images of points, there and back."""

import dataclasses
import itertools
import math

import mpmath
import numpy as np
import pytest

import plenoptic as pl
from plenoptic.aberrations import microlens_path
from plenoptic.core.kernels.ray_blocks import BLOCK, RAY
from plenoptic.errors import InvalidValueError
from plenoptic.optics.microlens.microlens_record import SensorPlane, lone_lens
from plenoptic.optics.microlens.model_records import ArrayCrossing

EPS = np.finfo(float).eps
WAVE = 587.6e-6  # mm
Model, Side = pl.optics.MicrolensModel, pl.optics.ConvexSide
PLATES = [(model, side) for model in (Model.SPHERICAL, Model.FLAT_HIGH_INDEX) for side in Side]
F = (1.7, 2.0, 2.4)


def array_of(model, side=Side.SCENE, **changes):
    index = {"index": 100.0} if model.is_flat else {"medium": pl.glass("N-BK7")} if model.is_plate else {}
    return pl.MicrolensArray(0.2, F, model=model, thickness=0.13, convex_side=side, **(index | changes))


def rays_through(array, n=60, *, distance=1.0, spread=0.05, reverse=False, seed=0, wavelength=587.6):
    """Rays well within microlenses of all types; their numbers."""
    random = np.random.default_rng(seed)
    lenses = array.lenses((-1, -1), (1, 1))
    number = random.integers(0, len(lenses), n)
    aim = np.column_stack([lenses.centre[number] + random.uniform(-0.05, 0.05, (n, 2)), np.full(n, 0.065)])
    direction = np.column_stack([random.normal(0, spread, (n, 2)), np.full(n, -1.0 if reverse else 1.0)])
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    return pl.RayBundle(aim - distance * direction, direction, wavelength), number


def exact_path(array, power, axis, origin, direction, wavelength):
    """With 50 digits, forwards, through one plate; and all lengths times indices, added up."""
    mp = mpmath.mp.clone()
    mp.dps = 50
    n, t = mp.mpf(array.index_at(wavelength)), mp.mpf(array.thickness)
    radius = (mp.mpf(array.index) - 1) / mp.mpf(power)
    p = [mp.mpf(float(a)) - mp.mpf(float(b)) for a, b in zip(origin, (*axis, 0.0), strict=True)]
    d = [mp.mpf(float(a)) for a in direction]
    size = mp.sqrt(sum(a * a for a in d))
    d = [a / size for a in d]
    towards_scene = array.convex_side is Side.SCENE
    total, sizes = mp.mpf(0), mp.mpf(0)
    sides = [(towards_scene, mp.mpf(0), 1, n), (not towards_scene, t, n, 1)]
    for curved, vertex, before, behind in sides:
        r = radius if towards_scene else -radius
        distance = (vertex - p[2]) / d[2]
        normal = [mp.mpf(0), mp.mpf(0), mp.mpf(1)]
        if curved and not array.model.is_flat:
            centre = vertex + r
            along = p[0] * d[0] + p[1] * d[1] + (p[2] - centre) * d[2]
            square = p[0] ** 2 + p[1] ** 2 + (p[2] - centre) ** 2 - r**2
            root = mp.sqrt(along**2 - square)
            distance = min((-along - root, -along + root), key=lambda w: abs(p[2] + w * d[2] - vertex))
        p = [a + distance * b for a, b in zip(p, d, strict=True)]
        if curved:
            height = r - mp.sign(r) * mp.sqrt(r**2 - p[0] ** 2 - p[1] ** 2)
            normal = [-p[0] / r, -p[1] / r, 1 - height / r]
        total, sizes = total + before * distance, sizes + before * abs(distance)
        cos_i = sum(a * b for a, b in zip(normal, d, strict=True))
        mu = before / behind
        cos_t = mp.sqrt(1 - mu**2 * (1 - cos_i**2))
        new = [mu * a + (cos_t - mu * cos_i) * b for a, b in zip(d, normal, strict=True)]
        if curved and array.model.is_flat:
            total += height * (before * d[2] - behind * new[2])
        d = new
    return total, sizes


def test_paths_are_those_of_fifty_digits():
    """To 1e-6 waves, or where that is more, 4 eps of all lengths on the way."""
    wavelength, flip = 486.1, np.array([1, 1, -1])
    for (model, side), distance, reverse in itertools.product(PLATES, (0.5, 100.0, 1e6), (False, True)):
        array = array_of(model, side)
        rays, number = rays_through(array, 10, distance=distance, reverse=reverse, wavelength=wavelength)
        behind, path = microlens_path(array, rays, reverse=reverse)
        assert (behind.status == 0).all(), (model, side, distance, reverse)
        lenses, traced_array = array.lenses((-1, -1), (1, 1)), array
        if reverse:
            traced_array = dataclasses.replace(array, convex_side=Side.SENSOR if side is Side.SCENE else Side.SCENE)
        for i, k in enumerate(number):
            ray = rays.origin[i], rays.direction[i]
            if reverse:
                ray = [0, 0, array.thickness] + flip * ray[0], flip * ray[1]
            exact, sizes = exact_path(traced_array, lenses.power[k], lenses.centre[k], *ray, wavelength)
            # Where the ray is given, and how long its direction is, is good to eps of the distance.
            bound = max(1e-6 * 1e-6 * wavelength, 4 * EPS * float(sizes))
            assert abs(float(path[i] - exact)) < bound, (model, side, distance, reverse)


def test_there_and_back_is_as_long():
    for model, side in PLATES:
        array = array_of(model, side)
        rays, _ = rays_through(array)
        behind, path = microlens_path(array, rays)
        back, again = microlens_path(array, pl.RayBundle(behind.origin, -behind.direction), reverse=True)
        np.testing.assert_allclose(back.direction, -rays.direction, rtol=0, atol=30 * EPS * array.index)
        missing = np.linalg.norm(rays.origin - back.origin, axis=1)
        np.testing.assert_allclose(again + missing, path, rtol=0, atol=30 * EPS * path.max())
        end = behind.origin[:, 2] - array.thickness
        assert (end <= 1e-15).all() if side is Side.SENSOR else (end == 0).all(), (model, side)


def test_the_rays_are_those_of_the_renderer():
    """Compare with the kernels of the renderer towards the lens, for a single lens of infinite extent."""
    for model, side in PLATES:
        array = dataclasses.replace(array_of(model, side), focal_lengths=(2.0,))
        rays, _ = rays_through(array, reverse=True)
        rays = pl.RayBundle([*np.zeros(2), 1.5] + rays.origin * [0.05, 0.05, 0], rays.direction)
        behind, _ = microlens_path(array, rays, reverse=True)
        depths = model.refraction.depths(array)
        h = 1.5 - array.thickness + depths.rear  # from the sensor, where rays begin, to the rear principal plane
        aimed = rays.origin + h / abs(rays.direction[:, 2:]) * rays.direction
        block = np.zeros((8, BLOCK))
        block[0, :60], block[1, :60] = aimed[:, :2].T
        block[3:5, :60] = (aimed - rays.origin)[:, :2].T
        blocks = block.reshape(-1)
        assert blocks.size == RAY, (model, side)
        lens = lone_lens(array, 0.5, 587.6)
        model.refraction.to_lens(blocks, None, ArrayCrossing(lens, SensorPlane(h, None), depths.front), None)
        reversed_rays = blocks.reshape(8, BLOCK)[:, :60]
        passed = np.hypot(*rays.at_z(0)[:, :2].T) < 0.08
        assert passed.sum() > 15 and (behind.status[passed] == 0).all(), (model, side)
        # 1 - n^2 (1 - cos^2) of light that leaves the plate is good to some roundings of cos^2, times n^2.
        atol = EPS * (20 + 4 * array.index**2)
        np.testing.assert_allclose(reversed_rays[3:6].T[passed], behind.direction[passed], rtol=0, atol=atol)
        np.testing.assert_allclose(reversed_rays[:3].T[passed], behind.origin[passed], rtol=0, atol=20 * EPS)


def test_thin_lenses_take_a_point_to_their_images_in_step():
    for z, reverse in itertools.product((-3.0, -1.0, -1e5), (False, True)):
        array = array_of(Model.THIN)
        point = np.array([0.1, -0.05, -z if reverse else z])
        random = np.random.default_rng(2)
        lenses = array.lenses((-0.5, -0.5), (0.5, 0.5))
        number = random.integers(0, len(lenses), 80)
        axis, f = lenses.centre[number], 1 / lenses.power[number]
        away = np.column_stack([axis + random.uniform(-0.07, 0.07, (80, 2)), np.zeros(80)]) - point
        rays = pl.RayBundle(point + random.uniform(0, 0.9, (80, 1)) * away, away)
        behind, path = microlens_path(array, rays, reverse=reverse, point=point)
        assert (behind.status == 0).all(), (z, reverse)
        image_distance = -z * f / (-z - f)
        size = -image_distance / -z
        image_z = -image_distance if reverse else image_distance
        image = np.column_stack([axis + size[:, None] * (point[:2] - axis), image_z])
        to_image = ((image - behind.origin) * behind.direction).sum(axis=1)
        # The nearer a point is to a focal plane, the more digits its image takes.
        lost = 20 * EPS * (np.abs(image_distance) + abs(z))
        miss_distance = np.linalg.norm(image - behind.origin - to_image[:, None] * behind.direction, axis=1)
        assert (miss_distance < 20 * lost).all(), (z, reverse)
        whole = np.linalg.norm(rays.origin - point, axis=1) + path + to_image
        straight = np.hypot(np.hypot(*(point[:2] - axis).T), z) * (1 - size)  # through the middle of the lens
        assert (np.abs(whole - straight) < np.maximum(lost, 1e-6 * WAVE)).all(), (z, reverse)


def test_light_beside_openings_goes_straight_on():
    clear = pl.optics.MicrolensAperture(pl.optics.ApertureShape.CIRCLE, 0.2, pl.optics.Gaps.CLEAR)
    array = pl.MicrolensArray(0.2, (2.0,), lattice=pl.Lattice.SQUARE, aperture=clear)
    point = np.array([0.0, 0.0, -5.0])
    away = np.array([[0.08, 0.0, 5.0], [0.02, 0.0, 5.0]])
    behind, path = microlens_path(array, pl.RayBundle([point, point], away), point=point)
    assert path[0] == pytest.approx(math.hypot(5.0, 0.08), rel=4 * EPS) and path[1] != path[0]
    np.testing.assert_allclose(behind.direction[0], away[0] / path[0], rtol=0, atol=4 * EPS)
    opaque = dataclasses.replace(array, aperture=dataclasses.replace(clear, gaps=pl.optics.Gaps.OPAQUE))
    behind, path = microlens_path(opaque, pl.RayBundle([point, point], away), point=point)
    assert behind.status.tolist() == [pl.RayStatus.OUTSIDE_MICROLENS, 0] and np.isnan(path).tolist() == [True, False]


def test_lenses_that_differ_have_paths_of_their_own():
    """A dark lens, one off its place, one of another power, in a list."""
    for model in [Model.SPHERICAL, Model.THIN]:
        centres = [(0.0, 0.0), (0.2, 0.0), (0.0, 0.2)]
        deviations = pl.optics.MicrolensDeviations(
            index=[(0, 0), (1, 0), (2, 0)], shift=[(0, 0), (0.01, 0), (0, 0)], transmission=[0.0, 1.0, 1.0]
        )
        free = {"lattice": pl.Lattice.FREE, "centres": centres, "types": [0, 0, 1]}
        array = pl.MicrolensArray(0.2, (2.0, 1.5), model=model, imperfections=deviations, **free)
        point = np.array([0.02, 0.03, -4.0])
        aims = np.array([(x + 0.03, y + 0.02, 0.0) for x, y in centres])
        rays = pl.RayBundle(np.tile(point, (3, 1)), aims - point)
        options = {} if model.is_plate else {"point": point}
        behind, path = microlens_path(array, rays, **options)
        assert behind.weight.tolist() == [0.0, 1.0, 1.0], model
        for k, (axis, f) in enumerate(zip([(0, 0), (0.21, 0), (0, 0.2)], (2.0, 2.0, 1.5), strict=True)):
            lone = pl.MicrolensArray(0.5, (f,), lattice=pl.Lattice.SQUARE, model=model)
            moved = point - [*axis, 0]
            ray = pl.RayBundle([moved], [aims[k] - point])
            _, lone_path = microlens_path(lone, ray, **({} if model.is_plate else {"point": moved}))
            assert path[k] == pytest.approx(lone_path[0], abs=50 * EPS), model


def test_origins_behind_the_array_have_negative_paths_and_turned_rays_none():
    array = array_of(Model.SPHERICAL)
    z = np.array([-1.0, 0.0, 2.0])
    rays = pl.RayBundle(np.column_stack([np.zeros((3, 2)), z]), np.tile([0, 0, 1.0], (3, 1)))
    _, path = microlens_path(array, rays)
    np.testing.assert_allclose(path[0] - path, z - z[0], atol=4 * EPS)
    assert path[2] < 0
    behind, path = microlens_path(array, rays, reverse=True)
    assert (behind.status == pl.RayStatus.MISSED).all() and np.isnan(path).all()


def test_what_cannot_be_said_is_said():
    rays = pl.RayBundle([[0, 0, -4.0]], [[0, 0, 1.0]])
    for model, point, message in (
        (Model.THIN, None, "defines no path of a single ray; give the point"),
        (Model.SPHERICAL, (0, 0, -4), "point is for ideal microlenses"),
        (Model.PINHOLE, None, "a PINHOLE passes one ray of a point"),
        (Model.THIN, (0, 0.05, -4), r"a ray misses the point \[0.0, 0.05, -4.0\] by 0.05 mm"),
    ):
        with pytest.raises(InvalidValueError, match=message):
            microlens_path(array_of(model), rays, point=point)
    with pytest.raises(InvalidValueError, match="the point is in a focal plane"):
        array = pl.MicrolensArray(0.2, (2.0,))
        microlens_path(array, pl.RayBundle([[0, 0, -2.0]], [[0, 0, 1.0]]), point=(0, 0, -2))
