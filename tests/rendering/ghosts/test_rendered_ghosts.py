"""Ghosts in images beside paths that reflect by chance at all surfaces of the lens, and laws of their light."""

import dataclasses
import functools
import math

import mirror_trace
import numpy as np
import pytest
from ghost_images import DISTANCE, LAMP, SINGLET, TRIPLET, bins, camera_of, ghosts_of, scene_of

import plenoptic as pl
from plenoptic.camera.ghosts.ghost_camera import ghost_lens
from plenoptic.optics.lens.placement import rotation_about_axes


def by_chance(camera, background, *, sensor=None, distance=DISTANCE, n=60_000, seed=3):
    """Light of two reflections on each pixel and its standard error."""
    lens, random, z = camera.lens, np.random.default_rng(seed), camera.z_sensor
    rows, columns = camera.sensor.shape
    image, errors = np.zeros((2, rows, columns))
    last, turned = lens.elements[-1], camera.sensor_placement
    turn = np.eye(3) if turned is None else turned.rotation
    normal = turn[:, 2]
    for row in range(rows):
        for column in range(columns):
            points = camera.sensor.centre_of(row, column) + camera.sensor.pixel_pitch * random.uniform(
                -0.5, 0.5, (n, 2)
            )
            # Points of a disc around the rear element: the area per projected solid angle is distance^2 / cos^4 ...
            radius = 1.3 * last.semi_diameter
            r, angle = radius * np.sqrt(random.random(n)), 2 * math.pi * random.random(n)
            target = np.column_stack([r * np.cos(angle), r * np.sin(angle), np.full(n, lens.vertices[-1])])
            origin = np.column_stack([points, np.zeros(n)]) @ turn.T + [0.0, 0.0, z]
            along = target - origin
            length = np.linalg.norm(along, axis=1)
            solid = math.pi * radius**2 * along[:, 2] * (along @ normal) / length**4  # projected at both ends
            p, d, light, turns = mirror_trace.chance(
                lens, origin, along / length[:, None], random, sensor=None if sensor is None else (z, sensor, normal)
            )
            d = np.where(d[:, 2:] < 0, d, np.nan)
            hit = p[:, :2] + ((-distance - p[:, 2]) / d[:, 2])[:, None] * d[:, :2]
            lit = np.abs(hit - [10.0, 0.0]).max(axis=1) <= LAMP * distance / DISTANCE
            light = np.where(turns == 2, light * solid * np.where(lit, 1.0, background), 0.0)
            image[row, column], errors[row, column] = light.mean(), light.std() / math.sqrt(n)
    return image, errors


@pytest.mark.parametrize(
    "lens, background, sensor, distance, tilt",
    # The pairs of the triplet's surfaces, and those with the sensor, bring about as much light.
    [
        (SINGLET, 0.0, None, 50.0, None),
        (TRIPLET, 0.2, 0.1, DISTANCE, None),
        (SINGLET, 1.0, 0.9, DISTANCE, (0.15, 0.0, 0.0)),
    ],
    ids=["one pair and a near lamp", "all pairs and the sensor", "tilted sensor"],
)
def test_images_of_ghosts_are_those_of_paths_that_reflect_by_chance(lens, background, sensor, distance, tilt):
    camera = camera_of(lens)
    if tilt is not None:
        camera = camera.moved(pl.CameraPart.SENSOR, tilt=tilt)
    expected, expected_error = by_chance(camera, background, sensor=sensor, distance=distance)
    images = ghosts_of(camera, scene_of(background, distance), pl.rendering.Ghosts(sensor=sensor, samples=1024))
    image, error = images.mean(axis=0), images.std(axis=0, ddof=1) / math.sqrt(len(images))
    # Student's t of 7 degrees of freedom has a variance of 1.4.
    z = (image - expected) / np.hypot(error, expected_error)
    assert np.abs(z).max() < 6.0
    assert np.mean(z * z) < 2.5
    totals = images.sum(axis=(1, 2))
    total_error = math.hypot(totals.std(ddof=1) / math.sqrt(len(totals)), np.linalg.norm(expected_error))
    assert abs(totals.mean() - expected.sum()) < 4 * total_error < 0.1 * expected.sum()


def returned(camera, p, d):
    """Rays from the lens through thin microlenses to the sensor, a mirror, and back, of unchanged weights: images count
    etendue at the sensor, where paths begin.
    """
    array, z = camera.microlenses, camera.stop_to_microlenses
    d = np.where(d[:, 2:] > 0, d, np.nan)
    at = (p + ((z - p[:, 2]) / d[:, 2])[:, None] * d)[:, :2]
    slope = d[:, :2] / d[:, 2:]
    slope = slope - (at - array.pitch * np.round(at / array.pitch)) / array.focal_lengths[0]
    at = at + 2.0 * camera.microlenses_to_sensor * slope
    slope = slope - (at - array.pitch * np.round(at / array.pitch)) / array.focal_lengths[0]
    length = np.sqrt(1.0 + np.square(slope).sum(axis=1))
    return (
        np.column_stack([at, np.full(len(at), z)]),
        np.column_stack([slope, -np.ones(len(at))]) / length[:, None],
        1.0,
    )


def array_by_chance(camera, mirror, *, batches=24, n=500_000, seed=5):
    """Light of two reflections on each pixel behind thin microlenses, with a mirror among the surfaces, and its error.

    Paths run from points of the array through points of a disc at the last element, and reflect by chance. On the other
    side, the microlens with the nearest centre of a square lattice refracts them to a pixel. A pixel is the mean of
    cos^4 at the sensor, over squared distances, times the areas of both planes, over its own.
    """
    lens, random, z = camera.lens, np.random.default_rng(seed), camera.stop_to_microlenses
    (rows, columns), pixel, array = camera.sensor.shape, camera.sensor.pixel_pitch, camera.microlenses
    half, radius = 0.5 * rows * pixel + 2.0 * array.pitch, 1.3 * lens.elements[-1].semi_diameter
    depth = z - float(lens.vertices[-1])
    sums = np.zeros((2, rows * columns))
    for _ in range(batches):
        crossing = random.uniform(-half, half, (n, 2))
        r, angle = radius * np.sqrt(random.random(n)), 2 * math.pi * random.random(n)
        slope = (crossing - np.column_stack([r * np.cos(angle), r * np.sin(angle)])) / depth
        centre = array.pitch * np.round(crossing / array.pitch)
        behind = slope - (crossing - centre) / array.focal_lengths[0]
        x, y = (crossing + camera.microlenses_to_sensor * behind).T
        column, row = np.floor(0.5 * columns - x / pixel), np.floor(0.5 * rows + y / pixel)
        lands = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        backwards = np.column_stack([-slope, -np.ones(n)])[lands]
        backwards /= np.linalg.norm(backwards, axis=1, keepdims=True)
        start = np.column_stack([crossing, np.full(n, z)])[lands]
        p, d, light, turns = mirror_trace.chance(lens, start, backwards, random, sensor=mirror)
        d = np.where(d[:, 2:] < 0, d, np.nan)
        hit = p[:, :2] + ((-DISTANCE - p[:, 2]) / d[:, 2])[:, None] * d[:, :2]
        lit = (turns == 2) & (np.abs(hit - [10.0, 0.0]).max(axis=1) <= LAMP)
        weight = np.where(lit, light / (1.0 + np.square(behind[lands]).sum(axis=1)) ** 2, 0.0)
        pixels = (row * columns + column)[lands].astype(int)
        sums += [np.bincount(pixels, w, rows * columns) for w in (weight, weight**2)]
    factor = (2 * half) ** 2 * math.pi * radius**2 / depth**2 / pixel**2
    mean, square = (part.reshape(rows, columns) / (batches * n) for part in sums)
    return factor * mean, factor * np.sqrt((square - mean**2) / (batches * n))


@pytest.mark.parametrize(
    "lens, mirror", [(SINGLET, "array"), (SINGLET, "sensor"), pytest.param(TRIPLET, "array", marks=pytest.mark.slow)]
)
def test_ghosts_behind_microlenses_are_those_of_paths_that_reflect_by_chance(lens, mirror):
    """The array or the sensor as a mirror, whose pairs are most of the light; micro images of a near lamp overlap."""
    camera = dataclasses.replace(
        camera_of(lens, side=24),
        microlenses=pl.MicrolensArray(pitch=3.0, focal_lengths=(9.0,), lattice=pl.Lattice.SQUARE),
        microlenses_to_sensor=8.0,
    )
    flat = camera.stop_to_microlenses, 1.0, np.array([0.0, 0.0, 1.0])
    by_mirror = flat if mirror == "array" else functools.partial(returned, camera)
    expected, expected_error = array_by_chance(camera, by_mirror)
    images = ghosts_of(camera, scene_of(0.0), pl.rendering.Ghosts(samples=1024, **{mirror: 1.0}))
    # Paths through many surfaces hardly ever reflect by chance as they must: single pixels of the triplet get too few.
    for side in (1, 3, 24) if lens is SINGLET else (3, 24):
        ours, theirs = bins(images, side), bins(expected, side)
        image, squares = ours.mean(axis=0), bins(np.square(expected_error), side)
        error = np.sqrt(ours.var(axis=0, ddof=1) / len(ours) + squares)
        # Pixels of more than some hundred paths that reflect by chance.
        bright = image > 0.25 * image.max()
        z = (image - theirs)[bright] / error[bright]
        # Student's t of 7 degrees of freedom has a variance of 1.4.
        assert np.abs(z).max() < (4.0 if side == 24 else 6.0)
        assert len(z) > 50 and np.mean(z * z) < 2.5 if side < 24 else error < 0.015 * theirs


WHITE = pl.Scene([], background=1.0)


def test_stated_errors_are_those_of_the_scatter_between_seeds():
    """Variances of 36 pixels, means over 12 seeds."""
    camera, ghosts = camera_of(TRIPLET), pl.rendering.Ghosts(samples=512)
    shots = [
        pl.render(WHITE, camera, ghosts=ghosts, samples=512, replicates=8, seed=seed, progress=False)
        for seed in range(12)
    ]
    stated = np.mean([np.square(shot.standard_error, dtype=float).mean() for shot in shots])
    scatter = np.var([shot.image.astype(float) for shot in shots], axis=0, ddof=1).mean()
    # 36 times 11 degrees of freedom: a relative error of root 2 / 396 = 0.07, more for the tails of few hits.
    assert stated == pytest.approx(scatter, rel=0.35)


def test_off_is_the_image_of_before_and_on_does_not_change_its_paths():
    camera, options = camera_of(TRIPLET), {"samples": 8, "progress": False}
    image = pl.render(WHITE, camera, **options)
    both = pl.render(WHITE, camera, ghosts=pl.rendering.Ghosts(), **options)
    np.testing.assert_array_equal(pl.render(WHITE, camera, ghosts=None, **options).image, image.image)
    assert (both.image >= image.image).all() and both.image.sum() > image.image.sum()
    assert both.settings.ghosts == pl.rendering.Ghosts() and image.settings.ghosts is None


def test_regions_and_tiles_have_the_same_bits():
    camera = camera_of(TRIPLET, side=16)
    options = {"samples": 16, "ghosts": pl.rendering.Ghosts(sensor=0.2, samples=32), "progress": False}
    whole = pl.render(WHITE, camera, **options)
    region = np.s_[3:9, 2:11]
    part = pl.render(WHITE, camera, region=region, threads=1, tile_side=8, **options)
    np.testing.assert_array_equal(part.image, whole.image[region])
    np.testing.assert_array_equal(part.standard_error, whole.standard_error[region])


def test_displaced_cameras_see_the_ghosts_of_a_displaced_scene():
    """Pose and displaced lens: the frame of the opening follows both, up to rounding of coordinates."""
    camera, options = camera_of(SINGLET), {"samples": 2, "ghosts": pl.rendering.Ghosts(samples=256), "progress": False}
    still = pl.render(scene_of(0.1), camera, **options)
    pose = pl.Pose.look_at((100.0, -50.0, 30.0), (160.0, 20.0, 10.0))
    (lamp,) = scene_of(0.1).meshes
    moved = pl.Mesh(pose.to_world(lamp.vertices), lamp.faces, material=pl.Emissive(1.0))
    posed = pl.render(pl.Scene([moved], background=0.1), dataclasses.replace(camera, pose=pose), **options)
    np.testing.assert_allclose(posed.image, still.image, rtol=2e-3)
    # A lens that stands 1 mm off, with the sensor as far off, is the camera 1 mm off; its rays are aimed otherwise.
    shift = (1.0, -2.0, 0.5)
    both = camera.moved(pl.CameraPart.LENS, shift=shift).moved(pl.CameraPart.SENSOR, shift=shift)
    beside = dataclasses.replace(camera, pose=pl.Pose(np.eye(3), shift))
    first, second = (ghosts_of(one, scene_of(0.1), pl.rendering.Ghosts(samples=1024)) for one in (both, beside))
    error = np.sqrt((first.var(axis=0, ddof=1) + second.var(axis=0, ddof=1)) / len(first))
    z = (first.mean(axis=0) - second.mean(axis=0)) / error
    assert np.abs(z).max() < 5.0
    assert np.mean(z * z) < 2.0


def test_cameras_that_are_turned_as_a_whole_have_the_same_ghosts():
    turn = rotation_about_axes((0.12, 0.05, 0.0))
    for camera, ghosts in (
        (camera_of(SINGLET, side=4), pl.rendering.Ghosts(sensor=0.9, samples=1024)),
        (pl.camera.example_camera(shape=(32, 32)), pl.rendering.Ghosts(sensor=0.9, array=0.9, samples=128)),
    ):
        z = {"lens": 0.0, "sensor": camera.z_sensor}
        if camera.microlenses is not None:
            z["microlenses"] = camera.stop_to_microlenses
        turned = {
            f"{part}_placement": pl.optics.Placement(turn @ [0.0, 0.0, at] - [0.0, 0.0, at], turn)
            for part, at in z.items()
        }
        scene = pl.Scene(background=1.0)
        expected, image = (
            ghosts_of(c, scene, ghosts).sum(axis=(1, 2)) for c in (camera, dataclasses.replace(camera, **turned))
        )
        error = math.hypot(*(x.std(ddof=1) / math.sqrt(len(x)) for x in (expected, image)))
        assert abs(image.mean() - expected.mean()) < 4 * error < 0.05 * expected.mean()


def test_ghosts_of_the_array_bring_the_light_that_a_sensor_in_its_place_gets():
    """Microlenses distribute the light of ghosts over pixels as they do that of the image, and lose as much of it."""
    lens = SINGLET.with_stop(pl.CircularStop(5.0))
    z, reflectance = 110.0, 0.9  # as much light as by the pair of the lens
    array = pl.MicrolensArray(pitch=0.5, focal_lengths=(4.0,), lattice=pl.Lattice.SQUARE)
    plenoptic = pl.PlenopticCamera(
        lens=lens,
        microlenses=array,
        sensor=pl.Sensor(shape=(120, 120), pixel_pitch=0.1),
        stop_to_microlenses=z,
        microlenses_to_sensor=4.0,
    )
    plain = pl.PlenopticCamera(lens=lens, sensor=pl.Sensor(shape=(12, 12), pixel_pitch=1.0), stop_to_microlenses=z)
    means = {}
    for name, camera, at, side in (("array", plenoptic, "array", 120), ("sensor", plain, "sensor", 12)):
        images = [
            pl.render(WHITE, camera, samples=2, ghosts=ghosts, progress=False).image.astype(float)
            for ghosts in (
                pl.rendering.Ghosts(samples=64 * 120 // side, **{at: reflectance}),
                pl.rendering.Ghosts(samples=64 * 120 // side, **{at: 0.5 * reflectance}),
                None,
            )
        ]
        inner = slice(side // 4, -side // 4)
        light = images[2][inner, inner].mean()
        means[name] = [(image - images[2])[inner, inner].mean() / light for image in images[:2]]
    # Micro images of ghosts reach beyond those of the image, to where the light falls off by some percent.
    assert means["array"][0] == pytest.approx(means["sensor"][0], rel=0.08)
    # Light of the array's pairs is in proportion to its reflectance, that of the others stays.
    assert means["array"][0] > 1.2 * means["array"][1]


def test_the_face_of_thick_microlenses_is_their_first_vertex():
    """Light returns from the flat side of glass in front, thickness / index before the front principal plane; curved
    sides, and all behind them, are no planes of the stacks.
    """
    model, sides, mirrors = pl.optics.MicrolensModel.SPHERICAL, pl.optics.ConvexSide, []
    for side in (sides.SENSOR, sides.SCENE):
        array = pl.MicrolensArray(0.2, (2.0,), model=model, thickness=0.4, index=1.6, convex_side=side)
        camera = dataclasses.replace(camera_of(SINGLET), microlenses=array, microlenses_to_sensor=2.0)
        mirrors.append(ghost_lens(camera, pl.rendering.Ghosts(array=0.1)).sensor)
    z, reflectance = mirrors[0]
    assert (camera.stop_to_microlenses - z, reflectance) == (pytest.approx(0.4 / 1.6, abs=1e-12), 0.1)
    assert mirrors[1] is None


def test_spectral_cameras_have_the_ghosts_of_their_wavelengths():
    """A glass without dispersion: all channels see those of one wavelength."""
    glass = pl.ConstantMedium(1.6)
    lens = pl.LensStack(
        [
            pl.CircularStop(6.0, thickness=2.0),
            pl.Surface(40.0, thickness=5.0, medium=glass, semi_diameter=10.0),
            pl.Surface(-80.0, semi_diameter=10.0),
        ]
    )
    camera = camera_of(lens)
    spectral = dataclasses.replace(camera, sensitivity=pl.sensitivities.linear_srgb())
    one, three = (
        ghosts_of(each, pl.Scene([], background=1.0), pl.rendering.Ghosts(samples=1024), seeds=2)
        for each in (camera, spectral)
    )
    assert three.mean() == pytest.approx(one.mean(), rel=0.02)


def test_media_around_the_lens_scale_the_radiance_of_ghosts_as_of_the_image():
    water = pl.ConstantMedium(1.33)
    plate = [
        pl.CircularStop(4.0, thickness=3.0),
        pl.Surface(math.inf, thickness=4.0, medium=pl.ConstantMedium(1.8), semi_diameter=30.0),
        pl.Surface(math.inf, semi_diameter=30.0),
    ]
    lens = pl.LensStack(plate, front_medium=water)
    camera = pl.PlenopticCamera(lens=lens, sensor=pl.Sensor((2, 2), pixel_pitch=1.0), stop_to_microlenses=60.0)
    ghosts = ghosts_of(camera, WHITE, pl.rendering.Ghosts(samples=1 << 14), seeds=2).mean()
    image = pl.render(WHITE, camera, samples=4096, progress=False).image.mean()
    # Through 3 t / n of glass instead of t / n the stop is seen that much farther away.
    distance = 60.0 - 7.0 + 4.0 / 1.8 + 3.0 / 1.33
    first, second = ((1.8 - 1.0) / 2.8) ** 2, ((1.8 - 1.33) / 3.13) ** 2
    farther = (distance / (distance + 8.0 / 1.8)) ** 2
    expected = first * second * (1.0 - first) * (1.0 - second) * farther
    assert ghosts / image == pytest.approx(expected, rel=0.03)


def test_ghosts_of_particles_and_surfaces_add_up():
    points = pl.Points([[0.0, 0.0, -600.0]], intensity=1e-3)
    camera, options = camera_of(SINGLET), {"samples": 2, "progress": False}
    scenes = (pl.Scene(points=points, background=1e-3), pl.Scene(points=points), pl.Scene(background=1e-3))
    both, particles, surfaces = (
        pl.render(scene, camera, ghosts=pl.rendering.Ghosts(), **options).image for scene in scenes
    )
    np.testing.assert_allclose(both, particles + surfaces, rtol=1e-5)


def test_bad_input_is_answered_by_a_sentence():
    error = pl.errors.InvalidValueError
    with pytest.raises(error, match=r"orders is 4; it must be at most 2"):
        pl.rendering.Ghosts(orders=4)
    with pytest.raises(error, match=r"sensor is 1\.2; its reflectance must be from 0 to 1"):
        pl.rendering.Ghosts(sensor=1.2)
    plenoptic, options = pl.camera.example_camera(shape=(8, 8)), {"samples": 2, "progress": False}
    pinholes = dataclasses.replace(plenoptic.microlenses, model=pl.optics.MicrolensModel.PINHOLE)
    with pytest.raises(error, match="pinholes a second time"):
        camera = dataclasses.replace(plenoptic, microlenses=pinholes)
        pl.render(WHITE, camera, ghosts=pl.rendering.Ghosts(sensor=0.2), **options)
    with pytest.raises(error, match=r"ghosts is a float; give a Ghosts, such as pl\.rendering\.Ghosts\(\)"):
        pl.point_spread(camera_of(TRIPLET), (0.0, 0.0, -DISTANCE), ghosts=0.3)
    with pytest.raises(error, match="no microlenses: leave it out"):
        pl.render(WHITE, camera_of(TRIPLET), ghosts=pl.rendering.Ghosts(array=0.2), **options)
