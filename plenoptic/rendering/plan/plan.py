"""Plan of a render: the stages that run, those left out, and the reasons. Nothing else decides on stages."""

from __future__ import annotations

from typing import TYPE_CHECKING

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.checks import check_scene_and_camera
from plenoptic.core.values import whole
from plenoptic.optics.lens.ghosts.ghost_settings import Ghosts
from plenoptic.rendering.plan.camera_stages import camera_decisions
from plenoptic.rendering.plan.rare_light import rare_light
from plenoptic.rendering.plan.scene_stages import WHITE, scene_decisions
from plenoptic.rendering.plan.shutter import open_shutter
from plenoptic.rendering.plan.stages import Plan, Stage, Subject, decide
from plenoptic.rendering.settings import Caustics, RenderSettings, Sampler
from plenoptic.truth.channels import Truth, truth_names
from plenoptic.truth.truth_arrays import available_truth, valid_truth

if TYPE_CHECKING:
    from plenoptic.scene.scene import Scene
    from plenoptic.scene.scene_record import SceneRecord


def plan(  # noqa: PLR0913
    scene: Scene | None,
    camera: PlenopticCamera,
    *,
    samples: int = 64,
    replicates: int = 2,
    max_bounces: int = 8,
    truth: Truth = Truth.DEPTH,
    caustics: Caustics = Caustics.INCLUDE,
    clamp: float | None = None,
    sampler: Sampler = Sampler.SOBOL,
    ghosts: Ghosts | None = None,
) -> Plan:
    """Stages that `render` would run for a scene and a camera, those it would leave out, and the reasons.

    Parameters
    ----------
    scene : Scene or None
        None: a white image.
    camera : PlenopticCamera
    samples, replicates, max_bounces, truth, caustics, clamp, sampler, ghosts
        As for `render`.

    Returns
    -------
    Plan
        Decisions on all stages; its `subject` contains the arguments, so that `study.cost_of` can render it.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.camera.example_camera(pl.CameraKind.CONVENTIONAL, shape=(16, 16))
    >>> print(pl.plan(None, camera))          # doctest: +ELLIPSIS
    left out  independent samples    scrambled Sobol points
    left out  wavelengths            everything at 587.6 nm
    left out  pixel response         pixels see all directions alike
    left out  turned pixels          their sides are along x and y
    left out  blemishes              no dust and no scratches
    left out  diffraction            paths are straight between surfaces
    runs      aperture regions       each point of a pixel sees the openings of the lens
    runs      unvignetted core       unvignetted light is not traced
    ...
    """
    check_scene_and_camera(scene, camera)
    settings = RenderSettings(max_bounces, caustics, clamp, sampler, ghosts)
    paths, independent = whole(samples, "samples", at_least=1), whole(replicates, "replicates", at_least=1)
    return plan_for(Subject(scene, camera, paths, independent, valid_truth(truth), settings))


def plan_for(subject: Subject) -> Plan:
    """Plan of a subject, such as the modified subject of another plan."""
    prepared = subject.prepared
    return plan_stages(None if prepared is None else prepared.record, subject)


def plan_stages(record: SceneRecord | None, subject: Subject) -> Plan:
    """Plan of a subject whose scene is compiled to a record; see `plan_for`."""
    camera, settings, meshes = subject.camera, subject.settings, record is not None and record.geometry is not None
    requested, independent = valid_truth(subject.truth), min(subject.samples, subject.replicates)
    available = available_truth(requested, meshes=meshes, microlenses=camera.microlenses is not None)
    replicated = f"{independent} independent replicate{'s' * (independent != 1)}"
    exclude_caustics, clamp = settings.caustics is Caustics.EXCLUDE, settings.clamp
    points, independent_samples = "scrambled Sobol points", "every sample by itself"
    rare = rare_light(subject.scene, settings)
    n_particles = 0 if subject.scene is None or subject.scene.points is None else len(subject.scene.points)
    all_light, unclamped = "caustics are included", "radiance is not limited"
    return Plan(
        (
            decide(Stage.INDEPENDENT_SAMPLES, settings.sampler is Sampler.RANDOM, points, independent_samples),
            *camera_decisions(camera, white=subject.scene is None),
            decide(
                Stage.SHUTTER,
                *(record, WHITE),
                *(camera.shutter is not None, "an exposure is an instant"),
                *(open_shutter(camera, record), "nothing moves while it is open"),
                "motion while it is open is blurred",
            ),
            *scene_decisions(record, settings.max_bounces, n_particles),
            decide(Stage.CAUSTICS_APART, record, WHITE, exclude_caustics, all_light, "caustics are left out"),
            decide(Stage.CLAMPING, record, WHITE, clamp is not None, unclamped, f"radiance above {clamp}"),
            decide(
                Stage.TRUTH,
                *(requested, "not asked for"),
                *(meshes or available, "there is no mesh"),
                *(available, "there are no microlenses"),
                truth_names(available),
            ),
            decide(Stage.STANDARD_ERROR, independent >= 2, replicated, replicated),
            decide(
                Stage.RARE_LIGHT,
                *(record, WHITE),
                *(rare, "no small light is met by chance by way of mirrors or glass"),
                "" if rare is None else f"one ray in {rare.rays:.2g} meets {rare.light} by way of {rare.mesh}",
            ),
            decide(
                Stage.PARTICLES,
                *(record, WHITE),
                *(n_particles, "the scene has none"),
                f"rays start at {n_particles} particle{'s' * (n_particles != 1)}",
            ),
            decide(
                Stage.GHOSTS,
                *(record, WHITE),
                *(settings.ghosts, "light that surfaces of the lens reflect is left out"),
                "light of two reflections in the lens is added, by paths of its own",
            ),
        ),
        subject,
    )
