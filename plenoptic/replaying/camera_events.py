"""What happens to a path in the camera, one value for each step; lengths in mm."""

from __future__ import annotations

from typing import TypeAlias

from plenoptic.core.rays import RayStatus
from plenoptic.core.values import Floats, value
from plenoptic.optics.record import ElementKind as ElementKind


@value
class SensorPoint:
    """Where a path starts.

    Parameters
    ----------
    pixel : (int, int)
        Row and column on the whole sensor.
    point : (3,) array
        On the pixel, in the camera's axes, mm.

    Examples
    --------
    See `replay`.
    """

    pixel: tuple[int, int]
    point: Floats


@value
class MicrolensPassage:
    """Through the plane of the microlenses; without microlenses, through the last vertex of the lens.

    Parameters
    ----------
    aim : (3,) array
        The point that was drawn on the array's rear principal plane, in the camera's axes, mm.
    microlens : (int, int) or None
        Lattice indices as in `GroundTruth.microlens`, in FREE lattices (number, 0). None without microlenses.
    type : int or None
        Row of the array's `focal_lengths`.
    status : RayStatus
        OK, or why the path ended here.
    point, direction : (3,) array or None
        The ray on its way to the lens, camera's axes, mm: on the last surface of the microlens, or its front principal
        plane. None where the path ended.
    weight : float
        Projected solid angle that the path stands for, in sr: the mean of it over all samples of a pixel is that from
        which light reaches the microlenses; times the response of the pixel and what dust lets pass.

    Examples
    --------
    See `replay`.
    """

    aim: Floats
    microlens: tuple[int, int] | None
    type: int | None
    status: RayStatus
    point: Floats | None
    direction: Floats | None
    weight: float


@value
class ElementPassage:
    """At one element of the lens, in the order in which light is followed back.

    Parameters
    ----------
    element : int
        Index in `camera.lens.elements`; of an ideal lens, that of the iris.
    kind : ElementKind
    status : RayStatus
        OK, or why the path ended here.
    point : (3,) array or None
        On the element, camera's axes, mm; also of a path that is clipped or totally reflected there. None where there
        is no such point.
    before, after : (3,) array or None
        Directions of the path; `after` is None where it ended.

    Examples
    --------
    See `replay`.
    """

    element: int
    kind: ElementKind
    status: RayStatus
    point: Floats | None
    before: Floats
    after: Floats | None


@value
class WorldRay:
    """The ray that leaves the camera.

    Parameters
    ----------
    origin : (3,) array
        In the world, mm.
    direction : (3,) array
        Towards the scene.
    weight : float
        What radiance from there is multiplied by, in sr: the projected solid angle of `MicrolensPassage`, times what
        masks and dust on the lens let pass.

    Examples
    --------
    See `replay`.
    """

    origin: Floats
    direction: Floats
    weight: float


CameraEvent: TypeAlias = SensorPoint | MicrolensPassage | ElementPassage | WorldRay
