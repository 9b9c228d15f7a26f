"""Bodies with media that touch, cross, are open or lie too deep in each other are named; others are not."""

import dataclasses
import warnings

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.errors import ImplausibleSceneWarning
from plenoptic.scene.body_nesting import wrong_bodies

WATER = pl.Dielectric(1.33, medium=pl.materials.Medium(0.01))
GLASS, CLEAR = pl.Dielectric(1.5, absorption=0.001), pl.Dielectric(1.5)
LAMP = pl.lights.PointLight((0, 100, 0), intensity=1.0)


def box(name, size, x, material, z=-50.0):
    """A box with a name."""
    mesh = pl.box(size, center=(x, 0, z), material=material)
    return pl.Mesh(mesh.vertices, mesh.faces, material, name=name)


def ball(name, radius, x, material, y=0.0):
    """A ball with a name."""
    mesh = pl.sphere(radius, center=(x, y, -50), segments=(32, 16), material=material)
    return pl.Mesh(mesh.vertices, mesh.faces, material, name=name)


def sentences(*meshes, medium=None):
    """All that is said on a scene."""
    return list(wrong_bodies(pl.Scene(meshes, [LAMP], medium=medium)))


@pytest.mark.parametrize(
    "meshes",
    [
        (box("first", 10, 0, WATER), box("second", 10, 10, GLASS)),
        (box("first", 10, 0, WATER), box("second", 4, 7, CLEAR)),
        (box("first", 10, 0, WATER), box("second", 10, 10, WATER)),
        (box("first", 10, 0, WATER), box("second", 4, 3, GLASS)),
        (box("first", 10, 0, WATER), box("second", 10, 5, GLASS, z=-48)),
        (ball("first", 10, 0, WATER), ball("second", 10, 15, GLASS)),
    ],
    ids=["touch", "touch clear glass", "touch alike", "touch within", "boxes cross", "balls cross"],
)
def test_bodies_that_touch_or_cross_are_named(meshes):
    (sentence,) = sentences(*meshes)
    assert "first and second;" in sentence and "weaken light wrongly" in sentence
    with pytest.warns(ImplausibleSceneWarning, match="first and second"):
        pl.render(
            pl.Scene(meshes, [LAMP]), pl.camera.example_camera(shape=(8, 8)), samples=1, replicates=1, progress=False
        )


def test_open_bodies_are_named():
    closed = box("bowl", 10, 0, WATER)
    bowl = pl.Mesh(closed.vertices, closed.faces[2:], WATER, name="bowl")
    (sentence,) = sentences(bowl, ball("ball", 3, 50, GLASS))
    assert ": bowl;" in sentence


def test_clear_bodies_in_a_medium_hold_it_off():
    touching = box("first", 10, 0, CLEAR), box("second", 10, 10, pl.Dielectric(1.6))
    assert not sentences(*touching)
    (sentence,) = sentences(*touching, medium=pl.materials.Medium(0.01))
    assert "first and second;" in sentence


def test_bodies_apart_or_within_each_other_are_not_named():
    outer, inner = pl.sphere(10, center=(0, 0, -50)), pl.sphere(9, center=(0, 0, -50))
    bubble = [pl.Mesh(outer.vertices, outer.faces, GLASS), pl.Mesh(inner.vertices, inner.faces[:, ::-1], GLASS)]
    table = pl.box((50, 10, 50), center=(0, -10, -50), material=pl.Lambertian(0.5))
    for meshes in (
        (box("first", 10, 0, WATER), box("second", 10, 10.01, GLASS)),
        (ball("first", 10, 0, WATER), ball("second", 10, 15, GLASS, y=15)),
        (box("tank", 30, 0, WATER), ball("first", 5, -6, GLASS), ball("second", 5, 6, CLEAR)),
        # A glass on a table, and a stone on the ground of a tank: opaque surfaces coincide with those of the glass.
        (box("glass", 10, 0, WATER), table),
        (box("tank", 30, 0, WATER), pl.box(10, center=(0, -10, -50), material=pl.Lambertian(0.5))),
        bubble,
    ):
        assert not sentences(*meshes)
        assert not sentences(*meshes, medium=pl.materials.Medium(0.01))


def test_many_beads_in_a_tank_are_not_named():
    # Turned and scaled at random: rays graze many of their edges.
    random = np.random.default_rng(3)
    beads = []
    for k in range(200):
        centre = np.array([k % 6, k // 6 % 6, k // 36]) * 12.0
        bead = pl.box(random.uniform(1, 6, 3).tolist(), material=GLASS).rotated_deg(
            random.normal(size=3), random.uniform(0, 360)
        )
        beads.append(bead.translated(*centre.tolist()))
    tank = pl.box(100.0, center=(30, 30, 30), material=WATER)
    assert not sentences(tank, *beads)


@pytest.mark.parametrize("medium", [None, pl.materials.Medium(0.01)])
def test_more_bodies_than_rays_hold_are_told(medium):
    balls = [ball(str(k), 10.0 - k, 0, pl.Dielectric(1.1 + 0.1 * k, absorption=0.001)) for k in range(5)]
    most = 4 if medium is None else 3
    assert not sentences(*balls[:most], medium=medium)
    (sentence,) = sentences(*balls[: most + 1], medium=medium)
    assert f"more than {most} bodies lie one within the other" in sentence


def test_renders_of_sound_scenes_warn_of_nothing():
    with warnings.catch_warnings():
        warnings.simplefilter("error", ImplausibleSceneWarning)
        scene = pl.Scene([box("tank", 30, 0, WATER), ball("ball", 5, 0, GLASS)], [LAMP])
        pl.render(scene, pl.camera.example_camera(shape=(8, 8)), samples=1, replicates=1, progress=False)


def copies(mesh, *x, motion=None):
    """Copies of a mesh at places along x, the last one mirrored."""
    matrices = np.tile(np.eye(4), (len(x), 1, 1))
    matrices[:, 0, 3] = x
    matrices[-1, 1, 1] = -1.0
    return pl.scene.Instances(mesh, matrices, motion)


def test_copies_of_bodies_are_named_as_bodies_are():
    bead = ball("bead", 5.0, 0.0, WATER)
    assert not sentences(copies(bead, 0.0, 8.0, 30.0))  # crossing bodies of one medium weaken light rightly
    (sentence,) = sentences(copies(box("brick", 10, 0, WATER), 0.0, 10.0, 30.0))
    assert ": copy 0 of brick and copy 1 of brick;" in sentence
    (sentence,) = sentences(copies(bead, 0.0, 30.0), box("block", 10, 9, GLASS))
    assert ": copy 0 of bead and block;" in sentence
    tank = box("tank", 60, 0, GLASS)
    assert not sentences(copies(bead, 0.0, 12.0, 24.0), tank) and not sentences(copies(bead, 0.0), tank)
    (sentence,) = sentences(copies(bead, 0.0, 28.0), tank)
    assert "copy 1 of bead" in sentence and "tank" in sentence and "copy 0" not in sentence


def test_moving_bodies_are_checked_where_the_shutter_opens_and_closes():
    motion = pl.Motion.screw((-1, 1), axis=(1, 0, 0), advance=5)  # from x = 0 to 5 mm in 2 s
    scene = pl.Scene([copies(ball("bead", 5.0, 0.0, WATER), 0.0, motion=motion), box("block", 10, 14, GLASS)], [LAMP])
    assert not list(wrong_bodies(scene)) and not list(wrong_bodies(scene, (-1.0, 0.2)))
    (sentence,) = wrong_bodies(scene, (-1.0, 1.0))
    assert ": bead and block;" in sentence
    camera = pl.camera.example_camera(shape=(8, 8))
    for duration, wrong in ((2.0, True), (0.2, False)):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", ImplausibleSceneWarning)
            exposed = dataclasses.replace(camera, shutter=pl.sequences.Shutter(duration))
            pl.render(scene, exposed, samples=1, replicates=1, progress=False)
        assert any("bead and block" in str(warning.message) for warning in caught) is wrong
