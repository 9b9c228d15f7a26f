"""Weights of particles: against point spreads, small spheres and projections; their sums, bits and files."""

import dataclasses
import math

import numpy as np
import pytest
from camera_helpers import GAUSS, bare_camera, camera_with, refused, the_lens

import plenoptic as pl
from plenoptic.rendering.points.particle_scene import particle_scene
from plenoptic.rendering.points.particle_tracing import RayNumber, trace_particles

THIN = pl.LensModel.THIN
TILTED = (pl.CameraPart.MICROLENSES, (0.03, -0.02, 0.0), (0.02, -0.01, 0.1))
GRAINS = np.array([(0.1 * k, 0.07 * k) for k in (-10, -2, 3, 9)])
DUST = pl.Blemishes(pl.BlemishSite.SENSOR, GRAINS, GRAINS, radius=0.5, transmission=0.2, height=0.5)
CAMERAS = {
    "2.0": pl.camera.example_camera(),
    "1.0": pl.camera.example_camera(pl.CameraKind.PLENOPTIC_1),
    "thin": camera_with(lens=the_lens(model=THIN)),
    "no microlenses": bare_camera(),
    "tilted": camera_with(moved=(TILTED,)),
    "openings and dust": camera_with(
        pixels={"pixel_aperture": (0.7, 0.4), "angular_response": pl.sensor.AngularResponse(well_depth=0.8, index=1.5)},
        blemishes=(DUST,),
    ),
    "diffraction": dataclasses.replace(
        camera_with(lattice=pl.Lattice.SQUARE), diffraction=pl.Diffraction(iris=True), wavelength=600.0
    ),
}
RNG = np.random.default_rng(5)
POSITIONS = RNG.uniform((-7, -7, -420), (7, 7, -390), (8, 3))


def weights_of(positions, camera, intensity=1.0, **options):
    more = {name: options.pop(name) for name in ("diameter",) if name in options}
    return pl.rendering.point_weights(
        pl.Points(positions, intensity=intensity, **more), camera, progress=False, **options
    )


@pytest.fixture(scope="module")
def few():
    """Weights by few rays."""
    return weights_of(POSITIONS, CAMERAS["2.0"], rays=256)


@pytest.mark.parametrize("name", CAMERAS)
def test_weights_are_point_spreads_over_the_cosine(name):
    camera = CAMERAS[name]
    weights = weights_of(POSITIONS, camera, rays=1 << 13)
    spread = pl.point_spread(camera, POSITIONS, rays=1 << 13, progress=False)
    # Point spreads are of emitters that face the axis. The cosine varies by 1e-4 over the pupil, 25 mm wide.
    cosine = -POSITIONS[:, 2] / np.linalg.norm(POSITIONS, axis=1)
    joint = np.hypot(weights.light_error, spread.light_error)
    deviation = (weights.light * cosine - spread.light) / (joint + 1e-4 * weights.light)
    assert np.abs(deviation).max() < 4.0 and math.sqrt(np.mean(deviation**2)) < 1.8, deviation
    # Blocks of pixels, whose errors are nearly normal: z = deviation over joint error, mean square 1.
    image, error = weights.image()
    other, other_error = np.zeros((2, *camera.sensor.shape))
    for k, region in enumerate(spread.regions):
        other[region] += spread.image[k] / cosine[k]
        other_error[region] += (spread.standard_error[k] / cosine[k]) ** 2

    def blocks(values):
        return values.reshape(32, 16, 32, 16).sum(axis=(1, 3))

    variance = blocks(error[..., 0] ** 2) + blocks(other_error)
    lit = blocks(other) > 0.02 * blocks(other).max()
    z = (blocks(image[..., 0]) - blocks(other))[lit] / np.sqrt(variance[lit])
    # Pixels of one particle share its rays: their errors are correlated, so that 1 is no more than a scale.
    assert lit.sum() > 10 and math.sqrt(np.mean(z**2)) < 2.0, math.sqrt(np.mean(z**2))


def test_sums_over_pixels_are_the_light_and_the_image_is_linear():
    weights = weights_of(POSITIONS, CAMERAS["2.0"], intensity=RNG.uniform(1, 2, 8), diameter=0.05)
    sums = np.add.reduceat(weights.weight[:, 0].astype(float), weights.indptr[:-1])
    assert np.abs(sums / weights.light - 1).max() < 1e-6
    matrix = weights.matrix()
    product = (matrix.T.astype(float) @ weights.intensity[:, 0]).reshape(512, 512) / 0.01**2
    image, error = weights.image()
    assert np.abs(product - image[..., 0]).max() < 1e-12 * image.max()
    twice, twice_error = weights.image(2 * weights.intensity[:, 0])
    assert (twice == 2 * image).all() and (twice_error == 2 * error).all()
    coloured = weights.image(np.outer(weights.intensity[:, 0], [1.0, 0.5, 0.0]))[0]
    assert coloured.shape == (512, 512, 3) and np.abs(coloured[..., 1] - 0.5 * image[..., 0]).max() < 1e-12
    assert not coloured[..., 2].any()


@pytest.mark.parametrize("name", ["2.0", "no microlenses"])
def test_diffraction_spreads_light_as_in_point_spreads(name):
    """The sum of squares of an image falls as light leaves its pixel, at microlenses or, without them, at the iris."""
    sharp = CAMERAS[name] if name == "2.0" else bare_camera(the_lens(2.5), 134.0, pitch=0.005)
    camera = dataclasses.replace(sharp, diffraction=pl.Diffraction(iris=name != "2.0"))
    point = [(0.1, 0.2, -404.0)]
    image, _ = weights_of(point, camera, rays=1 << 17).image()
    spread = pl.point_spread(camera, point, rays=1 << 17, progress=False)
    without, _ = weights_of(point, sharp, rays=1 << 17).image()
    assert abs((image**2).sum() / (spread.image**2).sum() - 1) < 0.02  # noise below 1 %
    assert (image**2).sum() < 0.9 * (without**2).sum()


def test_rays_are_chosen_by_the_error_and_stated_errors_hold():
    camera = CAMERAS["2.0"]
    coarse = weights_of(POSITIONS, camera, target_error=0.01)
    fine = weights_of(POSITIONS, camera, rays=1 << 17, seed=1)
    relative = math.sqrt((coarse.light_error**2).sum() / (coarse.light**2).sum())
    assert relative < 0.02  # estimated from the same eight particles, chosen to be below 0.01
    seeds = [weights_of(POSITIONS, camera, rays=512, seed=seed) for seed in range(24)]
    z = np.array([(w.light - fine.light) / w.light_error for w in seeds])
    # Student's t with 7 degrees of freedom has the variance 7/5; 192 values.
    assert 0.8 < math.sqrt(np.mean(z**2)) / math.sqrt(1.4) < 1.25
    # The errors of pixels: the mean square deviation of images is the stated variance.
    images = np.array([w.image()[0] for w in seeds])
    stated = np.mean([w.image()[1] ** 2 for w in seeds], axis=0)
    assert abs(images.var(axis=0, ddof=1).sum() / stated.sum() - 1) < 0.1


def test_pixels_are_those_of_the_projection():
    camera, point = CAMERAS["2.0"], POSITIONS[:1]
    weights = weights_of(point, camera, rays=1 << 16)
    seen = pl.project(camera, point, rays=1 << 16, progress=False)
    rows, columns = np.divmod(weights.pixel, 512)
    lit = seen.selected(seen.light > 0.02 * seen.light.max())
    offset = np.stack([rows, columns], axis=1)[:, None] - lit.centroid_pixel
    # Micro images are 18 pixels apart and narrower than a pixel: each pixel belongs to one.
    nearest = np.argmin((offset**2).sum(axis=-1), axis=1)
    near = np.abs(offset[np.arange(len(rows)), nearest]).max(axis=1) < 1.0
    assert weights.weight[near, 0].sum() > 0.98 * weights.light[0] and len(lit) > 30
    for k in range(len(lit)):
        own = near & (nearest == k)
        light = weights.weight[own, 0].astype(float)
        error = math.hypot(5 * lit.light_error[k], 5 * np.linalg.norm(weights.weight_error[own].astype(float)))
        assert abs(light.sum() - lit.light[k]) < error + 1e-3 * lit.light[k]


@pytest.mark.parametrize("name", ["no microlenses", "thin"])
def test_a_small_sphere_is_rendered_alike(name):
    lens = the_lens(model=THIN)
    bare = bare_camera(shape=(256, 256), pitch=0.3)
    camera = {"no microlenses": bare, "thin": bare_camera(lens, 129.0, (256, 256), 0.3)}
    camera, centre, radius = camera[name], np.array([80.0, 35.0, -404.0]), 3.0
    ball = pl.sphere(radius, material=pl.Emissive(3.0)).translated(*centre)
    weights = weights_of([centre], camera, intensity=3.0 * math.pi * radius**2, diameter=2 * radius, rays=1 << 17)
    image, _ = weights.image()
    middle = np.round(weights.centroid[0]).astype(int)
    region = tuple(slice(k - 16, k + 16) for k in middle)
    shot = pl.render(pl.Scene([ball]), camera, samples=1024, region=region, progress=False)
    light, rendered = image[region].sum(), shot.image.sum(dtype=float)
    errors = weights.light_error[0] / weights.light[0] + np.linalg.norm(shot.standard_error.astype(float)) / rendered
    # 1e-3: the mesh's silhouette is inside the sphere; the solid angle of a ball differs by (r / d)^2 from a point's.
    assert abs(rendered / light - 1) < 4 * errors + 1e-3 and image[region].sum() > 0.999 * image.sum()
    assert np.abs(shot.image - image[region]).max() < 0.03 * image.max() and (image > 0.2 * image.max()).sum() > 5


def test_bits_do_not_depend_on_threads_or_on_other_particles():
    camera = CAMERAS["diffraction"]
    positions = RNG.uniform((-7, -7, -420), (7, 7, -390), (300, 3))
    one, two = (weights_of(positions, camera, rays=4096, threads=threads) for threads in (1, 3))
    assert one == two
    alone = weights_of(positions[:1], camera, rays=4096)
    end = alone.indptr[1]
    assert (alone.pixel == one.pixel[:end]).all() and (alone.weight == one.weight[:end]).all()
    assert weights_of(positions[:1], camera, rays=4096, seed=1) != alone


def test_channels_of_a_spectral_camera_are_those_of_its_wavelengths():
    lines = pl.sensor.Sensitivity.lines((650.0, 550.0, 450.0))
    camera = dataclasses.replace(CAMERAS["no microlenses"], sensitivity=lines)
    point, colour = [[3.0, 2.0, -404.0]], np.array([[3.0, 2.0, 1.0]])
    weights = weights_of(point, camera, intensity=colour, rays=3 << 14)
    image, _ = weights.image()
    for k, wavelength in enumerate((650.0, 550.0, 450.0)):
        alone = dataclasses.replace(camera, sensitivity=None, wavelength=wavelength)
        expected, error = weights_of(point, alone, intensity=colour[:, k], rays=1 << 14).image()
        assert abs(image[..., k].sum() / expected.sum() - 1) < 4e-3  # the light has an error of 1e-3
        assert np.abs(image[..., k] - expected[..., 0]).max() < 8 * error.max() * math.sqrt(2)
    # A constant spectrum measures as 1 in every channel, whatever the response.
    responses = dataclasses.replace(camera, sensitivity=pl.sensitivities.colour_camera())
    grey = weights_of(point, responses, rays=1 << 15)
    sums = grey.weight.sum(axis=0, dtype=float)
    assert grey.weight.shape[1] == 3 and np.abs(sums / sums.mean() - 1).max() < 0.02  # colours of the glass and pupil


def test_pairs_of_a_vortex_ring_give_their_displacement_back():
    camera = dataclasses.replace(bare_camera(z=136.5), sensor=pl.Sensor((512, 512), 0.010))  # out of focus
    angle, tube = RNG.uniform(0, 2 * math.pi, (2, 60))
    ring, radius = 1.5, RNG.uniform(0.2, 0.5, 60)
    across = ring + radius * np.cos(tube)
    positions = np.column_stack([across * np.cos(angle), across * np.sin(angle), -404 + radius * np.sin(tube)])
    # Around the core of the ring, and along its axis: speeds in mm/s.
    spin = 2.0 / radius
    velocity = np.column_stack(
        [-np.sin(tube) * spin * np.cos(angle), -np.sin(tube) * spin * np.sin(angle), 3.0 + np.cos(tube) * spin]
    )
    points, dt = pl.Points(positions, intensity=1.0), 0.004
    first = pl.rendering.point_weights(points, camera, rays=1 << 15, progress=False)
    second = pl.rendering.point_weights(points.moved(velocity, dt), camera, rays=1 << 15, progress=False)
    seen = [pl.project(camera, p, progress=False, rays=1 << 17) for p in (positions, positions + dt * velocity)]
    expected = seen[1].centroid_pixel - seen[0].centroid_pixel
    displacement = first.displacement(second)
    assert np.abs(displacement - expected).max() < 0.01 and np.abs(expected).max() > 0.1

    # By weights alone: centroids over pixels, wider than a pixel.
    def centroid(weights):
        matrix = weights.matrix().astype(float)
        places = np.stack(np.divmod(np.arange(512 * 512), 512), axis=1)
        return (matrix @ places) / weights.light[:, None]

    assert np.abs(centroid(second) - centroid(first) - expected).max() < 0.01
    # And by the map of pixels: those of a single particle have its displacement.
    alone = first.pixel_means(displacement)
    count = np.bincount(first.pixel, minlength=512 * 512).reshape(512, 512)
    assert np.isnan(alone[count == 0]).all()
    owner = np.repeat(np.arange(60), np.diff(first.indptr))
    single = count.ravel()[first.pixel] == 1
    assert np.abs(alone.reshape(-1, 2)[first.pixel[single]] - displacement[owner[single]]).max() < 1e-9


@pytest.mark.parametrize("suffix", [".npz", ".h5"])
def test_files_give_the_same_weights(few, tmp_path, suffix):
    if suffix == ".h5":
        pytest.importorskip("h5py")
    few.save(tmp_path / f"w{suffix}")
    assert pl.rendering.PointWeights.load(tmp_path / f"w{suffix}") == few
    with pytest.raises(pl.errors.FileError, match="suffix"):
        few.save(tmp_path / "w.txt")
    (tmp_path / f"bad{suffix}").write_bytes(b"nothing")
    with pytest.raises(pl.errors.FileError):
        pl.rendering.PointWeights.load(tmp_path / f"bad{suffix}")


def damaged(weights, **arrays):
    fields = {field.name: getattr(weights, field.name) for field in dataclasses.fields(weights)}
    return pl.rendering.PointWeights(**fields | arrays)


@pytest.mark.parametrize(
    ("name", "damage", "message"),
    [
        ("pixel", lambda a: np.where(a == a[0], 1 << 18, a), "pixel must be from 0 to 262143"),
        ("pixel", lambda a: np.where(a == a[0], -1, a), "pixel must be from 0 to 262143"),
        ("pixel", lambda a: a.astype(float), "pixel holds float64; it must hold whole numbers"),
        ("pixel", lambda a: a[:-1], "weight has shape|indptr"),
        ("indptr", lambda a: a + 1, "indptr must ascend from 0"),
        ("indptr", lambda a: a[[0, 2, 1, *range(3, len(a))]], "indptr must ascend from 0"),
        ("indptr", lambda a: a[:-1], "indptr has shape"),
        ("weight", lambda a: a[:, 0], "weight has shape"),
        ("weight", lambda a: np.repeat(a, 2, axis=1), "weight has shape"),
        ("weight", lambda a: a * np.float32(np.nan), "weight holds a number that is not finite"),
        ("weight_error", lambda a: a[:5], "weight_error has shape"),
        ("weight_error", lambda a: -a, "negative error"),
        ("light", lambda a: a[:-1], "has shape"),
        ("intensity", lambda a: a[:-1], "intensity has shape"),
        ("centroid", lambda a: a[:-1], "centroid has shape"),
        ("shape", lambda a: np.array([46341, 46342]), "rows x columns is 46341 x 46342; it must be at most"),
        ("shape", lambda a: np.array([0, 512]), "rows"),
        ("shape", lambda a: np.array([512, 512, 1]), "shape has shape"),
        ("pitch", lambda a: 0.0, "pitch"),
        ("rays", lambda a: 0, "rays"),
        ("seed", lambda a: -1, "seed"),
    ],
)
def test_damaged_weights_are_refused(few, tmp_path, name, damage, message):
    """When they are made, and from files, before a kernel reads beyond the end of an array."""
    wrong = damage(getattr(few, name))
    with refused(message):
        damaged(few, **{name: wrong})
    arrays = {field.name: getattr(few, field.name) for field in dataclasses.fields(few)}
    np.savez(tmp_path / "w.npz", **arrays | {name: wrong})
    with pytest.raises(pl.errors.FileError, match=message):
        pl.rendering.PointWeights.load(tmp_path / "w.npz")
    with pytest.raises(pl.errors.FileError, match=f"it has no .*{name}"):
        np.savez(tmp_path / "w.npz", **{other: array for other, array in arrays.items() if other != name})
        pl.rendering.PointWeights.load(tmp_path / "w.npz")


def test_pairs_of_other_rays_are_refused(few):
    camera, points = CAMERAS["2.0"], pl.Points(POSITIONS, intensity=1.0)
    for options in ({"rays": 512}, {"rays": 256, "seed": 1}):
        with refused("trace both with the same rays= and seed="):
            few.displacement(pl.rendering.point_weights(points, camera, progress=False, **options))


@pytest.mark.parametrize("distance", [1e10, 1e13])
def test_errors_of_faint_particles_hold(distance):
    """Particles twice as far have a quarter of the light, and of the error, whose square float32 does not hold."""
    focus = bare_camera(z=float(pl.paraxial.cardinal_points(the_lens(), 587.6).rear_focus))
    one, two = (weights_of([(0, 0, -d)], focus, rays=256) for d in (distance, 2 * distance))
    assert one.weight_error.any() and one.light_error[0] > 0
    assert np.isclose(one.light[0] / two.light[0], 4.0, rtol=1e-3)
    errors = [np.linalg.norm(weights.weight_error.astype(float)) for weights in (one, two)]
    assert np.isclose(errors[0] / errors[1], 4.0, rtol=0.3)
    # Ten times the light of stars: the image's errors, too.
    image, error = one.image([1.0])
    assert error.max() > 1e-3 * image.max() > 0


def test_memory_of_a_task_is_bounded():
    points = pl.Points(RNG.uniform((-7, -7, -420), (7, 7, -390), (40, 3)), intensity=1.0)
    parts = list(trace_particles(particle_scene(points, CAMERAS["2.0"], None, 0), RayNumber(1 << 16), 1))
    assert [len(part.number) for part in parts] == [8] * 5  # 2^19 rays
    assert [k for part in parts for k in part.number] == list(range(40))


def test_bad_particles_are_refused():
    camera = CAMERAS["2.0"]
    with refused("point 1 lies at z = 50 mm of the lens's axes"):
        weights_of([(0, 0, -404), (0, 0, 50)], camera)
    glass = pl.Scene([pl.box(8, material=pl.Dielectric(1.5)).translated(z=-404)])
    with pytest.raises(pl.errors.SceneError, match="particle 1 at .* lies inside a body of glass"):
        weights_of([(0, 0, -390), (1, 2, -404)], camera, scene=glass)
    assert weights_of([(0, 0, -390)], camera, scene=glass).light[0] > 0
    pinholes = camera_with(model=pl.optics.MicrolensModel.PINHOLE)
    with refused("PINHOLE"):
        weights_of([(0, 0, -404)], pinholes)
    with refused("target_error"):
        weights_of([(0, 0, -404)], camera, target_error=0.0)
    # Outside the field: no light, no centroid.
    beside = weights_of([(4000.0, 0, -404)], camera)
    assert beside.light[0] == 0 and np.isnan(beside.centroid).all() and len(beside.pixel) == 0


def light_of_disc(lens, centre, diameter, reach):
    """Light and standard error of a disc that faces each ray, by rays to a square wider than the lens, of half side
    `reach`, at its first vertex.
    """
    n, z, rng = 1 << 19, float(lens.vertices[0]) - 1e-6, np.random.default_rng(2)
    aims = np.column_stack([rng.uniform(-reach, reach, (n, 2)), np.full(n, z)])
    direction = aims - centre
    distance = np.linalg.norm(direction, axis=1)
    direction /= distance[:, None]
    across = np.cross(direction, (0.0, 1.0, 0.0))
    across /= np.linalg.norm(across, axis=1)[:, None]
    radius, angle = 0.5 * diameter * np.sqrt(rng.random(n)), rng.uniform(0, 2 * math.pi, n)
    offset = np.cos(angle)[:, None] * across + np.sin(angle)[:, None] * np.cross(direction, across)
    start = centre + radius[:, None] * offset
    passed = lens.trace(pl.RayBundle(start, aims - start)).status == 0
    weight = np.where(passed, (z - centre[2]) / distance**3, 0.0) * (2 * reach) ** 2
    return weight.mean(), weight.std() / math.sqrt(n)


@pytest.mark.parametrize(
    ("centre", "diameter", "stop"),
    [
        ((0.0, 0.0, -404.0), 20.0, 5.0),
        ((0.0, 0.0, -150.0), 40.0, 20.0),
        ((20.0, 15.0, -150.0), 1.0, 2.0),
        ((100.0, 30.0, -404.0), 60.0, 10.0),
        ((190.0, 0.0, -404.0), 30.0, 25.0),  # at the rim of the field, cut by vignetting
    ],
)
def test_discs_keep_their_light(centre, diameter, stop):
    """Points of a disc see the pupil elsewhere: up to 49 % of the light was lost in the polygon of the centre."""
    lens = GAUSS.with_stop(pl.CircularStop(stop))
    camera = bare_camera(lens, shape=(256, 256), pitch=2.0)
    light, error = light_of_disc(lens, np.array(centre), diameter, 40.0)
    weights = weights_of([centre], camera, diameter=diameter, rays=1 << 18)
    joint = math.hypot(error, weights.light_error[0])
    assert abs(weights.light[0] - light) < 2 * joint + 1e-3 * light, (weights.light[0] / light - 1, joint / light)
