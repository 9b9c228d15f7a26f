"""Charts that measure resolution: Siemens star, slanted edge."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.values import finite, length_in_mm, not_negative, whole
from plenoptic.errors import InvalidValueError
from plenoptic.scene.materials.registry import Material
from plenoptic.scene.shapes.targets.checker_layouts import MOST_SQUARES, faces_around, flat_mesh, in_plane, polygon
from plenoptic.scene.shapes.targets.target import BRIGHT, DARK, Target


def siemens_star(
    radius: float,
    spokes: int,
    *,
    inner_radius: float = 0.0,
    margin: float = 0.0,
    dark: Material = DARK,
    bright: Material = BRIGHT,
) -> Target:
    """A star of dark and bright wedges in the plane z = 0, as many of each as it has spokes.

    At the distance r from the centre it has spokes / (2 pi r) line pairs per mm. The edges of wedges are exact straight
    lines; rims are polygons of 2 `spokes` sides whose corners lie on the radius.

    Parameters
    ----------
    radius : float
        mm.
    spokes : int
        Dark wedges, at least 2; the first begins in the direction of x and goes on counter-clockwise.
    inner_radius : float
        Wedges end there, mm; within, the star is bright. 0: they end in the centre.
    margin : float
        mm: around the star, a bright square reaches this far beyond it. 0: the star alone.
    dark, bright : Material

    Returns
    -------
    Target
        Meshes: dark, bright. Points: the centre, with `index` (0, 0); then the ends of the 2 `spokes` edges,
        counter-clockwise, with (1, edge); with an `inner_radius` the inner ends have (1, edge) and the outer ones
        (2, edge).

    Raises
    ------
    InvalidValueError
        Too few spokes, a radius that is not above 0 or not above `inner_radius`, negative lengths.

    Examples
    --------
    >>> import plenoptic as pl
    >>> star = pl.targets.siemens_star(5.0, 36, margin=1.0)
    >>> star
    Target('Siemens star', 2 meshes, 148 triangles, 73 points)
    >>> star.points[1].tolist()
    [5.0, 0.0, 0.0]
    """
    radius, inner = length_in_mm(radius, "radius"), finite(inner_radius, "inner_radius")
    sides, border = 2 * whole(spokes, "spokes", at_least=2, at_most=MOST_SQUARES), not_negative(margin, "margin", "mm")
    if not 0 <= inner < radius:
        raise InvalidValueError(
            f"inner_radius is {inner:g} mm; it must be 0 or more, and below the radius {radius:g} mm"
        )
    outside = polygon(sides, radius)
    rings = [np.zeros((1, 2)), outside] if inner == 0 else [np.zeros((1, 2)), polygon(sides, inner), outside]
    vertices = np.concatenate(rings)
    reach = radius + border
    corners = np.concatenate([vertices, reach * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])])
    edge = np.arange(sides)
    inner_ring = 1 + np.stack([edge, (edge + 1) % sides], axis=1)
    wedges = np.insert(inner_ring, 0, 0, axis=1)[:, None]
    plain = []
    if inner > 0:
        plain.append(wedges[:, 0])
        outer_ring = inner_ring + sides
        wedges = np.stack(
            [
                [inner_ring[:, 0], outer_ring[:, 0], outer_ring[:, 1]],
                [inner_ring[:, 0], outer_ring[:, 1], inner_ring[:, 1]],
            ]
        ).T
        wedges = wedges.swapaxes(1, 2)
    if border > 0:
        plain.append(len(vertices) - sides + faces_around(sides))
    meshes = [
        flat_mesh(corners, wedges[::2].reshape(-1, 3), dark, "dark"),
        flat_mesh(corners, np.concatenate([wedges[1::2].reshape(-1, 3), *plain]), bright, "bright"),
    ]
    number = np.concatenate([[[0, 0]], *(np.stack([np.full(sides, k), edge], axis=1) for k in range(1, len(rings)))])
    return Target(meshes, in_plane(vertices), number, name="Siemens star")


def slanted_edge(size: float, *, angle_deg: float = 5.0, dark: Material = DARK, bright: Material = BRIGHT) -> Target:
    """A square in the plane z = 0 with one straight edge through its centre, dark on the left and bright on the right.

    Pixels see a slanted edge at all distances, from which ISO 12233 finds a camera's contrast at all frequencies.

    Parameters
    ----------
    size : float
        Side of the square in mm.
    angle_deg : float
        Of the edge, counter-clockwise from the direction of y, in degrees, within -45 and 45 (exclusive).
    dark, bright : Material

    Returns
    -------
    Target
        Meshes: dark, bright. Points: the upper and the lower end of the edge, at y = size / 2 and -size / 2.

    Raises
    ------
    InvalidValueError
        A size that is not above 0, an edge that ends on the left and right sides.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.targets.slanted_edge(20.0).points.round(4).tolist()
    [[-0.8749, 10.0, 0.0], [0.8749, -10.0, 0.0]]
    """
    half, angle = length_in_mm(size, "size") / 2, finite(angle_deg, "angle_deg")
    if not -45 < angle < 45:
        raise InvalidValueError(
            f"angle_deg is {angle:g}; it must be within -45 and 45, or turn the target: rotated_deg((0, 0, 1), 90)"
        )
    x = half * math.tan(math.radians(angle))
    ends = [[-x, half], [x, -half]]
    corners = [*ends, [-half, half], [-half, -half], [half, -half], [half, half]]
    meshes = [
        flat_mesh(corners, [[2, 3, 0], [3, 1, 0]], dark, "dark"),
        flat_mesh(corners, [[1, 4, 0], [4, 5, 0]], bright, "bright"),
    ]
    return Target(meshes, in_plane(np.array(ends)), name="slanted edge")
