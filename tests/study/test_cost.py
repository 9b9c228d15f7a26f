"""What parts of a rendering cost: bookkeeping with known costs, and what is left out."""

import csv
import dataclasses
import itertools
import math
from types import SimpleNamespace

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.camera.shutter import Shutter
from plenoptic.command.main import main
from plenoptic.rendering.plan.stages import Plan, Stage
from plenoptic.rendering.settings import Caustics
from plenoptic.study.cost import ablation, camera_ablation, cost_study, scene_ablation
from plenoptic.study.cost.ablation import Ablation, Inseparable, ablations
from plenoptic.study.cost.cost_cases import COST_CASES
from plenoptic.study.cost.cost_study import Picture, cost_of, picture_change, share_of

CROP = np.s_[252:260, 252:260]

MURKY = pl.materials.Medium(absorption=(0.2, 0.1, 0.1), scattering=0.1)


def furnished_camera():
    """The reference camera with every part that a camera can have, posed."""
    plain = pl.camera.example_camera()
    array = dataclasses.replace(
        plain.microlenses, focal_lengths=(1.9, 2.0, 2.1), model=pl.optics.MicrolensModel.SPHERICAL,
        coating=pl.optics.SingleLayer(),
        aperture=pl.optics.MicrolensAperture(pl.optics.ApertureShape.CIRCLE, 0.85),
        imperfections=pl.MicrolensImperfections(pitch_jitter=0.001), walls=pl.optics.Walls.OPAQUE,
    )  # fmt: skip
    response = pl.sensor.AngularResponse(well_depth=0.5, pupil_distance=130.0)
    sensor = pl.Sensor((128, 128), plain.sensor.pixel_pitch, angular_response=response)
    half_size = (0.5 * sensor.size[0], 0.5 * sensor.size[1])
    dust = pl.Blemishes.scattered(pl.BlemishSite.SENSOR, half_size=half_size, dust_per_mm2=4.0)
    first, *following = plain.lens.elements
    lens = dataclasses.replace(
        plain.lens,
        elements=[dataclasses.replace(first, aspheric=(0.0, 1e-9), coating=pl.optics.SingleLayer()), *following],
    ).with_stop(pl.PolygonStop(blades=6, semi_diameter=5.0))
    camera = dataclasses.replace(
        plain, lens=lens.moved(3, shift=(0.02, 0.0, 0.0)), microlenses=array, sensor=sensor,
        sensitivity=pl.sensitivities.colour_camera(), blemishes=(dust,),
    )  # fmt: skip
    tilt = math.radians(0.2)
    for part, move in (
        (pl.CameraPart.SENSOR, {"tilt": (tilt, 0.0, tilt)}),
        (pl.CameraPart.MICROLENSES, {"tilt": (0.0, tilt, 0.0)}),
        (pl.CameraPart.LENS, {"shift": (0.05, 0.0, 0.0)}),
    ):
        camera = camera.moved(part, **move)
    return camera.posed(position=(30.0, 20.0, 10.0), look_at=(-200.0, 0.0, -400.0))


def furnished_scene(camera):
    """A still life with every part that a scene can have, in front of a posed camera."""
    rng, base = np.random.default_rng(0), pl.still_life()
    transforms = np.tile(np.eye(4), (6, 1, 1))
    transforms[:, :3, 3] = [(x, y, -400.0) for x in (-1.0, 0.0, 1.0) for y in (1.0, 2.0)]
    normals = np.full((8, 8, 3), (0.5, 0.5, 1.0)) + rng.uniform(-0.1, 0.0, (8, 8, 3))
    curtain = pl.MetallicRoughness(
        pl.Texture(rng.uniform(0.3, 0.9, (8, 8, 3))), normal_map=pl.Texture(normals),
        opacity=pl.Texture(rng.uniform(0.0, 0.5, (8, 8, 1))),
    )  # fmt: skip
    meshes = [
        *base.meshes,
        pl.quad((-3, -3, -390), (6, 0, 0), (0, 6, 0), material=curtain),
        pl.quad((-7, -3, -390), (3, 0, 0), (0, 6, 0), material=pl.materials.ThinGlass(transmittance=(0.8, 0.9, 0.9))),
        pl.sphere(1.0, center=(2.0, 2.5, -398.0), material=pl.Dielectric(1.5, medium=MURKY)),
        pl.box(0.6, center=(-2.0, 2.5, -398.0), material=pl.Emissive(2.0)),
        pl.scene.Instances(pl.box(0.4), transforms),
    ]
    lights = [*base.lights, pl.lights.PointLight((30, 40, -360), 2e3), pl.SunLight((0.2, -1.0, -1.0), 0.5)]
    sky = pl.EnvironmentMap(rng.uniform(0.1, 0.6, (4, 8, 3)))
    to_world = np.column_stack([camera.pose.rotation, camera.pose.position])
    return pl.Scene(meshes, lights, sky).transformed(np.vstack([to_world, [0, 0, 0, 1]]))


@pytest.fixture(scope="module")
def furnished():
    shake = pl.Motion.screw((-1.0, 1.0), axis=(1.0, 2.0, 3.0), angle_deg=0.1, advance=0.5)
    camera = dataclasses.replace(furnished_camera(), shutter=Shutter(0.02, row_time=1e-5, motion=shake))
    settings = {"caustics": Caustics.EXCLUDE, "clamp": 100.0, "sampler": pl.rendering.Sampler.RANDOM}
    return pl.plan(furnished_scene(camera), camera, truth=pl.Truth.ALL, **settings)


NOT_FURNISHED = {Stage.DIFFRACTION, Stage.UNVIGNETTED_CORE, Stage.RARE_LIGHT, Stage.GHOSTS, Stage.PARTICLES}


def test_each_stage_can_be_left_out_and_then_does_not_run(furnished):
    # The furnished case runs all but the one that white images alone have, and light that would bend at walls.
    assert {decision.stage for decision in furnished.decisions if not decision.runs} == NOT_FURNISHED
    white = COST_CASES["white"]().subject
    bent = dataclasses.replace(white, camera=dataclasses.replace(white.camera, diffraction=pl.Diffraction()))
    here = list(ablations(furnished))
    with_caustics = dataclasses.replace(
        furnished.subject, settings=dataclasses.replace(furnished.subject.settings, caustics=Caustics.INCLUDE)
    )
    found = [*ablations(ablation.plan_for(bent)), *ablations(ablation.plan_for(with_caustics)), *here]
    assert {one.stage for one in found} == set(Stage) - {Stage.GHOSTS, Stage.PARTICLES}
    assert {one.stage for one in found if isinstance(one, Inseparable)} == {Stage.APERTURE_REGIONS}
    apart = [one for one in here if isinstance(one, Ablation)]
    assert sum(not one.also for one in apart) >= 25  # most alone
    for one in apart:
        then = ablation.plan_for(one.subject)
        stopped = {d.stage for d in then.decisions if not d.runs}
        if one.stage not in (Stage.LENS, Stage.ONWARD_RAYS, Stage.CAUSTICS_APART):
            assert stopped == {one.stage, *one.also, *NOT_FURNISHED}, one.stage


def test_nothing_is_listed_that_does_not_run():
    for case in COST_CASES:
        plan = COST_CASES[case]()
        assert {one.stage for one in ablations(plan)} == {d.stage for d in plan.decisions if d.runs}, case


def kept(camera, scene=None):
    return {one.stage: one.reason for one in ablations(pl.plan(scene, camera)) if isinstance(one, Inseparable)}


def test_what_cannot_be_left_out_says_why(monkeypatch):
    camera = pl.camera.example_camera()
    thin = dataclasses.replace(camera, lens=camera.lens.with_model(pl.LensModel.THIN))
    assert "rays must pass" in kept(thin)[Stage.LENS]
    centres = camera.microlenses.lenses((-3.0, -3.0), (3.0, 3.0)).centre
    free = pl.MicrolensArray(pitch=0.3, focal_lengths=(2.0,), lattice=pl.Lattice.FREE, centres=centres)
    assert "centres" in kept(dataclasses.replace(camera, microlenses=free))[Stage.LISTED_LENSES]
    monkeypatch.setattr(scene_ablation, "MOST_COPIES", 20)
    many = pl.Scene([pl.scene.Instances(pl.box(1), np.tile(np.eye(4), (2, 1, 1)))], background=1.0)
    assert "24 triangles" in kept(camera, many)[Stage.INSTANCES]


def test_spheres_touch_aspheres_at_their_vertices():
    first = pl.Surface(50.0, 5.0, semi_diameter=10.0, conic=-0.7, aspheric=(1e-3, 1e-6))
    camera = pl.camera.example_camera()
    lens = dataclasses.replace(camera.lens, elements=[first, *camera.lens.elements[1:]])
    sphere = camera_ablation.without_aspheres(dataclasses.replace(camera, lens=lens)).lens.elements[0]
    # Sags differ in r^4 only: at r = 0.1 by less than (c^3 + a) r^4 = 1e-5 * 1e-4 mm.
    assert abs(float(sphere.sag(0.1) - first.sag(0.1))) < 1e-9 and not sphere.aspheric and sphere.conic == 0


def test_the_mean_of_a_world_weighs_rows_by_their_solid_angle():
    texels = np.zeros((4, 2, 3))
    texels[0] = 1.0  # down to 45 degrees from the top: (1 - cos 45) / 2 of the sphere
    world = scene_ablation.without_lights(pl.Scene(background=pl.EnvironmentMap(texels))).background
    assert world.radiance == pytest.approx(3 * ((1 - math.sqrt(0.5)) / 2,), rel=1e-6)
    dark = scene_ablation.without_world(pl.Scene(background=1.0))
    assert dark.background.radiance == 0.0 and not dark.meshes


@pytest.mark.slow
def test_without_its_pose_a_camera_sees_the_same():
    camera = pl.camera.example_camera().posed(position=(10.0, 20.0, 30.0), look_at=(-300.0, 50.0, -200.0))
    world = np.eye(4)
    world[:3, :3], world[:3, 3] = camera.pose.rotation, camera.pose.position
    plan = pl.plan(pl.check_scene().transformed(world), camera)
    (one,) = [found for found in ablations(plan) if found.stage is Stage.POSE]
    shots = [
        pl.render(subject.scene, subject.camera, samples=16, region=CROP, truth=pl.Truth.NONE, progress=False)
        for subject in (plan.subject, one.subject)
    ]
    # Rounding of some 1e-13 mm moves a path across the edge of a square in 1e-10 of the cases.
    np.testing.assert_allclose(shots[0].image, shots[1].image, rtol=1e-6)


SET_UP, PER_PATH = 0.3, 1e-6
PARTS = {Stage.LENS: 0.4, Stage.STANDARD_ERROR: 0.1, Stage.POSE: 0.25, Stage.BLEMISHES: 0.05}
"""What stages take of the whole, in a rendering that is made up."""


@pytest.fixture
def made_up(monkeypatch):
    """Renderings of known costs: set-up, and what each stage takes; blemishes darken the picture by a tenth."""
    camera = furnished_camera()
    blemishes, pose = camera.blemishes, camera.pose
    plan = pl.plan(None, dataclasses.replace(pl.camera.example_camera(), blemishes=blemishes, pose=pose))
    drift = itertools.count()

    def exposed(subject, run, number):
        found = ablation.plan_for(subject)
        runs = {stage: found.runs(stage) for stage in PARTS}
        runs[Stage.LENS] = subject.camera.lens.model is pl.LensModel.EXACT
        paths = 100_000 if run.samples > 1 else 1
        share = 0.2 + sum(part for stage, part in PARTS.items() if runs[stage])
        # All gets dearer as time goes on, as when a processor gets hot.
        per_path = PER_PATH * share * (1 + 1e-4 * next(drift))
        rng = np.random.default_rng(number)
        level = 0.9 if runs[Stage.BLEMISHES] else 1.0
        image = level + 0.05 * rng.standard_normal((40, 40, 1))
        stats = SimpleNamespace(cpu_seconds=SET_UP + paths * per_path, paths=paths)
        return SimpleNamespace(image=image.astype(np.float32), stats=stats, interrupted=False)

    monkeypatch.setattr(cost_study, "_exposure", exposed)
    return plan


def test_known_costs_are_found(made_up):
    table = cost_of(made_up, rounds=5)
    rows = {row.stage: row for row in table.rows}
    # The whole is dearer by the drift of a few per cent.
    assert float(table.notes[0].split("paths, ")[1].split()[0]) == pytest.approx(1.0, rel=0.03)
    assert f"beside {SET_UP} s of set-up" in table.notes[0] and "aperture regions" in table.notes[1]
    for stage, part in PARTS.items():
        # Neighbours in time differ by 1e-4 of the whole, set-up by 1e-6 of a second in 0.1.
        assert rows[stage].percent == pytest.approx(100 * part, abs=0.05)
        assert rows[stage].standard_error < 0.05 and abs(rows[stage].set_up) < 1e-4
    assert table.rows[0].stage is Stage.LENS
    # Without dust the picture is brighter by 0.1 / 0.9; the noise of the square is 3 sqrt(2) 0.05^2 / 40 / sqrt(5).
    assert rows[Stage.BLEMISHES].picture_change == pytest.approx(100 / 9, rel=0.05)
    assert rows[Stage.POSE].picture_change == 0.0


def test_a_share_is_the_median_of_ratios_in_the_same_round():
    beside = np.array([1.0, 2.0, 4.0, 8.0, 100.0])
    share, error = share_of(beside * [0.8, 0.7, 0.75, 0.7, 0.9], beside)
    assert share == pytest.approx(25.0)
    # |25 - (20, 30, 25, 30, 10)| has the median 5.
    assert error == pytest.approx(math.sqrt(math.pi / 10) * 1.4826 * 5.0)
    assert share_of(np.ones(2), np.ones(2)) == (0.0, None)
    # A black picture has no relative change.
    pictures = [Picture(), Picture()]
    for picture in pictures:
        for _ in range(3):
            picture.add(np.zeros((2, 2, 3), np.float32))
    assert picture_change(*pictures) is None


def test_impossible_measurements_are_refused():
    plan = pl.plan(None, pl.camera.example_camera())
    for given, options, said in (
        (plan, {"rounds": 1}, "rounds is 1"),
        (plan, {"samples": 0}, "samples is 0"),
        (Plan(plan.decisions), {}, "make it by pl.plan"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=said):
            cost_of(given, **options)


def test_a_table_is_text_markdown_and_csv(made_up, tmp_path):
    table = cost_of(made_up, rounds=3)
    lines = table.to_markdown().splitlines()
    assert lines[0].startswith("| stage") and lines[2].startswith("| lens ")
    assert {line.count("|") for line in lines[: 2 + len(table.rows)]} == {lines[0].count("|")}
    assert "100000" not in str(table) and repr(table) == "<StudyTable: 5 rows>"
    text = table.to_csv(tmp_path / "costs.csv")
    assert (tmp_path / "costs.csv").read_text(encoding="utf-8") == text
    numbers = [(Stage[line["stage"]], float(line["percent"])) for line in csv.DictReader(text.splitlines())]
    assert numbers == [(row.stage, row.percent) for row in table.rows]


def test_an_interrupted_study_keeps_the_stages_it_has(made_up, monkeypatch):
    original, calls = cost_study._exposure, itertools.count(1)
    whole = cost_of(made_up, rounds=3)

    def interrupted(*arguments):
        if next(calls) == 40:  # each stage takes 2 (1 + 2 * 3) + 1 renders
            raise KeyboardInterrupt
        return original(*arguments)

    monkeypatch.setattr(cost_study, "_exposure", interrupted)
    table = cost_of(made_up, rounds=3)
    assert table.interrupted and not whole.interrupted and (len(table.rows), len(whole.rows)) == (2, 5)
    assert {row.stage for row in table.rows} == set(sorted(row.stage for row in whole.rows)[:2])
    assert str(table).endswith("Interrupted: further rows were asked for.")


@pytest.mark.slow
def test_the_command_line_prints_the_plan_and_the_table(capsys, tmp_path):
    chosen = ["cost", "--case", "white", "--quick", "--plan", "--markdown", "--csv", str(tmp_path / "white.csv")]
    assert main(["study", *chosen]) == 0
    shown = capsys.readouterr().out
    assert "left out  wavelengths" in shown and "| microlenses" in shown
    assert "MICROLENSES" in (tmp_path / "white.csv").read_text(encoding="utf-8")
