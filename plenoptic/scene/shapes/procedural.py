"""Meshes and scenes made from numbers: simple bodies, checkerboards and the reference scenes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.values import Floats, checked_shape, coordinate, length_in_mm, positions, whole
from plenoptic.errors import InvalidValueError
from plenoptic.scene.geometry.mesh import Mesh
from plenoptic.scene.lights.quad import QuadLight
from plenoptic.scene.materials.conductor import Conductor
from plenoptic.scene.materials.dielectric import Dielectric
from plenoptic.scene.materials.diffuse import Lambertian
from plenoptic.scene.materials.emissive import Emissive
from plenoptic.scene.materials.registry import Material
from plenoptic.scene.scene import Scene
from plenoptic.scene.shapes.targets.checker_layouts import MOST_SQUARES, flat_mesh, grid_corners, grid_faces


def quad(corner: ArrayLike, edge_u: ArrayLike, edge_v: ArrayLike, *, material: Material | None = None) -> Mesh:
    """A parallelogram of two triangles whose front is on the side of edge_u x edge_v.

    Parameters
    ----------
    corner : (3,) array
        mm; texture coordinate (0, 0).
    edge_u, edge_v : (3,) array
        mm; towards texture coordinates (1, 0) and (0, 1).
    material : Material, optional
        Lambertian(0.5) by default, as for all bodies here.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.quad((0, 0, 0), (2, 0, 0), (0, 1, 0)).bounds.tolist()
    [[0.0, 0.0, 0.0], [2.0, 1.0, 0.0]]
    """
    c, u, v = (
        positions(a, name=n, shape=(3,)) for a, n in ((corner, "corner"), (edge_u, "edge_u"), (edge_v, "edge_v"))
    )
    uv = [[0, 0], [1, 0], [1, 1], [0, 1]]
    return Mesh(np.stack([c, c + u, c + u + v, c + v]), [[0, 1, 2], [0, 2, 3]], _or_grey(material), uv=uv)


def box(size: ArrayLike, *, center: ArrayLike = (0.0, 0.0, 0.0), material: Material | None = None) -> Mesh:
    """A rectangular block of 12 triangles with its faces across the axes; each face has the whole texture.

    Parameters
    ----------
    size : float or (3,) array
        Edge lengths in mm.
    center : (3,) array
        mm.
    material : Material, optional

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.box(4).bounds.tolist()
    [[-2.0, -2.0, -2.0], [2.0, 2.0, 2.0]]
    """
    try:
        sides = np.broadcast_to(np.asarray(size, dtype=np.float64), 3).tolist()
    except (TypeError, ValueError, OverflowError):
        raise InvalidValueError(f"size of the box is {size!r}; it must be one edge or (x, y, z) in mm") from None
    edges = np.array([length_in_mm(side, "size of the box") for side in sides])
    middle = positions(center, name="center", shape=(3,))
    corners: list[Floats] = []
    faces: list[list[int]] = []
    uv: list[list[float]] = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for side in (-1.0, 1.0):
            first = 4 * len(faces) // 2
            for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                corner = np.zeros(3)
                corner[axis], corner[u], corner[v] = side, a * side, b
                corners.append(middle + corner * edges / 2)
                uv.append([(a + 1) / 2, (b + 1) / 2])
            faces += [[first, first + 1, first + 2], [first, first + 2, first + 3]]
    return Mesh(corners, faces, _or_grey(material), uv=uv)


def sphere(
    radius: float,
    *,
    center: ArrayLike = (0.0, 0.0, 0.0),
    segments: tuple[int, int] = (128, 64),
    material: Material | None = None,
) -> Mesh:
    """A sphere of facets around the y axis, with the normals of the true sphere at its vertices.

    Parameters
    ----------
    radius : float
        mm; the vertices lie on it, the facets' middles inside.
    center : (3,) array
        mm.
    segments : (int, int)
        Facets around the axis and from pole to pole.
    material : Material, optional

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.sphere(2.5)
    Mesh(8385 vertices, 16128 triangles, Lambertian())
    """
    try:
        meridians, along = segments
    except (TypeError, ValueError):
        raise InvalidValueError(f"segments is {segments!r}; it must be (around, from pole to pole)") from None
    meridians, along = checked_shape(
        (meridians, along), ("segments", "segments from pole to pole"), at_most=MOST_SQUARES
    )
    angle = np.linspace(-math.pi / 2, math.pi / 2, whole(along, "segments from pole to pole", at_least=2) + 1)
    profile = length_in_mm(radius, "radius") * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    profile[[0, -1], 0] = 0.0
    return turned(profile, segments=meridians, material=material).translated(
        *positions(center, name="center", shape=(3,)).tolist()
    )


def turned(profile: ArrayLike, *, segments: int = 128, material: Material | None = None) -> Mesh:
    """A body of revolution around the y axis, with smooth normals and texture coordinates (around, along).

    Parameters
    ----------
    profile : (n, 2) array
        Distance from the axis, 0 or more, and height y in mm, from the bottom to the top; the outside is on the right.
    segments : int
        Facets around the axis.
    material : Material, optional

    Examples
    --------
    >>> import plenoptic as pl
    >>> cone = pl.shapes.turned([[1, 0], [0, 2]], segments=32)
    >>> cone.bounds.tolist()
    [[-1.0, 0.0, -1.0], [1.0, 2.0, 1.0]]
    """
    line = positions(profile, name="profile", shape=(None, 2))
    if len(line) < 2 or np.any(line[:, 0] < 0):
        raise InvalidValueError("profile must have two points or more, none at a negative distance from the axis")
    facets = whole(segments, "segments", at_least=3, at_most=MOST_SQUARES // len(line))
    angle = 2 * math.pi * np.arange(facets + 1) / facets
    rows = len(line)
    slope = np.gradient(line, axis=0)
    vertices, normals = _swept(line[:, 0], line[:, 1], angle), _swept(slope[:, 1], -slope[:, 0], angle)
    uv = np.stack(np.broadcast_arrays(np.arange(facets + 1) / facets, np.linspace(0, 1, rows)[:, None]), axis=-1)
    faces = grid_faces(np.ones((rows - 1, facets), dtype=bool))
    corners = vertices[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return Mesh(vertices, faces[area > 1e-12 * area.max()], _or_grey(material), normals=normals, uv=uv.reshape(-1, 2))


def _swept(out: Floats, up: Floats, angle: Floats) -> Floats:
    """(n, 3): a line of components away from the y axis and along it, at each angle around it, row by row."""
    # Axes so that the winding (around, then along the profile) faces outwards.
    parts = out[:, None] * np.sin(angle), up[:, None], out[:, None] * np.cos(angle)
    return np.stack(np.broadcast_arrays(*parts), axis=-1).reshape(-1, 3)


def checkerboard(
    size: tuple[float, float],
    square: float,
    *,
    even: Material | None = None,
    odd: Material | None = None,
    offset: tuple[float, float] = (0.0, 0.0),
) -> tuple[Mesh, Mesh]:
    """A rectangle of squares in the plane z = 0, centred on the origin, facing +z: the even ones and the odd ones.

    Parameters
    ----------
    size : (float, float)
        Width along x and height along y in mm; squares at the border are cut.
    square : float
        Edge of a square in mm.
    even, odd : Material, optional
        Materials of the squares whose column and row numbers have an even or odd sum; Lambertian 0.8 and 0.2
        by default. Square (0, 0) has its lower left corner at `offset`.
    offset : (float, float)
        mm.

    Examples
    --------
    >>> import plenoptic as pl
    >>> even, odd = pl.checkerboard((4, 4), 2.0)
    >>> len(even.faces), len(odd.faces)
    (4, 4)
    """
    square = length_in_mm(square, "square")
    extents, starts = _pair(size, "size", "(width, height)"), _pair(offset, "offset", "(x, y)")
    lines = []
    for extent, start in zip(extents, starts, strict=True):
        half = length_in_mm(extent, "size of the checkerboard") / 2
        if not (extent + abs(start)) / square < MOST_SQUARES:
            raise InvalidValueError(f"square is {square:g} mm; squares along an edge must be below {MOST_SQUARES}")
        first, last = math.floor((-half - start) / square), math.ceil((half - start) / square)
        places = np.clip(start + square * np.arange(first, last + 1), -half, half)
        distinct = np.append(True, np.diff(places) > 0)
        # A line that the border cuts away leaves its number to the border itself.
        lines.append((places[distinct], np.arange(first, last + 1)[distinct]))
    (x, column), (y, row) = lines
    checked_shape((len(x), len(y)), ("lines across", "lines up"), at_most=MOST_SQUARES)
    corners = grid_corners(x, y)
    parity = _squares_below(row, y, starts[1], square)[:, None] + _squares_below(column, x, starts[0], square)
    is_odd = parity % 2 == 1
    return (
        flat_mesh(corners, grid_faces(~is_odd), even or Lambertian(0.8)),
        flat_mesh(corners, grid_faces(is_odd), odd or Lambertian(0.2)),
    )


def _squares_below(number: NDArray[np.int64], places: Floats, start: float, square: float) -> NDArray[np.int64]:
    """Number of the square above each line but the last."""
    middle = 0.5 * (places[:-1] + places[1:])
    return np.floor((middle - start) / square).astype(np.int64)


def _pair(values: tuple[float, float], name: str, wanted: str) -> tuple[float, float]:
    try:
        first, second = values
    except (TypeError, ValueError):
        raise InvalidValueError(f"{name} is {values!r}; it must be {wanted} in mm") from None
    return coordinate(first, name), coordinate(second, name)


def _or_grey(material: Material | None) -> Material:
    return Lambertian(0.5) if material is None else material


def white_plane() -> Scene:
    """The reference scene `white`: a plane of radiance 1, 400 mm x 400 mm at z = -404, in the camera's frame.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.shapes.white_plane()
    Scene(1 mesh, 2 triangles)
    """
    return Scene([quad((-200, -200, -404), (400, 0, 0), (0, 400, 0), material=Emissive(1.0))])


def check_scene() -> Scene:
    """The reference scene `check`: the plane of `white` as squares of 1 mm, bright and black, in the camera's frame.

    Radiance is 1 where floor(x + 0.05) + floor(0.1 - y) is odd and 0 elsewhere.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.check_scene().bounds.tolist()
    [[-200.0, -200.0, -404.0], [200.0, 200.0, -404.0]]
    """
    # floor(0.1 - y) is -1 - n on the square n of lines at y = 0.1 + n: odd sums become even ones and back.
    even, odd = checkerboard((400, 400), 1.0, even=Emissive(1.0), odd=Lambertian(0.0), offset=(-0.05, 0.1))
    return Scene([even.translated(z=-404), odd.translated(z=-404)])


def objects_scene() -> Scene:
    """The reference scene `objects`, in the camera's frame: a cube, a metal and a glass ball before a checkerboard.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.objects_scene()
    Scene(5 meshes, 34068 triangles, 1 light, background 0.1)
    """
    back = [mesh.translated(z=-416) for mesh in checkerboard((60, 60), 2.0)]
    cube = box(4, material=Lambertian((0.8, 0.3, 0.2)))
    for axis, angle in (((0, 0, 1), 20), ((1, 0, 0), 10), ((0, 1, 0), 30)):
        cube = cube.rotated_deg(axis, angle)
    metal = sphere(2.5, center=(3, -2, -404), material=Conductor(0.9, alpha=0.1))
    glass = sphere(2.0, center=(0, 3, -398), material=Dielectric(1.5))
    light = QuadLight.facing((0, 60, -360), (0, 0, -404), (40, 40), radiance=10.0, two_sided=True)
    return Scene([*back, cube.translated(-3.5, -2, -404), metal, glass], [light], background=0.1)
