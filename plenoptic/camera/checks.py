"""What is looked at, by which camera, on which part of its sensor: arguments, checked."""

from __future__ import annotations

from typing import TYPE_CHECKING

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.errors import InvalidValueError

if TYPE_CHECKING:
    from plenoptic.scene.scene import Scene


def check_scene_and_camera(scene: Scene | None, camera: PlenopticCamera) -> None:
    """Raise where they are something else."""
    if scene is not None:
        from plenoptic.scene.scene import Scene

        if not isinstance(scene, Scene):
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
        try:
            first, end, step = part.indices(length)
        except TypeError as error:
            raise InvalidValueError(f"region has {name} {part}; its bounds must be whole numbers") from error
        if step != 1 or end <= first:
            raise InvalidValueError(
                f"region has {name} {part}; of the sensor's {length} {name} it must take at least one, with step 1"
            )
        bounds += [first, end]
    return bounds[0], bounds[1], bounds[2], bounds[3]
