"""Tangents of glTF files, which are compared with the directions of the texture that normal maps follow."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.values import Floats
from plenoptic.core.warn import warn
from plenoptic.errors import FileWarning
from plenoptic.scene.geometry.mesh import Mesh

_ANGLE = math.radians(10.0)
"""Tangents at corners are means over the triangles that meet there: those of round bodies differ by some degrees."""
_SHARE = 0.05


def warn_of_tangents(mesh: Mesh, tangents: Floats) -> None:
    """Say where the tangents (n, 4) of a file turn normal maps otherwise than the texture's own directions do.

    The last column is the hand: the texture's v, upwards, grows along hand * cross(normal, tangent).
    """
    assert mesh.uv is not None
    (a, b, c), (p, q, r) = (np.moveaxis(array[mesh.faces], 1, 0) for array in (mesh.vertices, mesh.uv))
    (s1, t1), (s2, t2) = (q - p).T, (r - p).T
    area = s1 * t2 - s2 * t1
    # The direction in which u grows, times the area of the triangle in the texture.
    along_u = np.sign(area)[:, None] * ((b - a) * t2[:, None] - (c - a) * t1[:, None])
    normal = np.cross(b - a, c - a)
    of_file = tangents[mesh.faces].mean(axis=1)
    flat = (
        of_file[:, :3] - normal * _ratio((of_file[:, :3] * normal).sum(axis=1), (normal * normal).sum(axis=1))[:, None]
    )
    cosine = _ratio((flat * along_u).sum(axis=1), np.linalg.norm(flat, axis=1) * np.linalg.norm(along_u, axis=1))
    has_area = (area != 0) & normal.any(axis=1)
    other = has_area & ((cosine < math.cos(_ANGLE)) | (of_file[:, 3] * area < 0))
    part = float(other.sum() / max(1.0, float(has_area.sum())))
    if part > _SHARE:
        warn(
            f"the tangents of mesh {mesh.name!r} are left out, and on {100 * part:.0f} % of its triangles they differ "
            f"from the directions of its texture by more than {math.degrees(_ANGLE):g} degrees: its normal map is "
            "turned there; export without tangents to see what is rendered, or bake the map again",
            FileWarning,
        )


def _ratio(above: Floats, below: Floats) -> Floats:
    return np.divide(above, below, out=np.zeros_like(above), where=below > 0)
