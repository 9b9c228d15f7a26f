"""Black images and scenes out of view: one warning that names the cause, and none where nothing is wrong."""

import dataclasses
import re
import warnings

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.errors import BlackImageWarning, PlenopticWarning, UnseenSceneWarning

CAMERA = pl.camera.example_camera(shape=(64, 64))


def wall(z=-404.0, material=None):
    return pl.quad((-100, -100, z), (200, 0, 0), (0, 200, 0), material=material)


def lamp(towards, **more):
    return pl.QuadLight.facing((0, 60, -300), towards, (40, 40), **{"radiance": 10.0, **more})


LAMP, AWAY = lamp((0, 0, -404)), lamp((0, 0, 404))
BACK = pl.quad((-100, -100, -404), (0, 200, 0), (200, 0, 0), material=pl.Emissive(5.0))


def said(scene, camera=CAMERA, **settings):
    """The warnings of a render, and whether its image is black."""
    with warnings.catch_warnings(record=True) as warnings_:
        warnings.simplefilter("always")
        shot = pl.render(scene, camera, **{"samples": 8, "progress": False, "threads": 2, "tile_side": 16, **settings})
    assert all(issubclass(warning.category, PlenopticWarning) for warning in warnings_)
    assert all(warning.filename == __file__ for warning in warnings_)  # at the user's line
    return [(warning.category, str(warning.message)) for warning in warnings_], not shot.image.any()


HALF = pl.quad((-100, -100, -404), (0, 200, 0), (100, 0, 0), material=pl.Emissive(5.0))
"""It shines away from the camera, in the left half of the view."""

WAY_BACK = np.eye(4) + np.outer([0, 0, -404.0, 0], [0, 0, 0, 1])
ROOF = pl.Mesh([[-300, 30, -500], [300, 30, -500], [0, 30, 100]], [[0, 2, 1]], name="roof")
DARK, BLUE = lamp((0, 0, -404), radiance=0.0), lamp((0, 0, -404), radiance=(0.0, 0.0, 9.0))
RED, BEHIND = wall(material=pl.Lambertian((1.0, 0.0, 0.0))), pl.lights.PointLight((0, 0, -500), 1e5)
SPOT, BELOW = pl.lights.SpotLight((0, 100, -300), (0, 1, 0), 1e5), LAMP.moved(np.diag([1, 1, -1.0, 1]), 1)
BLACK = {
    "nothing shines": ((wall(),), (), {}, "nothing in the scene emits light"),
    "a lamp of radiance 0": ((wall(),), (DARK,), {}, "no light of the scene emits"),
    "a lamp that faces away": ((wall(),), (AWAY,), {}, "reaches the visible surfaces: QuadLight 0 faces away"),
    "one lamp of two that shines": ((wall(),), (DARK, AWAY), {}, "surfaces: QuadLight 1 faces away"),
    "two lamps": ((wall(),), (AWAY, AWAY), {}, "QuadLight 0 faces away.* QuadLight 1 faces away"),
    "on a wall of instances": ((pl.scene.Instances(wall(0.0), [WAY_BACK]),), (AWAY,), {}, "QuadLight 0 faces away"),
    "one pixel of it": ((wall(),), (AWAY,), {"region": np.s_[30:31, 30:31]}, "QuadLight 0 faces away"),
    "a target": ((wall(),), (AWAY,), {"samples": None, "target_error": 0.1}, "QuadLight 0 faces away"),
    "a lamp behind the wall": ((wall(),), (BEHIND,), {}, "PointLight 0 shines from behind"),
    "a sun the other way": ((wall(),), (pl.SunLight((0, 0, 1)),), {}, "SunLight 0 shines from behind"),
    "a spot that aims elsewhere": ((wall(),), (SPOT,), {}, "SpotLight 0 shines past them"),
    "a roof": ((wall(), ROOF), (LAMP,), {}, "QuadLight 0 is hidden by other objects"),
    "in a box": ((pl.box(600), wall()), (), {"background": 1.0}, "the background is hidden"),
    "emission from behind": ((BACK,), (), {}, "the visible surfaces are black, glass, mirrors or backs of emitters"),
    "emission beside a wall": ((HALF, pl.quad((0, -100, -403), (100, 0, 0), (0, 200, 0))), (), {}, "Mesh 0 faces away"),
    "a black wall": ((wall(material=pl.Lambertian(0.0)),), (LAMP,), {}, "the visible surfaces are black, glass"),
    "colours": ((RED,), (BLUE,), {}, "light reaches the visible surfaces and not the camera.* other colours"),
    "no bounces": ((wall(),), (LAMP,), {"max_bounces": 0}, "max_bounces is 0"),
    "behind the camera": ((wall(404.0),), (BELOW,), {}, r"no path met the scene.* between \[.*move it, or"),
    "a sun and no mesh": ((), (pl.SunLight((0, -1, 0)),), {}, "the scene has no meshes"),
}


def test_a_black_image_names_its_cause_once():
    for case, (meshes, lights, settings, words) in BLACK.items():
        scene = pl.Scene(meshes, lights, settings.get("background"))
        messages, black = said(scene, **{name: value for name, value in settings.items() if name != "background"})
        assert black and [category for category, _ in messages] == [BlackImageWarning], case
        assert re.search(words, messages[0][1]), case


SMALL = pl.Scene([pl.box(4, center=(0, 0, -404))], [LAMP])
"""In plain view, in the middle."""


def test_nothing_is_said_where_nothing_is_wrong():
    lamp, far_box = pl.QuadLight.facing((0, 60, -200), (0, 0, -299), (9, 9)), pl.box(0.1, center=(0, 0, -404))
    for name, scene, settings in (
        ("lit", SMALL, {}),
        ("one side of two", pl.Scene([HALF, wall(-500.0)]), {}),
        ("one lamp of two", pl.Scene([wall()], [LAMP, AWAY]), {}),
        ("lit box", pl.Scene([pl.box(600), wall(-299.0)], [lamp]), {}),
        ("a pixel beside it", pl.Scene([far_box], background=1.0), {"region": np.s_[0:1, 0:1]}),
        ("pixels beside it", pl.Scene([far_box], background=1.0), {"region": np.s_[0:8, 20:44]}),
        ("no mesh", pl.Scene(background=1.0), {}),
    ):
        assert said(scene, **settings)[0] == [], name
    # Between micro images, and beside the box before a black world: single pixels, some of them dark.
    messages = [said(SMALL, region=np.s_[k : k + 1, k : k + 1]) for k in range(0, 64, 2)]
    assert all(warned == [] for warned, _ in messages)
    assert sum(black for _, black in messages) > 3


def test_a_whole_dark_region_is_told_from_a_dark_scene():
    messages, black = said(SMALL, pl.camera.example_camera(), region=np.s_[128:160, 128:160])
    assert black and len(messages) == 1 and "this region of the sensor gets no light, and others do" in messages[0][1]
    aside = CAMERA.moved(pl.CameraPart.SENSOR, shift=(500.0, 0.0, 0.0))
    with pytest.warns(BlackImageWarning, match="no light passes the camera"):
        pl.render_white(aside, samples=8, progress=False)


def test_opaque_surfaces_are_named():
    opaque = pl.optics.Reflectance(1.0)
    plates = {"model": pl.optics.MicrolensModel.SPHERICAL, "coating": opaque}
    for part in (
        {"lens": pl.optics.coated(CAMERA.lens, opaque)},
        {"microlenses": dataclasses.replace(CAMERA.microlenses, **plates)},
    ):
        camera, words = dataclasses.replace(CAMERA, **part), "surfaces of lens or microlenses transmit no light"
        with pytest.warns(BlackImageWarning, match=words):
            assert not pl.render_white(camera, samples=8, progress=False).image.any()
        with pytest.warns(BlackImageWarning, match=words):
            assert not pl.render(pl.Scene(background=1.0), camera, samples=8, progress=False).image.any()


def test_what_is_too_small_to_be_met_is_told_from_what_is_out_of_view():
    messages, black = said(pl.Scene([wall(404.0)], background=1.0))
    assert not black and [category for category, _ in messages] == [UnseenSceneWarning]
    messages, _ = said(pl.Scene([pl.box(1e-6, center=(0, 0, -404))], background=1.0))
    assert len(messages) == 1 and "in view and small: give more samples" in messages[0][1]
