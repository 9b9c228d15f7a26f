"""Rays in the frames of moving meshes, and the nearer one of two hits."""

from __future__ import annotations

from plenoptic.core.kernels.vectors import cross, dot, fill_vector, row_vector, scale, sub
from plenoptic.core.numba.jit import kernel
from plenoptic.scene.geometry.kernels.intersect import corners, intersect_triangle


@kernel
def fill_in_frame(local, rays, places, path):
    """Rays (n, 6) in the frame of a mesh, from the rows (m, 12) of its matrices; `path` (n,) names each ray's row.

    Without `path`, the first row is that of all. By Cramer's rule: matrices are affine and do not flatten.
    """
    for i in range(rays.shape[0]):
        m = places[0] if path is None else places[path[i]]
        a, b, c = (m[0], m[4], m[8]), (m[1], m[5], m[9]), (m[2], m[6], m[10])
        bc, ca, ab = cross(b, c), cross(c, a), cross(a, b)
        over = 1.0 / dot(a, bc)
        o = sub(row_vector(rays, i, 0), (m[3], m[7], m[11]))
        d = row_vector(rays, i, 3)
        fill_vector(local, i, 0, scale((dot(bc, o), dot(ca, o), dot(ab, o)), over))
        fill_vector(local, i, 3, scale((dot(bc, d), dot(ca, d), dot(ab, d)), over))


@kernel
def fill_nearer(hits, reached, found, local, geometry, first, instance):
    """Replace hits by those with a mesh, in whose frame rays are `local`, where these are nearer than `reached`.

    `found` are triangles from row `first` on; `instance` is the row of the mesh's place.
    """
    vertices, triangles = geometry.vertices, geometry.triangles
    hit, placed = hits.triangle, hits.instance
    for i in range(found.size):
        if found[i] >= 0:
            k = first + found[i]
            triangle = corners(vertices, triangles, k, None, -1)
            # Affine maps keep how far along a ray something is, in lengths of its direction.
            t, _, _, _ = intersect_triangle(row_vector(local, i, 0), row_vector(local, i, 3), triangle)
            if 0.0 < t < reached[i]:
                hit[i], placed[i], reached[i] = k, instance, t
