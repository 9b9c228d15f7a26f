import math
import pickle

import numpy as np
import pytest
from scene_helpers import square

import plenoptic as pl
from plenoptic.scene.file_cameras import View
from plenoptic.scene.lights.registry import LIGHTS

LAMP = pl.QuadLight((0, 0, 9), (3, 0, 0), (0, 4, 0), radiance=2.0)
SKY = pl.EnvironmentMap(np.ones((2, 4, 1)))


PLACES = np.tile(np.eye(4), (3, 1, 1))
PLACES[:, 0, 3] = 0, 10, 20
ROW = pl.scene.Instances(square(), PLACES)


def test_scenes_compare_pickle_and_hold_all_kinds():
    scene = pl.Scene([square()], [LAMP], 0.5)
    assert scene.background == pl.lights.ConstantBackground(0.5)
    assert pl.Scene([square()], [LAMP], pl.lights.ConstantBackground(0.5)) == scene == pickle.loads(pickle.dumps(scene))
    assert repr(scene) == "Scene(1 mesh, 2 triangles, 1 light, background 0.5)"
    assert pl.Scene(mesh for mesh in [square()]).meshes == (square(),)
    # All kinds of lights, worlds and instances.
    lights = [LAMP, pl.lights.SphereLight((0, 0, 9), 1.0), pl.lights.PointLight((0, 0, 9)), pl.SunLight((0, 0, -1))]
    lights.append(pl.lights.SpotLight((0, 0, 9), (0, 0, -1)))
    scene = pl.Scene([square(), ROW], lights, SKY)
    again = pickle.loads(pickle.dumps(scene))
    assert again == scene and hash(again) == hash(scene)
    assert all(isinstance(light, LIGHTS) and light == other for light, other in zip(lights, again.lights, strict=True))
    sky = "EnvironmentMap(texels=<2 x 4 x 1 float32>)"
    assert repr(scene) == f"Scene(2 meshes, 4 triangles, 3 instances, 5 lights, {sky})"
    assert scene != pl.Scene([square(), ROW], lights, SKY.rotated((0, 1, 0), 1.0))
    assert scene != pl.Scene([square(), ROW], lights[::-1], SKY)
    assert repr(pl.Scene([ROW])) == "Scene(1 mesh, 2 triangles, 3 instances)"


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
    lit = pl.Scene([square()], [LAMP])
    both = lit.merged(pl.Scene([square(pl.Emissive(1.0))], background=0.2))
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
        ((square(),), r"\[item\]"),
        (([LAMP],), "holds QuadLight; it may hold Mesh or Instances only"),
        (([square()], LAMP), "sequence of QuadLight"),
        (([square()], [square()]), "holds Mesh; it may hold QuadLight or .* or SunLight only"),
        ((np.array(1.0),), "meshes is ndarray; it must be a sequence of Mesh"),
        (([square()], np.array(1.0)), "lights is ndarray; it must be a sequence of QuadLight"),
        (([[square()]],), "meshes holds list"),
        (([square()], (), np.ones((2, 4, 1))), r"background is .*\(2, 4, 1\); give .*EnvironmentMap"),
        (([square()], (), LAMP), "radiance"),
        (([square()], (), "sky"), "radiance"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=said):
            pl.Scene(*arguments)
    for arguments, said in (((), "at least one"), (([square()], (), -1.0), "radiance")):
        with pytest.raises(pl.errors.SceneError, match=said):
            pl.Scene(*arguments)


def test_a_view_is_a_value():
    view = View("a", (0, 0, 1), (0, 0, 0), vertical_field_of_view=0.5)
    assert view == View("a", [0, 0, 1], [0, 0, 0], vertical_field_of_view=0.5) != View("a", (0, 0, 1), (0, 0, 0))
    assert pickle.loads(pickle.dumps(view)) == view and not view.position.flags.writeable
    for change, said in (
        ({"look_at": (0, 0, 1)}, "look_at is the position"),
        ({"up": (0, 0, 2)}, "along the view"),
        ({"up": (0, 0, 0)}, "along the view"),
        ({"position": (0, math.nan, 1)}, "position.*finite"),
        ({"vertical_field_of_view": math.pi}, "below pi"),
        ({"vertical_field_of_view": 0.0}, "above 0"),
        ({"aspect_ratio": -1.0}, "aspect_ratio is -1"),
        ({"name": 3}, "name is 3"),
    ):
        given = {"name": "a", "position": (0, 0, 1), "look_at": (0, 0, 0), "up": (0, 1, 0)} | change
        with pytest.raises(pl.errors.InvalidValueError, match=said):
            View(**given)
