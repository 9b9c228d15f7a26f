import dataclasses
import math

import numpy as np
import pytest
from scene_helpers import LAMP, SKY, square

import plenoptic as pl
from plenoptic.core.motions.rotation import rotation_about
from plenoptic.scene.file_cameras import View

PLACES = np.tile(np.eye(4), (3, 1, 1))
PLACES[:, 0, 3] = 0, 10, 20
ROW = pl.scene.Instances(square(), PLACES)


def test_bounds_hold_meshes_instances_and_lights_with_a_surface():
    assert pl.Scene(background=1.0).bounds is None
    np.testing.assert_array_equal(pl.Scene([square()], [LAMP]).bounds, [[-1.5, -2, 0], [2, 2, 9]])
    np.testing.assert_array_equal(pl.Scene([square(), ROW]).bounds, [[0, 0, 0], [22, 2, 0]])
    # 642 corners of a nearly round body, 0.24 % outside the sphere.
    ball = pl.Scene(lights=[pl.lights.SphereLight((9, 0, 0), 2.0)]).bounds
    np.testing.assert_allclose(ball, [[7, -2, -2], [11, 2, 2]], rtol=0, atol=0.01)
    # Points and suns have none.
    assert pl.Scene(lights=[pl.lights.PointLight((1, 2, 3)), pl.SunLight((0, 0, -1))]).bounds is None


def test_merging_adds_up():
    both = pl.Scene([square()], [LAMP]).merged(pl.Scene([square(pl.Emissive(1.0))], background=0.2))
    assert len(both.meshes) == 2 and both.lights == (LAMP,) and both.background == pl.lights.ConstantBackground(0.2)
    assert both.merged(pl.Scene(background=0.2)) == both
    assert both.with_lights([]).lights == ()
    assert both.with_lights(light for light in [LAMP, LAMP]).lights == (LAMP, LAMP)
    mapped = pl.Scene([square()], background=SKY)
    assert mapped.merged(pl.Scene([ROW])).background == SKY
    assert mapped.merged(pl.Scene([ROW], background=SKY)).meshes == (square(), ROW)
    for one, other in ((both, 0.3), (mapped, SKY.rotated((0, 1, 0), 1.0))):
        with pytest.raises(pl.errors.SceneError, match="different backgrounds"):
            one.merged(pl.Scene(background=other))


def test_impossible_scenes_are_refused():
    for arguments, said in (
        (([square()], [square()]), "holds Mesh; it may hold QuadLight or .* or SunLight or Sheet only"),
        (([square()], np.array(1.0)), "lights is ndarray; it must be a sequence of QuadLight"),
        (([square()], (), LAMP), "radiance"),
        (([square()], (), -1.0), "radiance"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=said):
            pl.Scene(*arguments)


def test_impossible_views_are_refused():
    given = {"name": "a", "position": (0, 0, 1), "look_at": (0, 0, 0), "up": (0, 1, 0)}
    assert View(**given).vertical_field_of_view is None
    for change, said in (
        ({"look_at": (0, 0, 1)}, "look_at is the position"),
        ({"up": (0, 0, 2)}, "along the view"),
        ({"up": (0, 0, 0)}, "along the view"),
        ({"position": (0, math.nan, 1)}, "position.*finite"),
        ({"vertical_field_of_view": math.pi}, "below pi"),
        ({"vertical_field_of_view": 0.0}, "above 0"),
        ({"aspect_ratio": -1.0}, "aspect_ratio is -1"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=said):
            View(**given | change)


SIMILAR = np.eye(4)
SIMILAR[:3, :3], SIMILAR[:3, 3] = 2.5 * rotation_about((1, 2, -1), 0.7), (30.0, -20.0, 50.0)
BALL = pl.sphere(0.5, segments=(8, 4), center=(3, 2, -40))
SCENE = pl.Scene(
    [pl.box(2.0, center=(0, 0, -40)), pl.scene.Instances(BALL, [np.eye(4), np.diag([1, -1, 1, 1])])],
    [
        pl.QuadLight((0, 9, -40), (2, 0, 0), (0, 0, 2), radiance=4.0),
        pl.lights.SphereLight((9, 0, -40), 1.0, 3.0),
        pl.lights.PointLight((-9, 0, -30), (50.0, 60.0, 70.0)),
        pl.lights.SpotLight((0, -9, -30), (0, 0.5, -0.5), 80.0),
        pl.SunLight((0.2, -1.0, -0.4), 0.5),
    ],
    pl.EnvironmentMap(np.random.default_rng(0).random((4, 8, 1))).rotated((0, 0, 1), 0.4),
    [pl.scene.View("front", (0, 0, 0), (0, 0, -1))],
)


@pytest.mark.slow
def test_a_scene_and_its_camera_moved_together_show_the_same():
    # Radiance is left as it is by turns, shifts and scales; the pinhole's light does not grow with its scale. Rounding
    # in other places; float32 decides on hits at edges.
    camera = pl.PlenopticCamera(pl.no_lens(1e-4), pl.Sensor((8, 8), pixel_pitch=0.1), stop_to_microlenses=1.0)
    moved = SCENE.transformed(SIMILAR)
    (view,) = moved.views
    np.testing.assert_allclose(np.linalg.norm(view.look_at - view.position), 2.5)
    other = camera.posed(position=view.position, look_at=view.look_at, up=view.up)
    settings = {"samples": 256, "max_bounces": 3, "truth": pl.Truth.NONE, "progress": False}
    here, there = pl.render(SCENE, camera, **settings), pl.render(moved, other, **settings)
    error = np.hypot(here.standard_error, there.standard_error)
    # The same random numbers: nearly all paths are the same.
    assert np.mean(np.abs(here.image - there.image) > 0.1 * error + 1e-5 * here.image) < 0.1
    assert abs((here.image - there.image).sum(dtype=float)) < 2 * np.sqrt((error.astype(float) ** 2).sum())


def test_moving_there_and_back_is_the_identity():
    back = SCENE.transformed(SIMILAR).transformed(np.linalg.inv(SIMILAR))
    np.testing.assert_allclose(back.bounds, SCENE.bounds, atol=1e-12)
    for one, other in zip(SCENE.lights, back.lights, strict=True):
        for field in dataclasses.fields(one):
            np.testing.assert_allclose(getattr(one, field.name), getattr(other, field.name), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(back.background.rotation, SCENE.background.rotation, atol=1e-14)
    # Meshes alone may be stretched and mirrored.
    stretched = pl.Scene([pl.box(2.0)], background=1.0).transformed(np.diag([1, 2, -3, 1]))
    assert stretched.bounds[1].tolist() == [1, 2, 3] and stretched.background.radiance == 1.0
    for matrix, sentence in (
        (np.diag([1, 2, 1, 1]), "equally"),
        (np.diag([1, 1, -1, 1]), "mirrors"),
        (np.diag([1, 1, 1, 2]), "must"),
        (np.zeros((4, 4)), "must"),
        (np.full((4, 4), np.nan), "must"),
    ):
        with pytest.raises(pl.errors.SceneError, match=sentence):
            SCENE.transformed(matrix)


def test_points_seen_through_holes_are_visible():
    there = np.ones((4, 4, 1))
    there[1:3, 1:3] = 0.0
    leaf = pl.MetallicRoughness(0.5, opacity=pl.Texture(there, filter=pl.materials.TextureFilter.NEAREST), cutoff=0.5)
    lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(0.5))
    camera = pl.PlenopticCamera(lens, pl.Sensor((16, 16), pixel_pitch=0.3), stop_to_microlenses=134.6)
    scene = pl.Scene([pl.quad((-10, -10, -404), (20, 0, 0), (0, 20, 0), material=leaf)], background=1.0)
    assert camera.project([(0, 0, -412), (7, 0, -412)], scene).visible.tolist() == [True, False]
