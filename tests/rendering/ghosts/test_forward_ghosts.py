"""Ghosts of points and particles, traced forwards: beside the table of a lens and images that are traced backwards."""

import dataclasses
import math

import numpy as np
import pytest
from ghost_images import DISTANCE, LAMP, SINGLET, TRIPLET, bins, camera_of, ghosts_of, scene_of

import plenoptic as pl

POINT = (0.0, 40.0, -DISTANCE)


def spread_of_ghosts(camera, points, ghosts, **options):
    """Images on the whole sensor in sr / mm^2, of ghosts alone: those with them less those without."""
    image, both = (pl.point_spread(camera, points, ghosts=g, progress=False, **options) for g in (None, ghosts))
    return both.whole() - image.whole()


@pytest.mark.parametrize("sensor", [None, 0.3])
def test_light_of_all_ghosts_of_a_point_is_that_of_the_table(sensor):
    lens = pl.optics.coated(TRIPLET, pl.optics.Coating())  # the image loses light as that of the table
    z_image = pl.paraxial.cardinal_points(lens).rear_focus
    camera = pl.PlenopticCamera(lens=lens, sensor=pl.Sensor((9, 9), pixel_pitch=100.0), stop_to_microlenses=z_image)
    table = lens.ghosts(field=POINT[:2], z_object=POINT[2], z_image=z_image, sensor=sensor, rays=1 << 14)
    image = pl.point_spread(camera, POINT, progress=False)
    z = []
    for seed in range(6):
        both = pl.point_spread(camera, POINT, ghosts=pl.rendering.Ghosts(sensor=sensor), seed=seed, progress=False)
        z.append((both.light / image.light - 1.0 - table.total) / math.hypot(both.light_error / image.light, 1e-4))
        assert both.light_error < 0.01 * (both.light - image.light)
        assert both.fates == image.fates
    assert table.total_error < 1.5e-4
    assert np.abs(z).max() < 4.0


@pytest.mark.parametrize(
    "lens, mirrors, array",
    [
        (TRIPLET, {"sensor": 0.3}, False),
        pytest.param(SINGLET, {"array": 1.0}, True, marks=pytest.mark.slow),
        (SINGLET, {"sensor": 1.0}, True),
    ],
    ids=["sensor", "array", "sensor behind an array"],
)
def test_points_of_a_lamp_have_the_ghosts_of_its_image(lens, mirrors, array):
    camera, ghosts = camera_of(lens, side=12 if array else 6), pl.rendering.Ghosts(**mirrors, samples=1024)
    if array:
        camera = dataclasses.replace(
            camera,
            microlenses=pl.MicrolensArray(pitch=3.0, focal_lengths=(9.0,), lattice=pl.Lattice.SQUARE),
            microlenses_to_sensor=8.0,
        )
    block = 3 if array else 1  # the micro images of points are small
    backwards = bins(ghosts_of(camera, scene_of(0.0), ghosts), block)
    # Points are drawn one in each cell of a grid on the lamp, whose centre is at x = 10 mm.
    side, random = 24 if array else 10, np.random.default_rng(1)
    cells = np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1).reshape(-1, 2)
    points = LAMP * (2.0 * (cells + random.random(cells.shape)) / side - 1.0) + (10.0, 0.0)
    world = np.column_stack([points, np.full(len(points), -DISTANCE)])
    forwards = (2.0 * LAMP) ** 2 * spread_of_ghosts(
        camera, world, ghosts, rays=(1 << 20) // len(world) // 4, replicates=2
    )
    forwards = bins(forwards, block)
    variance = backwards.var(axis=0, ddof=1) / len(backwards) + forwards.var(axis=0, ddof=1) / len(forwards)
    z = (backwards.mean(axis=0) - forwards.mean(axis=0)) / np.sqrt(variance)
    assert np.abs(z).max() < 5.0
    assert np.mean(z * z) < 2.0
    # Points in cells of a grid give the sum far better than independent ones, by which the errors are stated.
    light = forwards.mean(axis=0).sum()
    assert backwards.mean(axis=0).sum() == pytest.approx(light, rel=0.08)


def test_a_particle_has_the_ghosts_of_a_point():
    """Emitters that face the camera and particles differ by the cosine at the point, at most (10 / 600)^2 / 2."""
    camera, ghosts = camera_of(TRIPLET), pl.rendering.Ghosts(sensor=0.3)
    place = (3.0, -4.0, -600.0)
    scene = pl.Scene(points=pl.Points([place] * 64, intensity=2.0 / 64))
    image, both = (pl.render(scene, camera, samples=2, ghosts=g, progress=False) for g in (None, ghosts))
    difference = (both.image.astype(float) - image.image)[..., 0]
    error = np.sqrt(np.square(both.standard_error, dtype=float) - np.square(image.standard_error, dtype=float))[..., 0]
    expected = 2.0 * spread_of_ghosts(camera, place, ghosts)
    # Errors of 8 scramblings: Student's t of 7 degrees of freedom. Pixels of the image round those of ghosts.
    lit = (image.image[..., 0] == 0.0) & (expected > 0.02 * expected.max())
    assert lit.sum() > 20
    assert np.abs((difference - expected)[lit] / error[lit]).max() < 6.0
    assert abs(difference.sum() - expected.sum()) < 4.0 * np.linalg.norm(error) + 1e-3 * expected.sum()
    assert np.linalg.norm(error) < 0.2 * expected.sum()


def test_cameras_with_colours_have_particles_of_the_same_ghosts():
    camera = dataclasses.replace(camera_of(SINGLET), sensitivity=pl.sensitivities.linear_srgb())
    scene = pl.Scene(points=pl.Points([(3.0, -4.0, -600.0)], intensity=1.0), background=0.0)
    image, both = (
        pl.render(scene, camera, samples=2, ghosts=g, target_error=None, progress=False)
        for g in (None, pl.rendering.Ghosts(sensor=0.3))
    )
    ghosts = (both.image.astype(float) - image.image).sum(axis=(0, 1))
    alone = pl.render(scene, camera_of(SINGLET), samples=2, ghosts=pl.rendering.Ghosts(sensor=0.3), progress=False)
    plain = pl.render(scene, camera_of(SINGLET), samples=2, progress=False)
    expected = (alone.image.astype(float) - plain.image).sum()
    # Reflectances of glass change by a few percent over the colours.
    np.testing.assert_allclose(ghosts, expected, rtol=0.25)


def test_a_point_beside_the_field_has_ghosts_alone_or_none():
    """Light of a point that passes no lens by refraction alone may pass it by two reflections, or nothing does."""
    camera = camera_of(TRIPLET)
    points = [(2000.0, 0.0, -50.0), (0.0, 0.0, -DISTANCE)]
    spread = pl.point_spread(camera, points, ghosts=pl.rendering.Ghosts(), rays=1 << 12, progress=False)
    image = pl.point_spread(camera, points, rays=1 << 12, progress=False)
    assert spread.light[1] > image.light[1]
    assert image.light[0] == 0.0 <= spread.light[0] < 1e-3 * spread.light[1]
