"""Triangles of a scene as kernels read them, and records of the hits of rays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats

INSTANCE_DISTANCE = 12
"""Column of `Geometry.instance_to_world` behind the 3 x 4 matrix: how far, |x| + |y| + |z| in mm, the mesh has the
middle from which its float32 coordinates count from that of the scene. Rays in its frame err by units of this."""

POINT, NORMAL, SHADING_NORMAL, OFFSET, FRONT, ROUGHNESS, METALLIC, UV = 0, 3, 6, 9, 10, 11, 12, 13
INTERACTION_COLUMNS = 15
"""Columns of the rows of `Interactions`: the point; the triangle's unit normal on the side of the ray; the shading
normal; how far off the surface rays start; whether the front is seen (1 or 0); roughness; metallic; (u, v)."""

RAY_OFFSET = 2.0**-20
"""Secondary rays start off the surface by this much of the coordinates that float32 has rounded: 16 units of
rounding of the numbers in which Embree holds the triangles (after C. Waechter and N. Binder, Ray Tracing Gems,
2019, ch. 6, with a length along the normal in place of one shift a component)."""

RAY_OFFSET_64 = 2.0**-42
"""And by this much of all coordinates, for the rounding of the hit point itself in float64."""


class Geometry(NamedTuple):
    """Triangles: nv vertices, nt triangles, ni instances. All arrays are C-contiguous and read-only.

    Triangles of plain meshes come first, then those of the shapes of lights, then those of instanced meshes, once each.
    """

    vertices: Floats
    """(nv, 3), mm, in the world; vertices of instanced meshes in the frame of their mesh."""
    triangles: NDArray[np.int32]
    """(nt, 3): rows of `vertices`, counter-clockwise as seen from the front."""
    triangle_material: NDArray[np.int32]
    """(nt,): row of the material's columns."""
    uv: Floats | None
    """(nv, 2): texture coordinates, v up; 0 where a mesh has none. None where no material has a texture."""
    normals: Floats | None
    """(nv, 3), unit length; 0 where a mesh has none. None where no mesh has any."""
    instance_to_world: Floats | None
    """(ni, 13): the upper three rows of each instance's matrix, and INSTANCE_DISTANCE. None without instances."""
    middle: Floats
    """(3,): origin of the float32 coordinates, so that a scene far from the world's origin keeps its precision."""


class InstanceRecord(NamedTuple):
    """Meshes placed by ni transforms."""

    matrices: Floats
    """(ni, 12): the upper three rows, one after the other, from the frame of the mesh to the world, mm."""
    first: NDArray[np.int32]
    """(ni,): first row of `triangles` of the instanced mesh."""
    faces: NDArray[np.int32]
    """(ni,): number of its triangles."""
    plain: int
    """Number of triangles in world coordinates: the first rows of `triangles`."""
    moving: NDArray[np.int32] | None
    """(ni,): index of the motion in the scene; -1 for a static instance. None if nothing moves."""

    def some(self, which: NDArray[np.bool_]) -> InstanceRecord | None:
        """Instances of a mask (ni,), still ones, with the plain triangles; None for an empty mask without them."""
        if not which.any():
            return None
        return InstanceRecord(self.matrices[which], self.first[which], self.faces[which], self.plain, None)


class Hits(NamedTuple):
    """Closest hits of rays."""

    triangle: NDArray[np.int32]
    """(n,): -1 for none."""
    instance: NDArray[np.int32] | None
    """(n,): -1 for plain triangles and where there is no hit. None in scenes without instances."""
    travelled: Floats | None
    """(n,), mm: distance travelled through transparent surfaces before the hit. None if all surfaces are opaque."""

    def first(self, n: int) -> Hits:
        """Hits of the first n rays."""
        instance, travelled = self.instance, self.travelled
        return Hits(
            self.triangle[:n], None if instance is None else instance[:n], None if travelled is None else travelled[:n]
        )


class Interactions(NamedTuple):
    """Interactions of rays with n surfaces that scatter; all arrays but `ray`, `path` and `material` may have room for
    more.
    """

    rows: Floats
    """(n, INTERACTION_COLUMNS), and a column more for each of EXTRA_SHARES where a material of the scene has them."""
    ray: NDArray[np.int64]
    """(n,): row of the ray."""
    path: NDArray[np.int64]
    """(n,): the ray's path."""
    material: NDArray[np.int64]
    """(n,)."""
    base_color: Floats
    """(n, channels of the paths)."""
    random: Floats
    """(4, n): a point of the Sobol sequence; 0 and 1 draw a light, 2 and 3 a direction."""
    key: NDArray[np.uint64]
    """(n,): from which more random numbers are made."""
    number: NDArray[np.uint32]
    """(n,): of the point of the sequence."""

    def first(self, n: int) -> Interactions:
        """The first of them."""
        ray, path, material = self.ray[:n], self.path[:n], self.material[:n]
        return Interactions(self.rows, ray, path, material, self.base_color, self.random, self.key, self.number)


class PathKeys(NamedTuple):
    """Keys from which the random numbers of paths are made."""

    path: NDArray[np.int64]
    """(rays,): which path a ray is of."""
    key: NDArray[np.uint64]
    """(paths,)."""
    number: NDArray[np.uint32]
    """(paths,): of their points of the sequence."""
    salt: int = 0
    """Another one for each surface that a path goes through."""


class Shadows(NamedTuple):
    """Results of shadow rays."""

    blocked: NDArray[np.uint8]
    """(rays,): 1 if the ray is occluded."""
    radiance: Floats
    """(rays, channels): radiance along the ray, attenuated by the media that it passes."""
