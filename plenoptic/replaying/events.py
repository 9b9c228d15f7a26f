"""Events of a path, one value for each step; lengths in mm.

c is 1 for a path with a wavelength or in a grey scene, otherwise 3. Events in the camera are in its axes, others in the
world.
"""

from __future__ import annotations

import enum
from typing import TypeAlias

from plenoptic.core.rays import RayStatus
from plenoptic.core.values import Floats, result
from plenoptic.optics.element_record import ElementKind
from plenoptic.scene.materials.registry import Material


@result
class SensorPoint:
    """Start of a path on the sensor."""

    pixel: tuple[int, int]
    """Row and column on the whole sensor."""
    point: Floats
    """(3,): on the pixel."""


@result
class MicrolensPassage:
    """Passage through the plane of the microlenses; without microlenses, through the last vertex of the lens."""

    aim: Floats
    """(3,): sampled point on the array's rear principal plane."""
    microlens: tuple[int, int] | None
    """Lattice indices as in `GroundTruth.microlens`, in FREE lattices (number, 0). None without microlenses."""
    type: int | None
    """Row of the array's `focal_lengths`."""
    status: RayStatus
    """OK, or the cause of the path's end."""
    point: Floats | None
    """(3,): start of the ray to the lens, on the last surface of the microlens or its front principal plane. None if
    the path ends here."""
    direction: Floats | None
    """(3,): of that ray."""
    weight: float
    """Projected solid angle that the path stands for, sr, times the response of the pixel and the transmission of dust.
    Its mean over all samples of a pixel is that from which light reaches the microlenses."""


@result
class ElementPassage:
    """Passage through one element of the lens, in the order of the traced path."""

    element: int
    """Index in `camera.lens.elements`; of an ideal lens, that of the iris."""
    kind: ElementKind
    status: RayStatus
    """OK, or the cause of the path's end."""
    point: Floats | None
    """(3,): on the element, also of a path that is clipped or totally reflected there. None without one."""
    before: Floats
    """(3,): direction of the path."""
    after: Floats | None
    """(3,): its direction from here on; None if it ends."""


@result
class WorldRay:
    """The ray that leaves the camera, in the world."""

    origin: Floats
    """(3,)."""
    direction: Floats
    """(3,): towards the scene."""
    weight: float
    """Factor of the radiance, sr: the projected solid angle of `MicrolensPassage`, times the transmission of masks and
    dust on the lens."""


class DrawnKind(enum.IntEnum):
    """Kind of a light that is sampled for direct light."""

    TRIANGLE = 0
    POINT = 1
    SUN = 2
    ENVIRONMENT = 3
    SHEET = 4


@result
class Place:
    """Triangle of a scene."""

    object: int
    """Index of the mesh in `scene.meshes`, followed by the shapes of quad and sphere lights."""
    triangle: int
    """Row of the mesh's `faces`."""
    instance: int | None
    """Row of `Instances.matrices`; None for plain meshes."""


@result
class DirectLight:
    """A light that is sampled for a surface."""

    kind: DrawnKind
    place: Place | None
    """Of a TRIANGLE."""
    light: int | None
    """Index in `scene.lights` of a POINT (a spot too), SHEET or SUN."""
    point: Floats | None
    """(3,): end of the shadow ray; for suns and the environment beyond the scene. None if the light shines the other
    way."""
    blocked: bool | None
    """True if a surface lies between. None without a shadow ray, since it could contribute nothing."""
    contribution: Floats
    """(c,): radiance added to the path; 0 if blocked."""


@result
class Meeting:
    """Hit of a path on a surface."""

    place: Place
    material: Material
    point: Floats
    """(3,): not finite if the triangle has no area."""
    distance: float
    """Distance from the ray's origin, through all transparent surfaces on the way."""
    normal: Floats
    """(3,): unit normal of the triangle, towards the side from which the path comes."""
    shading_normal: Floats | None
    """(3,): normal for shading; None if the surface scatters nothing."""
    emitted: Floats
    """(c,): emission of the surface added to the path; a difference of sums, exact to their rounding."""
    light: DirectLight | None = None
    """None if no light is sampled."""
    direction: Floats | None = None
    """(3,): direction of the scattered ray; None if the path ends here."""
    throughput: Floats | None = None
    """(c,): factor of the radiance along the scattered ray."""


@result
class Escape:
    """End of a path that hits no surface any more."""

    direction: Floats
    """(3,)."""
    emitted: Floats
    """(c,): radiance of background, environment and suns; in a white image 1."""


Event: TypeAlias = SensorPoint | MicrolensPassage | ElementPassage | WorldRay | Meeting | Escape


class PathEnding(enum.IntEnum):
    """End of a path. See `replay`."""

    LEFT_SCENE = 0
    """It hits no surface any more; in a white image, it leaves the lens."""
    ABSORBED = 1
    """The surface scatters nothing: it reflects nothing, or the sampled direction leads to the wrong side."""
    ROULETTE = 2
    """It is ended at random after some bounces (Russian roulette); the others count for more."""
    MAX_BOUNCES = 3
    """It has been scattered `max_bounces` times."""
    NOTHING_AHEAD = 4
    """A scattered ray could hit no emitter, so that there is none: the direct light was the last."""
    NO_SURFACE = 5
    """float32 finds a triangle, and float64 no distance to it: it has no area, or the ray starts on it."""
    LOST = 6
    """It does not pass microlens and lens; the last event has the cause."""
    UNLIT_PIXEL = 7
    """No light can reach the pixel; the renderer traces none of its paths."""
    NOT_FINITE = 8
    """Its contribution is infinite or not a number, and left out of the image."""
