"""Plans: stages that run and that are left out; kernels compiled in advance are those needed later."""

import dataclasses

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.core.progress.compiling import compiling
from plenoptic.rendering import Stage

CAMERA = pl.camera.example_camera()


def aspheric(lens: pl.LensStack) -> pl.LensStack:
    first = dataclasses.replace(lens.elements[0], aspheric=(0.0, 1e-8))
    return dataclasses.replace(lens, elements=[first, *lens.elements[1:]])


def test_a_lens_runs_what_it_has():
    choices = {Stage.ASPHERES, Stage.PLACEMENTS, Stage.SHAPED_STOPS}
    for lens, running in (
        (CAMERA.lens, set()),
        (aspheric(CAMERA.lens), {Stage.ASPHERES}),
        (CAMERA.lens.moved(3, shift=(0.1, 0, 0)), {Stage.PLACEMENTS}),
        (aspheric(CAMERA.lens).moved(0, tilt=(0.1, 0, 0)), {Stage.ASPHERES, Stage.PLACEMENTS}),
        (aspheric(CAMERA.lens).with_model(pl.LensModel.THIN), set()),
        (CAMERA.lens.with_stop(pl.PolygonStop(6, 5.0)), {Stage.SHAPED_STOPS}),
    ):
        plan = pl.plan(None, dataclasses.replace(CAMERA, lens=lens))
        assert {stage for stage in choices if plan.runs(stage)} == running
        assert plan.runs(Stage.LENS)
    # Plates run where microlenses have surfaces.
    for model in pl.optics.MicrolensModel:
        index = 100.0 if model is pl.optics.MicrolensModel.FLAT_HIGH_INDEX else 1.5
        array = dataclasses.replace(CAMERA.microlenses, model=model, index=index)
        plan = pl.plan(None, dataclasses.replace(CAMERA, microlenses=array))
        assert plan.runs(Stage.MICROLENS_PLATES) == (model >= pl.optics.MicrolensModel.FLAT_HIGH_INDEX), model
        assert "left out  aspheres" in repr(plan)


FLOOR = pl.quad((-50, -50, -404), (100, 0, 0), (0, 100, 0))
LAMP = pl.QuadLight((0, 30, -360), (20, 0, 0), (0, 12, -16), radiance=3.0)
POINT = pl.lights.PointLight((0, 30, -360), 100.0)
GREY_MAP = pl.Texture(np.full((2, 2, 1), 0.5))
PLACES = np.tile(np.eye(4), (3, 1, 1))
SCENE_STAGES = {stage for stage in Stage if Stage.INTERSECTION <= stage <= Stage.COLOUR}

PLAIN = {Stage.INTERSECTION, Stage.SCATTERING}
SEEN = {Stage.ONWARD_RAYS, Stage.RUSSIAN_ROULETTE}
LIT = PLAIN | SEEN | {Stage.EMISSION, Stage.DIRECT_LIGHT}


def running(scene, **options):
    plan = pl.plan(scene, CAMERA, **options)
    return {stage for stage in SCENE_STAGES if plan.runs(stage)}


def test_a_scene_runs_what_it_has():
    mapped = pl.EnvironmentMap(np.ones((1, 2, 1)))
    for scene, stages in (
        (None, set()),
        (pl.Scene(background=0.0), set()),
        (pl.Scene(background=1.0), {Stage.BACKGROUND}),
        (pl.Scene(background=mapped), {Stage.BACKGROUND}),
        (pl.Scene(lights=[pl.SunLight((0, 0, -1))]), {Stage.BACKGROUND}),
        (pl.Scene(lights=[POINT]), set()),
        (pl.Scene(lights=[LAMP]), {Stage.INTERSECTION, Stage.EMISSION}),
        (pl.Scene([FLOOR]), PLAIN),
        (pl.Scene([FLOOR], background=1.0), PLAIN | SEEN | {Stage.BACKGROUND}),
        (pl.Scene([FLOOR], [LAMP]), LIT),
        (pl.Scene([FLOOR], [POINT]), LIT - {Stage.EMISSION}),
        (pl.Scene([FLOOR], [pl.SunLight((0, 0, -1))]), LIT - {Stage.EMISSION} | {Stage.BACKGROUND}),
        (pl.Scene([FLOOR], background=mapped), LIT - {Stage.EMISSION} | {Stage.BACKGROUND}),
        (pl.Scene([FLOOR.with_material(pl.Lambertian(0.0))], [LAMP]), {Stage.INTERSECTION, Stage.EMISSION}),
        (pl.Scene([pl.scene.Instances(FLOOR, PLACES)], [LAMP]), LIT | {Stage.INSTANCES}),
        (pl.Scene([pl.sphere(4, center=(0, 0, -404))], [LAMP]), LIT | {Stage.VERTEX_NORMALS}),
    ):
        assert running(scene) == stages, scene
    for material, more in (
        (pl.materials.RoughDiffuse(), {Stage.MATERIALS}),
        (pl.Conductor(), {Stage.MATERIALS}),
        (pl.materials.ThinGlass(), {Stage.MATERIALS}),
        (pl.Dielectric(), {Stage.MATERIALS}),
        (pl.Dielectric(absorption=0.1), {Stage.MATERIALS, Stage.ABSORPTION}),
        (pl.Dielectric(medium=pl.materials.milk()), {Stage.MATERIALS, Stage.ABSORPTION, Stage.MEDIA, Stage.COLOUR}),
        (pl.MetallicRoughness(), {Stage.MATERIALS}),
        (pl.MetallicRoughness(opacity=0.5), {Stage.MATERIALS, Stage.OPACITY}),
        (pl.MetallicRoughness(opacity=GREY_MAP), {Stage.MATERIALS, Stage.OPACITY, Stage.TEXTURES}),
        (pl.Lambertian(GREY_MAP), {Stage.TEXTURES}),
        (pl.Lambertian((0.5, 0.5, 0.4)), {Stage.COLOUR}),
    ):
        assert running(pl.Scene([FLOOR.with_material(material)], [LAMP])) == LIT | more, material


def test_bounces_decide_what_follows_a_hit():
    always = {Stage.INTERSECTION, Stage.EMISSION, Stage.BACKGROUND}
    scattering, direct, next_rays = {Stage.SCATTERING}, {Stage.DIRECT_LIGHT}, {Stage.ONWARD_RAYS}
    scenes = pl.Scene([FLOOR], [LAMP]), pl.Scene([FLOOR], [POINT]), pl.Scene([FLOOR], background=1.0)
    for bounces, expected in (
        # Without bounces, only what emits is seen.
        (0, (set(), set(), set())),
        # A point light is never met: after the last light that is drawn no ray needs to go on.
        (1, (scattering | direct | next_rays, scattering | direct, scattering | next_rays)),
        (3, (LIT - {Stage.RUSSIAN_ROULETTE}, LIT - {Stage.RUSSIAN_ROULETTE}, PLAIN | next_rays)),
        (4, (LIT, LIT, PLAIN | SEEN)),
    ):
        for scene, stages in zip(scenes, expected, strict=True):
            assert running(scene, max_bounces=bounces) - always == stages - always, bounces


def test_a_plan_says_why():
    def reasons(scene):
        decisions = pl.plan(scene, CAMERA).decisions
        assert [decision.stage for decision in decisions] == list(Stage)
        return {decision.stage: decision.reason for decision in decisions}

    lit = reasons(pl.Scene([FLOOR], [LAMP]))
    assert lit[Stage.MATERIALS] == "all surfaces are Lambertian" and lit[Stage.RUSSIAN_ROULETTE] == "after 3 bounces"
    assert reasons(pl.Scene([FLOOR]))[Stage.EMISSION] == "nothing emits, and the image will be black"
    assert reasons(pl.Scene([pl.scene.Instances(FLOOR, PLACES)]))[Stage.INSTANCES] == "meshes stand at 3 places"


def test_after_warm_up_nothing_is_compiled():
    scene, camera = pl.check_scene(), dataclasses.replace(CAMERA, sensor=pl.Sensor(shape=(99, 99), pixel_pitch=0.01))
    pl.warm_up(scene, camera, depth=True, progress=False)
    before = list(compiling.names)
    again = pl.warm_up(scene, camera, depth=True, progress=False)
    assert again.kernels == () and again.seconds < 5.0 and "nothing" in repr(again)
    shot = pl.render(scene, camera, samples=4, truth=pl.Truth.ALL, progress=False)
    pl.render(scene, camera, target_error=0.5, samples=16, progress=False)
    white = pl.render_white(camera, samples=4, progress=False)
    pl.lightfield.render_view(shot, white, pl.lightfield.depth(shot, white))
    pl.ground_truth(scene, camera)
    camera.project([(0, 0, -404), (1, 2, -404)], scene)
    pl.point_spread(camera, (0, 0, -404), rays=64)
    pl.microlens_centres(camera)
    assert compiling.names == before


def test_warm_up_for_cameras_of_all_kinds_and_no_scene():
    sensor = pl.Sensor(shape=(48, 48), pixel_pitch=0.01)
    posed = dataclasses.replace(CAMERA, sensor=sensor).posed((0, 0, 100), (0, 0, 0))
    for camera in (posed, pl.PlenopticCamera(lens=CAMERA.lens, sensor=sensor, stop_to_microlenses=134.6)):
        pl.warm_up(None, camera, progress=False)
        assert pl.warm_up(None, camera, progress=False).kernels == ()
    # Views of a 1.0 camera, of which a sensor may show parts of two micro images alone.
    unfocused = pl.camera.example_camera(pl.CameraKind.PLENOPTIC_1, shape=(30, 48))
    pl.warm_up(pl.check_scene(), unfocused, depth=True, progress=False)
    with pytest.raises(pl.errors.InvalidValueError, match="scene is a PlenopticCamera"):
        pl.warm_up(CAMERA, CAMERA)
