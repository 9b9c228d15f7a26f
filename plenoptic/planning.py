"""Which stages a rendering needs, which are left out, and why. `rendering` asks the plan; nothing else decides."""

from __future__ import annotations

from plenoptic._values import whole
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.truth import Truth, available_truth, checked_truth, truth_names
from plenoptic.camera_stages import camera_decisions
from plenoptic.errors import InvalidValueError
from plenoptic.scene.scene import Scene
from plenoptic.scene.tables import SceneTables
from plenoptic.scene_stages import scene_decisions
from plenoptic.stages import Decision, Plan, Stage, first_reason


def plan(
    scene: Scene | None,
    camera: PlenopticCamera,
    *,
    samples: int = 64,
    replicates: int = 8,
    max_bounces: int = 8,
    truth: Truth = Truth.DEPTH,
) -> Plan:
    """What `render` would run for a scene and a camera, what it would leave out, and why.

    Parameters
    ----------
    scene : Scene or None
        None: a white image.
    camera : PlenopticCamera
    samples, replicates, max_bounces, truth
        As for `render`.

    Returns
    -------
    Plan

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.PlenopticCamera(lens=pl.load_lens("double-gauss-100mm-f2"),
    ...     sensor=pl.Sensor(shape=(16, 16), pixel_pitch=0.01), stop_to_microlenses=130.0)
    >>> print(pl.plan(None, camera))          # doctest: +ELLIPSIS
    left out  wavelengths            everything at 587.6 nm
    left out  pixel response         pixels see all directions alike
    left out  blemishes              no dust and no scratches
    ...
    """
    check_arguments(scene, camera, samples=samples, replicates=replicates, max_bounces=max_bounces)
    tables = None if scene is None else scene.tables()
    return plan_stages(tables, camera, samples=samples, replicates=replicates, max_bounces=max_bounces, truth=truth)


def check_arguments(
    scene: Scene | None, camera: PlenopticCamera, *, samples: int, replicates: int, max_bounces: int
) -> None:
    """Raise where a rendering with these arguments is impossible."""
    check_scene_and_camera(scene, camera)
    whole(samples, "samples", at_least=1)
    whole(replicates, "replicates", at_least=1)
    whole(max_bounces, "max_bounces", at_least=0)


def check_scene_and_camera(scene: Scene | None, camera: PlenopticCamera) -> None:
    """Raise where they are something else."""
    if scene is not None and not isinstance(scene, Scene):
        raise InvalidValueError(f"scene is a {type(scene).__name__}; it must be a Scene")
    if not isinstance(camera, PlenopticCamera):
        raise InvalidValueError(f"camera is a {type(camera).__name__}; it must be a PlenopticCamera")


def sensor_region(shape: tuple[int, int], region: tuple[slice, slice] | None) -> tuple[int, int, int, int]:
    """First and end row, first and end column of a region given as slices."""
    if region is None:
        return 0, shape[0], 0, shape[1]
    if not (isinstance(region, tuple) and len(region) == 2 and all(isinstance(part, slice) for part in region)):
        raise InvalidValueError(f"region is {region!r}; it must be two slices, such as np.s_[0:64, 0:64]")
    bounds: list[int] = []
    for part, length, name in zip(region, shape, ("rows", "columns"), strict=True):
        first, end, step = part.indices(length)
        if step != 1 or end <= first:
            raise InvalidValueError(
                f"region has {name} {part}; of the sensor's {length} {name} it must take at least one, with step 1"
            )
        bounds += [first, end]
    return bounds[0], bounds[1], bounds[2], bounds[3]


def plan_stages(
    tables: SceneTables | None,
    camera: PlenopticCamera,
    *,
    samples: int,
    replicates: int,
    max_bounces: int,
    truth: Truth,
) -> Plan:
    """`plan` for a scene that is compiled already."""
    decisions = [*camera_decisions(camera), *scene_decisions(tables, max_bounces)]
    meshes = tables is not None and tables.triangles is not None
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
