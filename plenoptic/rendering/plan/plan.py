"""Which stages a rendering needs, which are left out, and why. `rendering` asks the plan; nothing else decides."""

from __future__ import annotations

import dataclasses

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.checks import check_scene_and_camera
from plenoptic.core.values import whole
from plenoptic.rendering.plan.camera_stages import camera_decisions
from plenoptic.rendering.plan.scene_stages import scene_decisions
from plenoptic.rendering.plan.stages import Decision, Plan, Stage, Subject, first_reason
from plenoptic.rendering.settings import Caustics, RenderSettings, Sampler
from plenoptic.scene.cache import prepared_scene
from plenoptic.scene.compile import SceneRecord
from plenoptic.scene.scene import Scene
from plenoptic.truth.arrays import available_truth, checked_truth
from plenoptic.truth.channels import Truth, truth_names


def plan(  # noqa: PLR0913
    scene: Scene | None,
    camera: PlenopticCamera,
    *,
    samples: int = 64,
    replicates: int = 8,
    max_bounces: int = 8,
    truth: Truth = Truth.DEPTH,
    caustics: Caustics = Caustics.KEPT,
    clamp: float | None = None,
    sampler: Sampler = Sampler.SOBOL,
) -> Plan:
    """What `render` would run for a scene and a camera, what it would leave out, and why.

    Parameters
    ----------
    scene : Scene or None
        None: a white image.
    camera : PlenopticCamera
    samples, replicates, max_bounces, truth, caustics, clamp, sampler
        As for `render`.

    Returns
    -------
    Plan
        With the arguments as its `subject`, so that `study.cost_of` can render it.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.PlenopticCamera(lens=pl.load_lens("double-gauss-100mm-f2"),
    ...     sensor=pl.Sensor(shape=(16, 16), pixel_pitch=0.01), stop_to_microlenses=130.0)
    >>> print(pl.plan(None, camera))          # doctest: +ELLIPSIS
    left out  independent samples    scrambled Sobol points
    left out  wavelengths            everything at 587.6 nm
    left out  pixel response         pixels see all directions alike
    left out  turned pixels          their sides are along x and y
    left out  blemishes              no dust and no scratches
    ...
    """
    check_arguments(scene, camera, samples=samples, replicates=replicates, max_bounces=max_bounces)
    settings = RenderSettings(max_bounces, caustics, clamp, sampler)
    subject = Subject(scene, camera, int(samples), int(replicates), checked_truth(truth), settings)
    return plan_for(subject)


def plan_for(subject: Subject) -> Plan:
    """The plan for what another one was made for, changed or not."""
    scene = subject.scene
    decided = plan_stages(
        None if scene is None else prepared_scene(scene).record,
        subject.camera,
        subject.settings,
        samples=subject.samples,
        replicates=subject.replicates,
        truth=subject.truth,
    )
    return dataclasses.replace(decided, subject=subject)


def check_arguments(
    scene: Scene | None, camera: PlenopticCamera, *, samples: int, replicates: int, max_bounces: int
) -> None:
    """Raise where a rendering with these arguments is impossible."""
    check_scene_and_camera(scene, camera)
    whole(samples, "samples", at_least=1)
    whole(replicates, "replicates", at_least=1)
    whole(max_bounces, "max_bounces", at_least=0)


def plan_stages(
    record: SceneRecord | None,
    camera: PlenopticCamera,
    how: RenderSettings,
    *,
    samples: int,
    replicates: int,
    truth: Truth,
) -> Plan:
    """`plan` for a scene that is compiled already."""
    random = how.sampler is Sampler.RANDOM
    decisions = [
        Decision(Stage.INDEPENDENT_SAMPLES, random, "every sample by itself" if random else "scrambled Sobol points"),
        *camera_decisions(camera),
        *scene_decisions(record, how.max_bounces),
        *_light_decisions(record is not None, how.caustics, how.clamp),
    ]
    meshes = record is not None and record.geometry is not None
    asked = checked_truth(truth)
    found = available_truth(asked, meshes=meshes, microlenses=camera.microlenses is not None)
    why = first_reason(
        asked, "not asked for", meshes or found, "there is no mesh", found, "there are no microlenses", ""
    )
    decisions.append(Decision(Stage.TRUTH, bool(found), truth_names(found) or why))
    independent = min(samples, replicates)
    decisions.append(
        Decision(
            Stage.STANDARD_ERROR, independent >= 2, f"{independent} independent replicate{'s' * (independent != 1)}"
        )
    )
    return Plan(tuple(decisions))


def _light_decisions(scene: bool, caustics: Caustics, clamp: float | None) -> list[Decision]:
    """Whether some light is taken away."""
    white, apart = "a white image has no scene", caustics is Caustics.LEFT_OUT
    return [
        Decision(
            Stage.CAUSTICS_APART,
            scene and apart,
            first_reason(scene, white, apart, "caustics count as all light does", "caustics are left out"),
        ),
        Decision(
            Stage.CLAMPING,
            scene and clamp is not None,
            first_reason(scene, white, clamp is not None, "paths bring what they bring", f"radiance above {clamp}"),
        ),
    ]
