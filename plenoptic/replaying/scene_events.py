"""What happens to a path in the scene, one value for each step; lengths in mm, in the world."""

from __future__ import annotations

import enum
from typing import TypeAlias

from plenoptic.core.values import Floats, value
from plenoptic.scene.materials.registry import Material


class DrawnKind(enum.IntEnum):
    """What kind of light was drawn to shine directly on a surface.

    Examples
    --------
    See `replay`.
    """

    TRIANGLE = 0
    POINT = 1
    SUN = 2
    ENVIRONMENT = 3


@value
class Place:
    """Which triangle.

    Parameters
    ----------
    object : int
        Number of the mesh in `scene.meshes`; the shapes of quad and sphere lights count on after the last one.
    triangle : int
        Row of the mesh's `faces`.
    instance : int or None
        Row of `Instances.matrices`; None for plain meshes.

    Examples
    --------
    See `replay`.
    """

    object: int
    triangle: int
    instance: int | None


@value
class DirectLight:
    """A light that was drawn to shine directly on a surface.

    Parameters
    ----------
    kind : DrawnKind
    place : Place or None
        Of a TRIANGLE.
    light : int or None
        Number in `scene.lights` of a POINT (a spot too) or SUN.
    point : (3,) array or None
        Where the shadow ray ends, in the world, mm; for suns and the environment beyond the scene. None where the light
        shines the other way.
    blocked : bool or None
        Whether something lies between. None where no shadow ray was sent, since nothing would come of it.
    contribution : (c,) array
        Radiance that was added to the path; 0 where it was blocked.

    Examples
    --------
    See `replay`.
    """

    kind: DrawnKind
    place: Place | None
    light: int | None
    point: Floats | None
    blocked: bool | None
    contribution: Floats


@value
class Meeting:
    """A path meets a surface. c is 1 for a path with a wavelength or in a grey scene, otherwise 3.

    Parameters
    ----------
    place : Place
    material : Material
    point : (3,) array
        In the world, mm; not finite where the triangle has no area.
    distance : float
        From where the ray came, mm, through all surfaces on the way that were not there for it.
    normal : (3,) array
        Of the triangle, unit length, towards the side that the path comes from.
    shading_normal : (3,) array or None
        That with which the surface is shaded; None where it scatters nothing.
    emitted : (c,) array
        Radiance that the surface's own light added to the path; a difference of sums, exact to their rounding.
    light : DirectLight or None
        None where the surface takes no light that is drawn, and where none is drawn.
    direction : (3,) array or None
        Of the ray onwards; None where the path ends here.
    throughput : (c,) array or None
        What of the radiance from there reaches the camera.

    Examples
    --------
    See `replay`.
    """

    place: Place
    material: Material
    point: Floats
    distance: float
    normal: Floats
    shading_normal: Floats | None
    emitted: Floats
    light: DirectLight | None = None
    direction: Floats | None = None
    throughput: Floats | None = None


@value
class Escape:
    """A path meets nothing more.

    Parameters
    ----------
    direction : (3,) array
        In the world.
    emitted : (c,) array
        Radiance that background, environment and suns added; in a white image 1.

    Examples
    --------
    See `replay`.
    """

    direction: Floats
    emitted: Floats


SceneEvent: TypeAlias = Meeting | Escape
