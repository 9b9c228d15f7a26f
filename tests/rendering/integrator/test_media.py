"""Media of scenes and of bodies: closed forms, quadratures, furnaces and limits."""

import math
import sys
from pathlib import Path

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.errors import InvalidValueError, SceneError

sys.path.insert(0, str(Path(__file__).parent))
from pinholes import flat, pinhole, radiance, radiance_once  # noqa: E402

Medium, HenyeyGreenstein = pl.materials.Medium, pl.materials.HenyeyGreenstein
NARROW = pinhole(1e-4, 2)
WALL = pl.QuadLight.facing((0, 0, -100), (0, 0, 0), (80, 80), radiance=1.0)
# One-sided triangles would be seen from outside only.
SHELL = flat(pl.box(300.0, material=pl.Emissive(1.0, two_sided=True)))
LAMP = pl.lights.PointLight((30.0, 0.0, -100.0), intensity=1e4)
STOP = flat(pl.box(1.0, center=(0, 0, -200.5), material=pl.Lambertian(0.0)))


def whole(measured):
    mean, error = measured
    return mean.mean(), math.sqrt(np.square(error).sum()) / error.size


def test_absorption_is_that_of_beer_and_lambert():
    # Cosines within the narrow field are 1 to 1e-8; images are float32.
    seen = radiance_once(pl.Scene([], [WALL], medium=Medium(absorption=(0.01, 0.02, 0.0))), NARROW, samples=4)
    np.testing.assert_allclose(seen.mean(axis=(0, 1)), np.exp([-1.0, -2.0, 0.0]), rtol=2e-6)
    # 20 mm of glass, 1 as its index, within 100 mm of the medium; and a medium of the glass in place of absorption.
    for glass in (pl.Dielectric(1.0, absorption=0.05), pl.Dielectric(1.0, medium=Medium(0.05))):
        nested = flat(pl.box(20.0, center=(0, 0, -50), material=glass))
        seen = radiance_once(pl.Scene([nested], [WALL], medium=Medium(0.01)), NARROW, samples=4)
        assert seen.mean() == pytest.approx(math.exp(-0.8 - 1.0), rel=2e-6)


def test_surfaces_are_lit_through_the_medium():
    # A white surface under a lamp beside the camera: light goes 100 mm there and back.
    white = flat(pl.box(1.0, center=(0, 0, -100.5), material=pl.Lambertian(1.0)))
    lamp = pl.lights.PointLight((0, 0, -50.0), intensity=1.0)
    clear, dim = (radiance_once(pl.Scene([white], [lamp], medium=m), NARROW, samples=4) for m in (None, Medium(0.01)))
    assert (dim / clear).mean() == pytest.approx(math.exp(-0.5 - 1.0), rel=1e-5)


def scattered_once(g, absorption, scattering, depth=200.0):
    """What a lamp beside the line of sight sends there by one event of scattering: the midpoint rule."""
    t = (np.arange(200_000) + 0.5) * (depth / 200_000)
    along, aside = LAMP.position[2] + t, LAMP.position[0]
    distance = np.hypot(aside, along)
    # From the camera along -z, then to the lamp.
    cosine = -along / distance
    phase = (1 - g * g) / (4 * math.pi * (1 + g * g - 2 * g * cosine) ** 1.5)
    left = np.exp(-(absorption + scattering) * (t + distance))
    return float(np.sum(scattering * left * phase * 1e4 / distance**2) * (depth / 200_000))


@pytest.mark.parametrize("g", [0.0, 0.7, -0.5, 0.95, -0.95])
def test_single_scattering_is_that_of_quadrature(g):
    # The stop halves one of 512 strata of distances: nearer to an edge of one, few seeds would have most of the error.
    scattering = -math.log(1 - 282.5 / 512) / 200
    scene = pl.Scene([STOP], [LAMP], medium=Medium(0.002, scattering, HenyeyGreenstein(g)))
    mean, error = whole(radiance(scene, NARROW, samples=512, seeds=16, max_bounces=1))
    expected = scattered_once(g, 0.002, scattering)
    assert error < 1e-3 * expected
    assert abs(mean - expected) < 4.5 * error + 1e-6 * expected


def test_single_scattering_without_any_surface():
    # The line of sight ends nowhere; beyond 4 m nothing comes back.
    scene = pl.Scene([], [LAMP], medium=Medium(0.002, 0.004))
    mean, error = whole(radiance(scene, NARROW, samples=512, seeds=8, max_bounces=1))
    assert abs(mean - scattered_once(0.0, 0.002, 0.004, 4000.0)) < 4.5 * error


def test_paths_that_leave_the_scene_bring_their_share():
    # They may end far away by Russian roulette; in a black room that is larger than all of the light, none leaves.
    medium, lamp = Medium(2e-4, 0.01), pl.lights.PointLight((20.0, 0.0, -40.0), intensity=1e4)
    room = flat(pl.box(4000.0, material=pl.Lambertian(0.0)))
    seen = [
        whole(radiance(pl.Scene(meshes, [lamp], medium=medium), pinhole(0.3), samples=256, seeds=16, max_bounces=8))
        for meshes in ([], [room])
    ]
    assert max(error for _, error in seen) < 0.01 * seen[1][0]
    assert abs(seen[0][0] - seen[1][0]) < 4.5 * math.hypot(seen[0][1], seen[1][1])


def test_errors_that_are_stated_hold():
    scene = pl.Scene([STOP], [LAMP], medium=Medium(0.002, (0.004, 0.01, 0.002)))
    shots = [
        pl.render(scene, pinhole(0.01, 4), samples=1024, replicates=16, seed=seed, max_bounces=6, progress=False)
        for seed in range(24)
    ]
    spread = np.var([shot.image for shot in shots], axis=0, ddof=1, dtype=float)
    stated = np.mean([np.square(shot.standard_error) for shot in shots], axis=0)
    # 16 pixels of 24 pictures: variances err by sqrt(2 / 23 / 16) = 0.07, and more where few paths bring much.
    assert 0.85 < math.sqrt(float((spread / stated).mean())) < 1.15


@pytest.mark.parametrize("g", [0.0, 0.9, -0.5])
def test_white_media_vanish_in_a_furnace(g):
    # Scattering alone, of different strength by channel, in the room or in a body of the room.
    foggy = Medium(0.0, (0.02, 0.005, 0.05), HenyeyGreenstein(g))
    ball = flat(pl.sphere(10.0, center=(0, 0, -40.0), segments=(24, 12), material=pl.Dielectric(1.0, medium=foggy)))
    pane = flat(pl.box(10.0, center=(0, 0, -40.0), material=pl.Dielectric(1.3)))
    glass = flat(pl.box(10.0, center=(0, 0, -40.0), material=pl.Dielectric(1.3, medium=foggy)))
    for scene in (
        pl.Scene([SHELL], medium=foggy),
        pl.Scene([ball], background=1.0),
        pl.Scene([SHELL, pane], medium=foggy),
        pl.Scene([glass], background=1.0),
    ):
        mean, error = whole(radiance(scene, pinhole(), samples=32, seeds=8, max_bounces=300))
        assert error < 0.02
        assert abs(mean - 1.0) < 4.5 * error + 1e-3, scene


@pytest.mark.parametrize(
    "material", [pl.MetallicRoughness(1.0, opacity=0.0), pl.materials.ThinGlass(1.0), pl.Dielectric(1.0)]
)
def test_paths_scatter_in_front_of_transparent_panes(material):
    # The pane lies 100 mm away, two mean free paths: paths that scatter before it are most of the light.
    pane = flat(pl.box((100.0, 100.0, 1.0), center=(0, 0, -100.0), material=material))
    scene = pl.Scene([SHELL, pane], medium=Medium(0.0, 0.02))
    mean, error = whole(radiance(scene, pinhole(), samples=32, seeds=8, max_bounces=300))
    assert error < 0.02
    assert abs(mean - 1.0) < 4.5 * error + 1e-3


def test_rays_that_leave_a_body_by_rounding_see_the_sky_once():
    # A speck 10 m away rounds coordinates to some 1e-3 mm, of mean free paths of 0.05 mm.
    speck = flat(pl.box(10.0, center=(0, 0, -1e4), material=pl.Lambertian(0.0)))
    dense = pl.Dielectric(1.0, medium=Medium(0.0, 20.0))
    cube = flat(pl.box(1.0, center=(0, 0, -10.0), material=dense))
    seen = radiance_once(pl.Scene([cube, speck], background=1.0), pinhole(0.05), samples=64, max_bounces=2000)
    # All paths see the sky once, but those that have not left after 2000 bounces.
    assert seen.max() < 1.0 + 1e-6
    assert seen.mean() > 0.999


def test_light_that_would_scatter_is_lost_without_bounces():
    # An optical depth of 1; and in a body, of 0.8 with absorption.
    settings = {"samples": 4, "max_bounces": 0}
    seen = radiance_once(pl.Scene([], [WALL], medium=Medium(0.0, 0.01)), NARROW, **settings)
    assert seen.mean() == pytest.approx(math.exp(-1.0), rel=2e-6)
    around = flat(pl.box(40.0, material=pl.Dielectric(1.0, medium=Medium(0.01, 0.03))))
    # The surface of the body lets no light pass without a bounce.
    shining = pl.Emissive(1.0, two_sided=True)
    inner = flat(pl.box((4.0, 4.0, 1.0), center=(0, 0, -15.5), material=shining))
    seen = radiance_once(pl.Scene([around, inner]), NARROW, **settings)
    assert seen.mean() == pytest.approx(math.exp(-15.0 * 0.04), rel=2e-6)


@pytest.mark.parametrize("pose", [None, ((30.0, -20.0, 10.0), (130.0, 0.0, -60.0))])
def test_media_are_found_in_front_of_the_lens(pose):
    # The front of the lens is 34 mm before the iris: in the body, which does not hold the iris.
    camera = pl.load_camera("michels-2018-plenoptic-1")
    assert camera.lens.vertices[0] == pytest.approx(-33.77)
    middle, along = np.zeros(3), np.array([0.0, 0.0, -1.0])
    if pose is not None:
        camera = camera.posed(*pose)
        middle, along = np.array(pose[0]), np.subtract(pose[1], pose[0])
        along /= np.linalg.norm(along)
    x, y = np.linalg.svd(along[None])[2][1:]
    turn = np.stack([x, y * np.sign(np.cross(x, y) @ along), along], axis=1)
    water = pl.box((100.0, 100.0, 190.0), material=pl.Dielectric(1.0, medium=Medium(0.002, 0.001)))
    wall = pl.box((150.0, 150.0, 1.0), material=pl.Emissive(1.0))
    place = np.eye(4)
    place[:3, :3] = turn
    meshes = []
    for mesh, depth in ((water, 115.0), (wall, 200.5)):
        place[:3, 3] = middle + depth * along
        meshes.append(flat(mesh.transformed(place)))
    region = np.s_[camera.sensor.shape[0] // 2 :, camera.sensor.shape[1] // 2 :]
    region = tuple(slice(part.start, part.start + 4) for part in region)
    settings = {"truth": pl.Truth.TRANSMITTANCE, "region": region}
    # The wall is within the body: 200 mm from the iris, 33.77 mm of which lie behind the front vertex.
    truth = pl.ground_truth(pl.Scene(meshes), camera, **settings)
    np.testing.assert_allclose(-np.log(truth.transmittance) / 0.003, 166.23, atol=0.1)
    images = [
        pl.render(scene, camera, samples=4, max_bounces=0, region=region, progress=False).image
        for scene in (pl.Scene([meshes[1]], medium=Medium(0.002, 0.001)), pl.Scene(meshes))
    ]
    np.testing.assert_allclose(images[1], images[0], rtol=1e-6)


def test_limits_thin_and_thick():
    thin = radiance_once(pl.Scene([], [WALL], medium=Medium(1e-9, 1e-9)), NARROW, samples=64)
    assert thin.mean() == pytest.approx(1.0, abs=1e-6)
    # A kilometre away, an optical depth of 1.
    far = pl.QuadLight.facing((0, 0, -1e6), (0, 0, 0), (1e5, 1e5), radiance=1.0)
    seen = radiance_once(pl.Scene([], [far], medium=Medium(1e-6)), NARROW, samples=4)
    assert seen.mean() == pytest.approx(math.exp(-1.0), rel=1e-5)
    # Nothing passes 100 mm of this; all weights are finite.
    for thick in (Medium(1e6), Medium(0.0, 1e6), Medium(1e6, (1e6, 0.0, 1e-3))):
        assert radiance_once(pl.Scene([], [WALL], medium=thick), NARROW, samples=16)[..., 0].max() < 1e-9


def test_camera_within_a_body_of_the_medium():
    around = flat(pl.box(40.0, material=pl.Dielectric(1.0, medium=Medium(0.03))))
    seen = radiance_once(pl.Scene([around], [WALL], medium=Medium(0.01)), NARROW, samples=4)
    assert seen.mean() == pytest.approx(math.exp(-0.6 - 0.8), rel=2e-6)


def test_bits_do_not_depend_on_threads_or_tiles():
    scene, camera = pl.Scene([STOP], [LAMP], medium=Medium(0.002, (0.004, 0.01, 0.002))), pinhole(0.05, 16)
    settings = {"samples": 16, "progress": False, "seed": 3}
    one, two = (pl.render(scene, camera, threads=threads, **settings) for threads in (1, 2))
    assert np.array_equal(one.image, two.image)
    part = pl.render(scene, camera, region=np.s_[4:12, 3:9], **settings)
    assert np.array_equal(part.image, one.image[4:12, 3:9])


def test_truth_has_the_transmittance_to_the_first_hit():
    wanted = pl.Truth.TRANSMITTANCE | pl.Truth.DISTANCE
    for medium, extinction in ((Medium(0.001, (0.01, 0.002, 0.0)), [0.011, 0.003, 0.001]), (None, 0.0)):
        truth = pl.ground_truth(pl.Scene([STOP], [WALL], medium=medium), pinhole(0.2, 4), truth=wanted)
        np.testing.assert_allclose(
            truth.transmittance, np.exp(-np.multiply.outer(truth.distance, np.ones(3) * extinction))
        )


def test_wrong_media_get_a_sentence():
    with pytest.raises(SceneError, match="scattering is -1"):
        Medium(0.0, -1.0)
    for g in (1.0, -1.0, 2.0):
        with pytest.raises(SceneError, match="between -1 and 1"):
            HenyeyGreenstein(g)
    with pytest.raises(InvalidValueError, match="phase"):
        Medium(phase=0.5)
    with pytest.raises(InvalidValueError, match="medium is float"):
        pl.Scene([STOP], medium=0.1)
    with pytest.raises(SceneError, match="absorption and a medium"):
        pl.Dielectric(1.5, absorption=0.1, medium=Medium(0.1))
    for far in ({"background": 0.5}, {"lights": [pl.SunLight((0, 1, 0))]}):
        with pytest.raises(SceneError, match="without bound under the sun"):
            pl.Scene([STOP], medium=Medium(0.1), **far)
    with pytest.raises(SceneError, match="different media"):
        pl.Scene([STOP], medium=Medium(0.1)).merged(pl.Scene([STOP], medium=Medium(0.2)))
    with pytest.raises(SceneError, match="visibility"):
        pl.materials.fog(0.0)
    shot = pl.render(pl.Scene([STOP], [LAMP], medium=Medium(0.0, 0.01)), NARROW, samples=2, progress=False)
    with pytest.raises(SceneError, match="replay shows surfaces only"):
        pl.replay(shot, pl.Scene([STOP], [LAMP], medium=Medium(0.0, 0.01)), pixel=(0, 0), sample=0)
