"""Events of a path, one value for each step; lengths in mm.

c is 1 for a path with a wavelength or in a grey scene, otherwise 3.
"""

from __future__ import annotations

import enum
from typing import TypeAlias

from plenoptic.core.rays import RayStatus
from plenoptic.core.values import Floats, result
from plenoptic.optics.element_record import ElementKind
from plenoptic.scene.materials.registry import Material

# ---- in the camera, in its axes ----


@result
class SensorPoint:
    """Start of a path on the sensor."""

    pixel: tuple[int, int]
    """Row and column on the whole sensor."""
    point: Floats
    """(3,): on the pixel."""


@result
class MicrolensPassage:
    """Through the plane of the microlenses; without microlenses, through the last vertex of the lens."""

    aim: Floats
    """(3,): the point that was drawn on the array's rear principal plane."""
    microlens: tuple[int, int] | None
    """Lattice indices as in `GroundTruth.microlens`, in FREE lattices (number, 0). None without microlenses."""
    type: int | None
    """Row of the array's `focal_lengths`."""
    status: RayStatus
    """OK, or why the path ended here."""
    point: Floats | None
    """(3,): where the ray starts on its way to the lens: on the last surface of the microlens, or its front principal
    plane. None where the path ended."""
    direction: Floats | None
    """(3,): of that ray."""
    weight: float
    """Projected solid angle that the path stands for, in sr: the mean of it over all samples of a pixel is that from
    which light reaches the microlenses; times the response of the pixel and what dust lets pass."""


@result
class ElementPassage:
    """At one element of the lens, in the order in which light is followed back."""

    element: int
    """Index in `camera.lens.elements`; of an ideal lens, that of the iris."""
    kind: ElementKind
    status: RayStatus
    """OK, or why the path ended here."""
    point: Floats | None
    """(3,): on the element, also of a path that is clipped or totally reflected there. None where there is no such
    point."""
    before: Floats
    """(3,): direction of the path."""
    after: Floats | None
    """(3,): its direction from there; None where it ended."""


@result
class WorldRay:
    """The ray that leaves the camera, in the world."""

    origin: Floats
    """(3,)."""
    direction: Floats
    """(3,): towards the scene."""
    weight: float
    """What radiance from there is multiplied by, in sr: the projected solid angle of `MicrolensPassage`, times what
    masks and dust on the lens let pass."""


# ---- in the scene, in the world ----


class DrawnKind(enum.IntEnum):
    """Kind of light that was sampled to shine directly on a surface."""

    TRIANGLE = 0
    POINT = 1
    SUN = 2
    ENVIRONMENT = 3


@result
class Place:
    """Triangle of a scene."""

    object: int
    """Number of the mesh in `scene.meshes`; the shapes of quad and sphere lights count on after the last one."""
    triangle: int
    """Row of the mesh's `faces`."""
    instance: int | None
    """Row of `Instances.matrices`; None for plain meshes."""


@result
class DirectLight:
    """A light that was drawn to shine directly on a surface."""

    kind: DrawnKind
    place: Place | None
    """Of a TRIANGLE."""
    light: int | None
    """Number in `scene.lights` of a POINT (a spot too) or SUN."""
    point: Floats | None
    """(3,): where the shadow ray ends; for suns and the environment beyond the scene. None where the light shines the
    other way."""
    blocked: bool | None
    """Whether something lies between. None where no shadow ray was sent, since nothing would come of it."""
    contribution: Floats
    """(c,): radiance that was added to the path; 0 where it was blocked."""


@result
class Meeting:
    """A path meets a surface."""

    place: Place
    material: Material
    point: Floats
    """(3,): not finite where the triangle has no area."""
    distance: float
    """From where the ray came, through all surfaces on the way that were not there for it."""
    normal: Floats
    """(3,): of the triangle, unit length, towards the side that the path comes from."""
    shading_normal: Floats | None
    """(3,): that with which the surface is shaded; None where it scatters nothing."""
    emitted: Floats
    """(c,): radiance that the surface's own light added to the path; a difference of sums, exact to their rounding."""
    light: DirectLight | None = None
    """None where the surface takes no light that is drawn, and where none is drawn."""
    direction: Floats | None = None
    """(3,): of the ray onwards; None where the path ends here."""
    throughput: Floats | None = None
    """(c,): what of the radiance from there reaches the camera."""


@result
class Escape:
    """A path meets nothing more."""

    direction: Floats
    """(3,)."""
    emitted: Floats
    """(c,): radiance that background, environment and suns added; in a white image 1."""


Event: TypeAlias = SensorPoint | MicrolensPassage | ElementPassage | WorldRay | Meeting | Escape


class PathEnding(enum.IntEnum):
    """End of a path. See `replay`."""

    LEFT_SCENE = 0
    """It met nothing more; in a white image, it left the lens."""
    ABSORBED = 1
    """The surface sent nothing on: it reflects nothing, or the direction that was drawn leads to the wrong side."""
    ROULETTE = 2
    """It was ended by chance after some bounces (Russian roulette); others like it count for more."""
    MAX_BOUNCES = 3
    """It was scattered as often as `max_bounces` allows."""
    NOTHING_AHEAD = 4
    """Nothing that a ray onwards could meet shines, so that none is sent: the direct light was the last."""
    NO_SURFACE = 5
    """float32 found a triangle, and float64 no distance to it: it has no area, or the ray starts on it."""
    LOST = 6
    """It did not get through microlens and lens; the last event has the cause."""
    UNLIT_PIXEL = 7
    """No light can reach the pixel; the renderer traces none of its paths."""
    NOT_FINITE = 8
    """What it brings is infinite or not a number; it was left out of the image."""
