"""Paths traced again: what they bring is what the image got, and what they meet hangs together."""

import collections
import dataclasses
import math

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.camera.assembly import rigid
from plenoptic.optics.element_record import ElementKind
from plenoptic.replaying.events import (
    DrawnKind,
    ElementPassage,
    Escape,
    Meeting,
    MicrolensPassage,
    PathEnding,
    SensorPoint,
    WorldRay,
)
from plenoptic.replaying.retracing import replay, replay_all
from plenoptic.scene.lights import build_lights

CAMERA = pl.camera.example_camera()
LENS = CAMERA.lens
ARRAY = CAMERA.microlenses
REGION = np.s_[300:302, 198:201]
CHECKER = pl.Texture(np.random.default_rng(5).random((16, 16, 3)).astype(np.float32))


def shoot(scene, camera=CAMERA, region=REGION, **how):
    how = {"samples": 20, "seed": 3, "replicates": 8, "progress": False, **how}  # renders nothing beside the region
    if scene is None:
        return pl.render_white(camera, region=region, **how)
    return pl.render(scene, camera, region=region, truth=pl.Truth.NONE, **how)


def paths_of(shot, scene, at):
    """All paths of the pixel at a place of the image."""
    first_row, _, first_column, _ = shot.region or (0, 0, 0, 0)
    samples = shot.samples if shot.sample_counts is None else int(shot.sample_counts[at])
    return replay_all(shot, scene, [(at[0] + first_row, at[1] + first_column, sample) for sample in range(samples)])


def assert_replayed(shot, scene, pixels=None, exact=True):
    """The law of contributions, in all pixels; returns all paths."""
    found = []
    for at in np.ndindex(shot.image.shape[:2]) if pixels is None else pixels:
        ways, value = paths_of(shot, scene, at), shot.image[at]
        assert [way.sample for way in ways] == list(range(len(ways)))
        # Added up as the renderer does: in each replicate one after the other, then these.
        sums = np.zeros((1 + max(way.replicate for way in ways), len(ways[0].contribution)))
        for way in ways:
            sums[way.replicate] += way.contribution
        mean = (sums.sum(axis=0) / len(ways)).astype(np.float32)
        # Otherwise sums are added in another order: float32 rounding, and some 20 additions in float64.
        np.testing.assert_allclose(mean, value, rtol=0 if exact else 2e-7, atol=0)
        found += ways
    for way in found:
        assert_connected(way, shot.camera)
    return found


def assert_connected(way, camera):
    """Each event begins where the last one led, to rounding: coordinates up to 1e3 mm, some 1e-13 of them per event."""
    sensor, array, *rest = way.events or (None, None)
    if sensor is None:
        assert way.ending is PathEnding.UNLIT_PIXEL and not way.contribution.any()
        return
    assert isinstance(sensor, SensorPoint) and isinstance(array, MicrolensPassage)
    assert_on_pixel(sensor, camera)
    lens = [event for event in rest if isinstance(event, ElementPassage)]
    world = next((event for event in rest if isinstance(event, WorldRay)), None)
    scene = [event for event in rest if isinstance(event, Meeting | Escape)]
    assert rest == [*lens, *([] if world is None else [world]), *scene]
    point, direction = array.point, array.direction
    for event in lens:
        np.testing.assert_array_equal(event.before, direction)
        if event.point is not None:
            step = event.point - point
            assert np.linalg.norm(np.cross(step, direction)) < 1e-12 * max(np.linalg.norm(step), 1e2)
        point, direction = event.point, event.after
        assert (event.after is None) == (event.status != pl.RayStatus.OK)
    assert (world is None) == (way.ending is PathEnding.LOST)
    if world is None:
        assert direction is None and not scene and way.weight == 0.0
        assert way.certain or not way.contribution.any()
        return
    if camera.pose is None and camera.lens_placement is None:
        # The elements' points come from traces of a part of the lens: the same bits as those of the whole trace.
        np.testing.assert_array_equal(world.origin, point)
        np.testing.assert_array_equal(world.direction, direction)
    assert_in_scene(way, world, scene)


def assert_on_pixel(event, camera):
    placed, sensor = rigid(camera.sensor_placement, camera.z_sensor).inverse(), camera.sensor
    row, column = np.array(event.pixel) + 0.5 - np.array(sensor.shape) / 2
    off = placed.points(event.point) - sensor.pixel_pitch * np.array([-column, row, 0.0])
    assert (np.abs(off) <= 0.5 * sensor.pixel_pitch * np.array([*sensor.pixel_aperture, 0.0]) + 1e-12).all()


def assert_in_scene(way, world, scene):
    point, direction = world.origin, world.direction
    collected = np.zeros_like(way.radiance)
    for number, event in enumerate(scene):
        collected = collected + event.emitted
        if isinstance(event, Escape):
            np.testing.assert_array_equal(event.direction, direction)
            assert number == len(scene) - 1 and way.ending is PathEnding.LEFT_SCENE
            break
        # Rays start off surfaces by up to 2^-20 of their coordinates, some 4e-4 mm, along the normal.
        np.testing.assert_allclose(event.point, point + event.distance * direction, atol=2e-3)
        assert event.normal @ direction < 0
        assert math.isclose(np.linalg.norm(event.normal), 1.0, rel_tol=1e-12)
        collected = collected + (0.0 if event.light is None else event.light.contribution)
        if isinstance(event.material, pl.Dielectric) and event.direction is not None:
            assert_refracted_or_reflected(direction, event)
        point, direction = event.point, event.direction
        assert (direction is None) == (number == len(scene) - 1)
    # Differences of sums, some ten of them.
    np.testing.assert_allclose(collected * way.clamped, way.radiance, rtol=1e-13, atol=1e-13 * np.abs(collected).max())


def assert_refracted_or_reflected(before, event):
    """What runs along the surface stays, or changes by the index: directions are known to some 1e-15."""
    normal, index = event.shading_normal, event.material.index
    was, now = (d - (d @ normal) * normal for d in (before, event.direction))
    assert min(np.abs(now - ratio * was).max() for ratio in (1.0, index, 1 / index)) < 1e-12


@pytest.mark.parametrize("scene", [None, pl.check_scene()], ids=["white", "check"])
def test_contributions_are_those_of_the_image(scene):
    shot = shoot(scene)
    ways = assert_replayed(shot, scene)
    assert shot.image.any()
    # And paths are lost where the statistics say, as often.
    last = [way.events[-1] for way in ways if way.ending is PathEnding.LOST]
    lost = collections.Counter((event.status.name.lower(), getattr(event, "element", None)) for event in last)
    assert sorted(shot.stats.lost) == sorted((cause, element, count) for (cause, element), count in lost.items())
    assert shot.stats.lost and shot.stats.paths == len(ways)
    # What surely passes is added to white images alone, beside paths that are lost too.
    assert any(way.certain for way in ways) == (scene is None)
    for way in ways if scene is None else ():
        assert float(way.contribution[0]) == pytest.approx(way.weight + way.certain, rel=1e-15)


def lit_room():
    """Lights of all kinds on materials of all kinds, one of them instanced and mirrored."""
    floor = pl.quad((-30, -8, -380), (60, 0, 0), (0, 0, -60), material=pl.Lambertian(CHECKER))
    wall = pl.quad((-40, -40, -430), (80, 0, 0), (0, 80, 0), material=pl.MetallicRoughness(CHECKER, 0.3, 0.4))
    gauze = pl.quad((-30, -30, -372), (60, 0, 0), (0, 60, 0), material=pl.MetallicRoughness(0.5, 0.0, 0.5, opacity=0.4))
    ball = pl.sphere(1.5, material=pl.Conductor(0.9, alpha=0.2))
    places = np.tile(np.eye(4), (2, 1, 1))
    places[:, :3, 3] = (2.0, 0.5, -395), (-2.0, 0.5, -400)
    places[1, 0, 0] = -1.0
    glass = pl.sphere(1.5, center=(0.0, -1.5, -392), material=pl.Dielectric(1.5, absorption=0.05))
    pane = pl.quad((-3, -3, -385), (6, 0, 0), (0, 6, 0), material=pl.materials.ThinGlass())
    lights = [
        pl.SunLight((0.1, -1.0, -0.3), 0.4, angular_radius=0.05),
        pl.QuadLight((0, 20, -380), (6, 0, 0), (0, 0, 6), radiance=20.0, two_sided=True),
        pl.lights.PointLight((6, 6, -370), 150.0),
        pl.lights.SphereLight((-5, 8, -390), 1.0, radiance=30.0),
        pl.lights.SpotLight((0, 10, -370), (0, -1, -2), 300.0, outer_angle=0.5),
    ]
    meshes = [floor, wall, pl.scene.Instances(ball, places), glass, pane, gauze]
    return pl.Scene(meshes, lights, background=pl.EnvironmentMap(np.random.default_rng(6).random((8, 16, 3))))


def many_lamps():
    """Of which one is chosen, by its contribution: some lie behind the wall."""
    random, wall = (
        np.random.default_rng(8),
        pl.quad((-40, -40, -430), (80, 0, 0), (0, 80, 0), material=pl.Lambertian(0.5)),
    )
    places = random.uniform((-9, -9, -460), (9, 9, -380), (20, 3))
    lamps = [pl.QuadLight.facing(place, (0, 0, -430), (2, 3), radiance=9.0) for place in places]
    return pl.Scene([wall], lamps)


def test_the_chosen_light_is_the_one_that_is_named(monkeypatch):
    monkeypatch.setattr(build_lights, "_MANY", 20)
    scene = many_lamps()
    ways = assert_replayed(shoot(scene), scene, pixels=[(0, 0)])
    events = [
        event for way in ways for event in way.bounces if event.light is not None and event.light.point is not None
    ]
    assert len(events) > 10
    for event in events:
        lamp = scene.lights[event.light.place.object - len(scene.meshes)]
        off, u, v = event.light.point - lamp.center, lamp.edge_u, lamp.edge_v
        assert abs(off @ u) <= 0.5 * u @ u and abs(off @ v) <= 0.5 * v @ v
        # Shadow rays end a little before the lamp.
        assert abs(off @ np.cross(u, v)) < 1e-3 * np.linalg.norm(np.cross(u, v))


def textured():
    wall = pl.quad((-40, -40, -410), (80, 0, 0), (0, 80, 0), material=pl.Lambertian(CHECKER))
    return pl.Scene([wall], [pl.lights.PointLight((6, 6, -370), 150.0)], background=0.1)


HOW = {
    "as it is": {},
    "three replicates": {"replicates": 3},
    "fewer samples than replicates": {"samples": 5},
    "at random": {"sampler": pl.rendering.Sampler.RANDOM},
    "at random, three replicates": {"sampler": pl.rendering.Sampler.RANDOM, "replicates": 3},
    "clamped": {"clamp": 0.1},
    "no caustics": {"caustics": pl.rendering.Caustics.EXCLUDE},
    "one bounce": {"max_bounces": 1},
    "no bounces": {"max_bounces": 0},
    "many bounces": {"max_bounces": 30},
}


@pytest.mark.slow
@pytest.mark.parametrize(
    "make, cases",
    [
        (pl.objects_scene, list(HOW)),
        (textured, ["as it is"]),
        (lit_room, ["as it is", "at random", "no caustics", "many bounces"]),
    ],
)
def test_scenes_and_settings(make, cases):
    scene = make()
    for how in cases:
        shot = shoot(scene, region=np.s_[254:255, 256:258], **HOW[how])
        ways = assert_replayed(shot, scene, exact="random" not in how)
        assert shot.image.all() or how == "no bounces", how
        if how == "clamped":
            assert any(way.clamped < 1 for way in ways) and shot.stats.clamped > 0
        if how == "one bounce":
            assert max(len(way.bounces) for way in ways) <= 2
        if how == "no bounces":
            assert {way.ending.name for way in ways} <= {"MAX_BOUNCES", "LEFT_SCENE", "LOST", "ABSORBED"}


ASPHERE = dataclasses.replace(LENS.elements[0], conic=-0.5, aspheric=(0.0, 1e-8))
CAMERAS = {
    "spectral": {"sensitivity": pl.sensor.Sensitivity.lines((640.0, 550.0, 450.0))},
    "posed": {"pose": pl.Pose.look_at((3.0, 2.0, 1.0), (0.0, 0.0, -400.0))},
    "aspheric": {"lens": dataclasses.replace(LENS, elements=(ASPHERE, *LENS.elements[1:]))},
    "thin": {"lens": LENS.with_model(pl.LensModel.THIN)},
    "none": {"lens": LENS.with_model(pl.LensModel.NONE)},
    "polygonal stop": {"lens": LENS.with_stop(pl.PolygonStop(6, 5.0))},
    "spherical microlenses": {
        "microlenses": dataclasses.replace(ARRAY, model=pl.optics.MicrolensModel.SPHERICAL, thickness=0.3, index=1.5)
    },
    "pinholes": {"microlenses": dataclasses.replace(ARRAY, model=pl.optics.MicrolensModel.PINHOLE)},
    "two types": {"microlenses": dataclasses.replace(ARRAY, focal_lengths=(2.0, 1.6))},
    "no microlenses": {"microlenses": None, "microlenses_to_sensor": 0.0, "stop_to_microlenses": 134.0},
    "out of place": {
        "lens_placement": pl.optics.Placement(shift=(0.05, 0.0, 0.02)),
        "microlenses_placement": pl.optics.Placement((0.01, 0.02, 0.0), [[0, -1, 0], [1, 0, 0], [0, 0, 1]]),
    },
    "dark gaps": {"sensor": pl.Sensor(shape=(512, 512), pixel_pitch=0.010, pixel_aperture=(0.5, 0.8))},
}


@pytest.mark.slow
@pytest.mark.parametrize("make", [None, pl.objects_scene], ids=["white", "objects"])
def test_cameras(make):
    scene = make and make()
    for name, changes in CAMERAS.items():
        shot = shoot(scene, dataclasses.replace(CAMERA, **changes), region=np.s_[250:251, 256:258])
        # A fill factor multiplies the sum.
        ways = assert_replayed(shot, scene, exact=name != "dark gaps")
        assert shot.image.all(), name
        lines = {640.0, 550.0, 450.0} if name == "spectral" else {None}
        assert {way.wavelength for way in ways} == lines or scene is None, name
        kinds = {event.kind for way in ways for event in way.events if isinstance(event, ElementPassage)}
        for kind, only in (("ASPHERE", "aspheric"), ("IDEAL_LENS", "thin"), ("POLYGON_STOP", "polygonal stop")):
            assert (ElementKind[kind] in kinds) == (name == only), (kind, name)


@pytest.mark.slow
def test_microlenses_have_the_numbers_that_lists_have():
    centres = ARRAY.lenses((-2.0, -2.0), (2.0, 2.0)).centre[::-1]
    spoiled = pl.MicrolensImperfections(pitch_jitter=0.002, decentre=0.002, seed=1)
    free = {"lattice": pl.Lattice.FREE, "centres": centres}
    for array in (ARRAY, *(dataclasses.replace(ARRAY, **how) for how in (free, {"imperfections": spoiled}))):
        shot = shoot(None, dataclasses.replace(CAMERA, microlenses=array), np.s_[281:283, 300:302], samples=4)
        listed = array.lenses((-2.0, -2.0), (2.0, 2.0))
        for way in assert_replayed(shot, None):
            passage = way.events[1]
            (row,) = np.flatnonzero((listed.index == passage.microlens).all(axis=1))
            # The drawn point lies in the cell: no farther from its centre than a corner, and 3 lenses from the axis.
            assert np.hypot(*(passage.aim[:2] - listed.centre[row])) <= array.cell_radius + 0.01
            assert passage.type == listed.type[row]
            assert passage.microlens != (0, 0)


@pytest.mark.slow
def test_pixels_of_their_own_number_of_samples():
    scene = pl.check_scene()
    shot = shoot(scene, region=np.s_[250:314, 200:264], samples=None, target_error=0.1, tile_side=16)
    assert shot.sample_counts is not None and len(np.unique(shot.sample_counts)) > 1
    few = np.argwhere(shot.sample_counts < shot.samples)
    few = [tuple(at) for at in few[:: len(few) // 4].tolist()]
    assert_replayed(shot, scene, pixels=few[:4])
    (row, column), count = few[0], int(shot.sample_counts[few[0]])
    with pytest.raises(pl.errors.InvalidValueError, match=f"has {count} samples"):
        replay(shot, scene, pixel=(row + 250, column + 200), sample=count)


def pinhole(half=0.2, pixels=2):
    return pl.PlenopticCamera(
        lens=pl.no_lens(1e-4),
        sensor=pl.Sensor(shape=(pixels, pixels), pixel_pitch=20.0 * half / pixels),
        stop_to_microlenses=10.0,
    )


@pytest.mark.slow
def test_the_events_of_a_room_are_what_the_scene_says():
    scene = lit_room()
    shot = pl.render(scene, pinhole(0.03, 4), samples=32, max_bounces=30, truth=pl.Truth.NONE, progress=False)
    ways = assert_replayed(shot, scene)
    meetings = [event for way in ways for event in way.bounces]
    assert {event.light.kind for event in meetings if event.light is not None} == set(DrawnKind) - {DrawnKind.SHEET}
    lamps = [light.mesh() for light in scene.lights if isinstance(light, pl.QuadLight | pl.lights.SphereLight)]
    for event in meetings:
        place = event.place
        mesh = [*scene.meshes, *lamps][place.object]
        if place.instance is not None:
            mesh = mesh.meshes()[place.instance]
        assert event.material == mesh.material
        corners = mesh.vertices[mesh.faces[place.triangle]]
        # In the plane of the triangle that is named, inside it: barycentric coordinates to rounding.
        inside = np.linalg.lstsq(np.vstack([corners.T, np.ones(3)]), np.append(event.point, 1.0), rcond=None)
        np.testing.assert_allclose(corners.T @ inside[0], event.point, atol=1e-8)
        assert inside[0].min() > -1e-3
        if event.light is not None and event.light.light is not None:
            light, sun = scene.lights[event.light.light], event.light.kind is DrawnKind.SUN
            assert isinstance(light, pl.SunLight if sun else pl.lights.PointLight | pl.lights.SpotLight)
            if not sun and event.light.point is not None:
                np.testing.assert_array_equal(event.light.point, light.position)
        if event.light is not None and event.light.blocked is not False:
            assert not event.light.contribution.any()
    kinds = {pl.Dielectric, pl.materials.ThinGlass, pl.Conductor, pl.Lambertian, pl.MetallicRoughness, pl.Emissive}
    assert kinds <= {type(event.material) for event in meetings}
    assert {event.place.instance for event in meetings if event.place.object == 2} == {0, 1}
    assert {event.place.instance for event in meetings if event.place.object != 2} == {None}
    assert any(event.light is not None and event.light.blocked for event in meetings)
    assert {PathEnding.LEFT_SCENE, PathEnding.ROULETTE, PathEnding.ABSORBED} <= {way.ending for way in ways}


@pytest.mark.slow
def test_roulette_and_the_last_bounce_end_paths():
    # In a closed grey room whose lamp nothing hides, paths end by roulette or at the last bounce, never by leaving.
    room = pl.box(200.0, material=pl.Lambertian(0.5))
    scene = pl.Scene([room], [pl.lights.SphereLight((20, 30, -50), 3.0, radiance=100.0)])
    for most, expected in ((1, PathEnding.MAX_BOUNCES), (2, PathEnding.MAX_BOUNCES), (200, PathEnding.ROULETTE)):
        shot = pl.render(scene, pinhole(), samples=64, max_bounces=most, truth=pl.Truth.NONE, progress=False)
        ways = assert_replayed(shot, scene)
        assert {way.ending for way in ways} - {PathEnding.ABSORBED, PathEnding.LOST} == {expected}
        assert all(len(way.bounces) == most + 1 for way in ways if way.ending is PathEnding.MAX_BOUNCES)
        # From the fourth surface on, half of the paths go on: 1 more of 256 paths beyond 4 + 12 once in 16.
        assert all(4 <= len(way.bounces) <= 30 for way in ways if way.ending is PathEnding.ROULETTE)
    point = pl.Scene([room], [pl.lights.PointLight((20, 30, -50), 100.0)])
    shot = pl.render(point, pinhole(), samples=8, max_bounces=1, truth=pl.Truth.NONE, progress=False)
    assert {way.ending for way in assert_replayed(shot, point)} - {PathEnding.LOST} == {PathEnding.NOTHING_AHEAD}


@pytest.mark.slow
def test_paths_that_are_not_finite_show_where_they_broke():
    # A lamp of 1e307 closely above the patch of 0.16 mm that is seen: over r^2 < 0.013 that is beyond float64.
    ground = pl.quad((-50, -50, -40), (100, 0, 0), (0, 100, 0), material=pl.Lambertian(0.8))
    scene = pl.Scene([ground], [pl.lights.PointLight((0, 0, -39.99), 1e307)], background=0.1)
    shot = pl.render(scene, pinhole(0.002), samples=32, truth=pl.Truth.NONE, progress=False)
    assert shot.stats.nonfinite and shot.stats.nonfinite_paths and np.isfinite(shot.image).all()
    for way in replay_all(shot, scene, shot.stats.nonfinite_paths):
        assert not way.finite and way.ending is PathEnding.NOT_FINITE
        assert not np.isfinite(way.radiance).all() and np.isfinite(way.contribution).all()
        broken = way.events[way.first_nonfinite]
        assert isinstance(broken, Meeting) and not np.isfinite(broken.light.contribution).all()
        assert "not finite from here on" in repr(way) and "left out of the image" in repr(way)
    ways = [way for at in np.ndindex(2, 2) for way in paths_of(shot, scene, at)]
    assert sum(not way.finite for way in ways) == shot.stats.nonfinite == shot.stats.paths_through_lens


def test_a_replay_prints_as_a_table_and_is_a_value():
    """The documented example shows the rest."""
    scene = pl.check_scene()
    ways = paths_of(shoot(scene), scene, (0, 0))
    through = next(way for way in ways if way.ending is not PathEnding.LOST)
    lost = next(way for way in ways if way.ending is PathEnding.LOST)
    names = [line[:10].strip() for line in repr(through).splitlines()]
    table = ["sensor", "array", "", *["lens"] * len(LENS.elements), "world", "bounce 0"]
    assert names[1 : 1 + len(table)] == table and names[-3:] == ["ends", "brings", "adds"]
    assert "lost: clipped" in repr(lost) and len({through, lost, through}) == 2
    assert through.camera_points.shape == (2 + len(LENS.elements) + 1, 3)


def test_what_cannot_be_replayed_says_why():
    scene = pl.check_scene()
    shot = shoot(scene)
    here = {"pixel": (300, 199), "sample": 0}
    outside = r"pixel \(10, 20\) is outside .* rows 300 to 301 and columns 198 to 200"
    for exposure, seen, given, message in (
        (shot, scene, here | {"pixel": (10, 20)}, outside),
        (shot, scene, here | {"pixel": (302, 198)}, "is outside"),
        (shot, scene, here | {"pixel": (-1, 198)}, "row of the pixel is -1; it must be at least 0"),
        (shot, scene, here | {"pixel": (300, 199.5)}, "column of the pixel is 199.5; it must be a whole number"),
        (shot, scene, here | {"pixel": 300}, r"pixel is 300; it must be \(row, column\)"),
        (shot, scene, here | {"sample": 20}, "sample is 20, and pixel .* has 20 samples"),
        (shot, scene, here | {"sample": -1}, "sample is -1"),
        (pl.Exposure(np.ones((2, 2, 1))), scene, here | {"pixel": (0, 0)}, "does not know its camera, settings, seed"),
        (dataclasses.replace(shot, seed=(4, 3)), scene, here, "was merged of the seeds 3, 4; replay one that has"),
        (dataclasses.replace(shot, settings=None), scene, here, "does not know its settings;"),
        (scene, scene, here, "exposure is a Scene; give an Exposure"),
        (shot, 1.0, here, "scene is a float"),
        (shot, pl.objects_scene(), here, "the image has 1 channels, and this scene gives 3"),
        (shot, None, here, "is the image of a scene"),
        (shoot(None), pl.Scene(background=1.0), here, "is a white image, which has no scene; give None"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=message):
            replay(exposure, seen, **given)
    for paths, message in (
        ([(300, 199)], r"a path is \(300, 199\); it must be \(row, column, sample\)"),
        ((300, 199, 0), "a path is 300"),
        (3, "paths is an int; give a sequence of"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=message):
            replay_all(shot, scene, paths)


def test_pixels_that_no_light_reaches_have_no_events():
    # Beside the axis the pupil is gone: a sensor far wider than the images of the stop.
    camera = dataclasses.replace(
        CAMERA, microlenses=None, microlenses_to_sensor=0.0, sensor=pl.Sensor(shape=(48, 48), pixel_pitch=10.0)
    )
    shot = pl.render_white(camera, samples=4, progress=False)
    way = replay(shot, None, pixel=(0, 0), sample=3)
    assert shot.image[0, 0, 0] == 0 and shot.image.any()
    assert way.ending is PathEnding.UNLIT_PIXEL and way.events == () and not way.contribution.any()
    assert "unlit pixel" in repr(way)
