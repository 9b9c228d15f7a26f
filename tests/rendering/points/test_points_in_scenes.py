"""Particles beside surfaces in renders: sums of both, hidden ones, regions, colours, sequences."""

import dataclasses
import subprocess
import sys
import time
import warnings

import numpy as np
import pytest
from camera_helpers import CAMERA, bare_camera

import plenoptic as pl
from plenoptic.rendering.points import particle_tracing, points_exposure

POINTS = pl.Points([(0.0, 0.0, -404.0), (1.5, 1.0, -400.0), (-2.0, 0.5, -410.0)], intensity=[1e-2, 2e-2, 3e-2])
BARE = bare_camera(shape=(64, 64), pitch=0.08)


def render(scene, camera=BARE, **options):
    return pl.render(scene, camera, **{"samples": 16, "progress": False} | options)


def test_the_image_is_the_sum_of_surfaces_and_particles():
    wall = pl.Scene([pl.quad((-50, -50, -450), (100, 0, 0), (0, 100, 0))], background=0.2)
    both, alone = render(dataclasses.replace(wall, points=POINTS)), render(wall)
    image, error = pl.rendering.point_weights(POINTS, BARE, scene=wall, progress=False).image()
    assert np.allclose(both.image, alone.image + image, rtol=1e-6, atol=0)
    assert np.allclose(both.standard_error, np.hypot(alone.standard_error, error), rtol=1e-6, atol=0)
    only = render(pl.Scene(points=POINTS))
    assert np.allclose(only.image, image, rtol=1e-6, atol=0) and only.image.any()
    assert np.allclose(only.standard_error, error, rtol=1e-6, atol=0)


def test_surfaces_hide_particles():
    """A screen before the upper half of the pupil's light halves the light of a particle; a closed one takes it."""
    free = pl.rendering.point_weights(POINTS, BARE, progress=False)
    screen = pl.Scene([pl.quad((-50, 0, -200), (100, 0, 0), (0, 50, 0))])
    half = pl.rendering.point_weights(POINTS, BARE, scene=screen, progress=False)
    # The first particle is on the axis, and the screen ends there.
    assert abs(half.light[0] / free.light[0] - 0.5) < 0.02
    closed = pl.Scene([pl.quad((-50, -50, -200), (100, 0, 0), (0, 100, 0))])
    assert not pl.rendering.point_weights(POINTS, BARE, scene=closed, progress=False).light.any()
    behind = pl.Scene([pl.quad((-50, -50, -500), (100, 0, 0), (0, 100, 0))])
    assert pl.rendering.point_weights(POINTS, BARE, scene=behind, progress=False) == free
    with pytest.warns(pl.errors.BlackImageWarning):
        render(pl.Scene(points=POINTS), region=np.s_[0:2, 0:2])


@pytest.mark.parametrize("opacity", [0.0, 0.3, 0.49, 0.51, 0.9])
def test_partly_transparent_surfaces_pass_their_part_of_the_light(opacity):
    """1 - opacity of it each, as of an emissive square in a render."""
    free = pl.rendering.point_weights(POINTS, BARE, rays=1024, progress=False)
    veils = [
        pl.quad((-50, -50, z), (100, 0, 0), (0, 100, 0), material=pl.materials.MetallicRoughness(opacity=opacity))
        for z in (-300, -200)
    ]
    for n in (1, 2):
        seen = pl.rendering.point_weights(POINTS, BARE, scene=pl.Scene(veils[:n]), rays=1024, progress=False)
        assert (seen.pixel == free.pixel).all() and np.allclose(
            seen.weight, (1 - opacity) ** n * free.weight, rtol=1e-6
        )


def test_glass_before_particles_is_named_once():
    pane = dataclasses.replace(pl.box(4, material=pl.Dielectric(1.5)).translated(0.0, 0.0, -300.0), name="pane")
    thin = pl.quad((-50, -50, -380), (100, 0, 0), (0, 100, 0), material=pl.materials.ThinGlass())
    thin = dataclasses.replace(thin, name="foil")
    wall = pl.quad((-50, -50, -480), (100, 0, 0), (0, 100, 0))
    scene = pl.Scene([wall, pane], background=0.1, points=POINTS)
    with pytest.warns(pl.errors.ImplausibleSceneWarning, match="3 of 3 particles .* hides them: pane;") as caught:
        render(scene)
    assert len(caught) == 1
    with pytest.warns(pl.errors.ImplausibleSceneWarning, match="foil;"):
        pl.rendering.point_weights(POINTS, BARE, scene=pl.Scene([wall, thin]), rays=64, progress=False)
    beside = pl.box(4, material=pl.Dielectric(1.5)).translated(60.0, 0.0, -300.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        pl.rendering.point_weights(POINTS, BARE, scene=pl.Scene([wall, beside]), rays=64, progress=False)


def test_particles_in_the_medium_around_glass_are_outside_of_it():
    ball = pl.sphere(10.0, material=pl.Dielectric(1.5)).translated(12.0, 0.0, -404.0)
    scene = pl.Scene([ball], medium=pl.materials.Medium(1e-3))
    corner = pl.Points([(4.0, -6.5, -396.0)], intensity=1.0)  # in the box around the ball
    assert pl.rendering.point_weights(corner, BARE, scene=scene, rays=64, progress=False).light[0] > 0
    with pytest.raises(pl.errors.SceneError, match="inside a body of glass"):
        inside = pl.Points([(12.0, 0.0, -404.0)], intensity=1.0)
        pl.rendering.point_weights(inside, BARE, scene=scene, progress=False)


def test_dark_particles_need_no_rays(monkeypatch):
    """Particles without light, and beyond the field, of which rays are not chosen either."""
    rng, traced = np.random.default_rng(3), []
    dark = rng.uniform((-2, -2, -420), (2, 2, -400), (3000, 3))
    beyond = rng.uniform((400, 0, -420), (420, 20, -400), (300, 3))
    positions = np.concatenate([dark, beyond, POINTS.positions])
    intensity = np.concatenate([np.zeros(3000), np.ones(300), POINTS.intensity])
    task = particle_tracing._trace_task
    monkeypatch.setattr(particle_tracing, "_trace_task", lambda scene, t: traced.append(t.number) or task(scene, t))
    shot = render(pl.Scene(points=pl.Points(positions, intensity=intensity)))
    assert min(map(min, traced)) >= 3000
    alone = pl.rendering.point_weights(POINTS, BARE, progress=False)
    light = shot.image.sum(dtype=float) * 0.08**2
    # As many rays as the lit particles need alone, though all pilots but them are dark; errors of both are 1 %.
    assert abs(light / (alone.light @ POINTS.intensity) - 1) < 0.05
    chosen = pl.rendering.point_weights(pl.Points(positions[3000:], intensity=1.0), BARE, progress=False)
    assert chosen.rays == alone.rays > 128
    # Without any light nothing is traced.
    traced.clear()
    with pytest.warns(pl.errors.BlackImageWarning):
        render(pl.Scene(points=pl.Points(dark, intensity=0.0)))
    assert not traced


def test_time_limits_hold_for_particles():
    """By fewer rays; surfaces get at least some samples, and a warning blames the particles."""
    rng = np.random.default_rng(4)
    points = pl.Points(rng.uniform((-2, -2, -420), (2, 2, -400), (2000, 3)), intensity=1e-3)
    camera = dataclasses.replace(BARE, sensor=pl.Sensor((64, 64), 0.08))
    render(pl.Scene(points=POINTS, background=0.1), camera)  # compilation
    free = render(pl.Scene(points=points), camera, target_error=2e-3, samples=4)
    short = render(pl.Scene(points=points), camera, target_error=2e-3, samples=None, time_limit=0.5)
    errors = [np.linalg.norm(s.standard_error) / np.linalg.norm(s.image) for s in (free, short)]
    assert errors[1] > 1.5 * errors[0] and abs(short.image.sum() / free.image.sum() - 1) < 0.02
    both = render(pl.Scene(points=points, background=0.1), camera, samples=None, time_limit=0.5)
    assert both.samples > 0 and np.isfinite(both.standard_error).all()


def test_surfaces_get_samples_after_slow_particles(monkeypatch):
    original = points_exposure.image_of_points

    def slow(*arguments):
        time.sleep(1.0)
        return original(*arguments)._replace(seconds=1.0)

    monkeypatch.setattr(points_exposure, "image_of_points", slow)
    scene = pl.Scene(points=POINTS, background=0.1)
    render(scene)
    with pytest.warns(pl.errors.BudgetWarning) as caught:
        shot = render(scene, samples=None, time_limit=0.2)
    assert shot.samples > 0 and (shot.image > 0).mean() > 0.9
    assert all("black" not in str(warning.message) for warning in caught)
    assert any("its particles took 1 s" in str(warning.message) for warning in caught)


def test_plans_and_estimates_know_particles():
    stage = pl.rendering.Stage.PARTICLES
    plan = pl.plan(pl.Scene(points=POINTS), BARE)
    assert plan.runs(stage) and "rays start at 3 particles" in repr(plan) and "will be black" not in repr(plan)
    assert not pl.plan(pl.Scene(background=0.1), BARE).runs(stage) and not pl.plan(None, BARE).runs(stage)
    positions = np.random.default_rng(1).uniform((-2, -2, -420), (2, 2, -400), (20000, 3))
    alone = [
        pl.estimate(pl.Scene(points=pl.Points(positions[:n], intensity=1.0)), BARE, samples=4, progress=False)
        for n in (500, 20000)
    ]
    # Pupils are shared, rays are not: forty times the particles, with margins for the clock.
    assert alone[0].seconds.low > 0 and alone[1].cpu_seconds.value > 3 * alone[0].cpu_seconds.value
    few, many = (
        pl.estimate(pl.Scene(points=points, background=0.1), BARE, samples=4, progress=False)
        for points in (None, pl.Points(positions, intensity=1.0))
    )
    assert many.cpu_seconds.value > few.cpu_seconds.value + 0.2 * alone[1].cpu_seconds.value
    few_points = pl.Scene(points=pl.Points(positions[:50], intensity=1.0))
    image, ghosts = (
        pl.estimate(few_points, BARE, samples=4, ghosts=ghosts, progress=False)
        for ghosts in (None, pl.rendering.Ghosts())
    )
    assert ghosts.cpu_seconds.value > 3 * image.cpu_seconds.value  # rays through each pair of surfaces
    for estimate in (*alone, many, ghosts):
        for number in (estimate.cpu_seconds, estimate.seconds, estimate.peak_memory):
            assert 0 < number.low <= number.value <= number.high


@pytest.mark.parametrize("scene", [pl.Scene(points=POINTS), pl.Scene(points=POINTS, background=0.1)])
def test_regions_and_threads_have_the_bits_of_the_whole(scene):
    whole = render(scene, threads=1)
    part = render(scene, threads=2, region=np.s_[16:40, 24:48])
    assert (part.image == whole.image[16:40, 24:48]).all()
    assert (part.standard_error == whole.standard_error[16:40, 24:48]).all()
    assert part.region == (16, 40, 24, 48) and whole.region is None


def test_exposures_of_two_seeds_are_merged():
    shots = [render(pl.Scene(points=POINTS), seed=seed) for seed in (0, 1)]
    both = pl.Exposure.merged(shots)
    mean = (shots[0].image.astype(float) + shots[1].image) / 2
    assert np.allclose(both.image, mean, rtol=1e-6) and both.replicates == 16
    assert (shots[0].image != shots[1].image).any()


def test_coloured_particles_before_a_grey_wall():
    red = dataclasses.replace(POINTS, intensity=np.outer(POINTS.intensity, [1.0, 0.0, 0.0]))
    shot = render(pl.Scene(points=red, background=0.1))
    wall = render(pl.Scene(background=0.1)).image
    assert shot.image.shape[2] == 3 and (shot.image[..., 1:] == wall).all() and (shot.image[..., :1] > wall).any()
    assert shot.standard_error.shape == shot.image.shape


def test_frames_of_a_sequence_have_their_particles():
    velocity, times = (100.0, 0.0, 0.0), [0.0, 0.002]
    frames = [POINTS.moved(velocity, time) for time in times]
    sequence = pl.Sequence(pl.Scene(points=POINTS), CAMERA, times, points=frames)
    assert [frame.scene.points for frame in sequence] == frames
    with pytest.raises(pl.errors.InvalidValueError, match="points for 1 frames of 2"):
        pl.Sequence(pl.Scene(points=POINTS), CAMERA, times, points=frames[:1])


def test_plans_and_truth_of_particles_alone_are_those_of_nothing():
    scene = pl.Scene(points=POINTS)
    assert "particles" in repr(scene) and pl.plan(scene, BARE) is not None
    with pytest.raises(pl.errors.InvalidValueError, match="leave out checkpoint"):
        render(scene, checkpoint="nowhere")


def test_renders_without_particles_load_none_of_their_code():
    code = (
        "import sys, numpy as np, plenoptic as pl; "
        "pl.render(pl.check_scene(), pl.camera.example_camera(), samples=2, region=np.s_[0:8, 0:8], progress=False); "
        "print([m for m in sys.modules if m.startswith('plenoptic.rendering.points') or m.startswith('scipy.sparse')])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "[]"
