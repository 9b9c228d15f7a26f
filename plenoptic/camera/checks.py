"""Checks of the arguments scene, camera and region."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.core.values import whole
from plenoptic.errors import InvalidValueError

if TYPE_CHECKING:
    from plenoptic.scene.scene import Scene

BLOCK = 8
"""Rows and columns of a block of pixels, over which the errors of few replicates are pooled."""


def check_scene_and_camera(scene: Scene | None, camera: PlenopticCamera) -> None:
    """Raise an InvalidValueError unless the arguments are a scene (or None) and a camera."""
    if scene is not None:
        from plenoptic.scene.scene import Scene

        if not isinstance(scene, Scene):
            raise InvalidValueError(f"scene is a {type(scene).__name__}; it must be a Scene")
    if not isinstance(camera, PlenopticCamera):
        raise InvalidValueError(f"camera is a {type(camera).__name__}; it must be a PlenopticCamera")


def sensor_region(shape: tuple[int, int], region: tuple[slice, slice] | None) -> tuple[int, int, int, int]:
    """First and end row, first and end column of a region, which is two slices; of the whole sensor for None."""
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


def sensor_tiles(shape: tuple[int, int], rows: int, columns: int) -> tuple[tuple[slice, slice], ...]:
    """Divide a sensor into regions between blocks of pixels; see `PlenopticCamera.tiles`."""
    cuts = []
    for length, name, n in zip(shape, ("rows", "columns"), (rows, columns), strict=True):
        blocks = -(-length // BLOCK)
        parts = whole(n, name, at_least=1)
        if parts > blocks:
            raise InvalidValueError(
                f"{name} is {parts}; the sensor has {length} {name} of pixels, in {blocks} blocks of {BLOCK} that are "
                f"not cut: give at most {blocks}"
            )
        ends = [min(blocks * i // parts * BLOCK, length) for i in range(parts + 1)]
        cuts.append([slice(first, end) for first, end in pairwise(ends)])
    return tuple((row, column) for row in cuts[0] for column in cuts[1])
