import pickle

import numpy as np
import pytest

import plenoptic as pl

CORNERS = np.array([[0.0, 0, 0], [2, 0, 0], [0, 2, 0], [2, 2, 0]])
FACES = np.array([[0, 1, 2], [1, 3, 2]])
UV = np.array([[0.0, 0], [1, 0], [0, 1], [1, 1]])
LAMP = pl.QuadLight((0, 0, 9), (3, 0, 0), (0, 4, 0), radiance=2.0)
GREY = pl.Lambertian()


def square(material=GREY, **more):
    return pl.Mesh(CORNERS, FACES, material, **more)


def test_scenes_compare_pickle_and_take_bare_backgrounds():
    scene = pl.Scene([square()], [LAMP], 0.5)
    assert scene.background == pl.ConstantBackground(0.5)
    assert pl.Scene([square()], [LAMP], pl.ConstantBackground(0.5)) == scene == pickle.loads(pickle.dumps(scene))
    assert repr(scene) == "Scene(1 mesh, 2 triangles, 1 light, background 0.5)"
    assert pl.Scene(mesh for mesh in [square()]).meshes == (square(),)


def test_bounds_hold_meshes_and_lights():
    assert pl.Scene(background=1.0).bounds is None
    np.testing.assert_array_equal(pl.Scene([square()], [LAMP]).bounds, [[-1.5, -2, 0], [2, 2, 9]])


def test_merging_adds_up():
    lit = pl.Scene([square()], [LAMP])
    both = lit.merged(pl.Scene([square(pl.Emissive(1.0))], background=0.2))
    assert len(both.meshes) == 2 and both.lights == (LAMP,) and both.background == pl.ConstantBackground(0.2)
    assert both.merged(pl.Scene(background=0.2)) == both
    with pytest.raises(pl.SceneError, match="different backgrounds"):
        both.merged(pl.Scene(background=0.3))
    assert both.with_lights([]).lights == ()


@pytest.mark.parametrize(
    ("arguments", "kind", "said"),
    [
        ((), pl.SceneError, "at least one"),
        ((square(),), pl.InvalidValueError, r"\[item\]"),
        (([LAMP],), pl.InvalidValueError, "Mesh only"),
        (([square()], LAMP), pl.InvalidValueError, "sequence of QuadLight"),
        (([square()], [square()]), pl.InvalidValueError, "QuadLight only"),
        ((np.array(1.0),), pl.InvalidValueError, "meshes is ndarray; it must be a sequence of Mesh"),
        (([square()], np.array(1.0)), pl.InvalidValueError, "lights is ndarray; it must be a sequence of QuadLight"),
        (([square()], (), -1.0), pl.SceneError, "radiance"),
        (([square()], (), "sky"), pl.InvalidValueError, "radiance"),
    ],
)
def test_impossible_scenes_are_refused(arguments, kind, said):
    with pytest.raises(kind, match=said):
        pl.Scene(*arguments)
