"""Boards of repeated marks: checkerboards, grids of dots, random dots."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import (
    MAX_POINTS,
    Floats,
    checked_shape,
    finite,
    length_in_mm,
    not_negative,
    seed_number,
    whole,
)
from plenoptic.errors import InvalidValueError
from plenoptic.scene.materials.diffuse import Lambertian
from plenoptic.scene.materials.registry import Material
from plenoptic.scene.shapes.procedural import quad
from plenoptic.scene.shapes.targets.checker_layouts import (
    MOST_SQUARES,
    cell_corners,
    dot_faces,
    equal_area,
    flat_mesh,
    grid_corners,
    grid_faces,
    in_plane,
    polygon,
)
from plenoptic.scene.shapes.targets.target import BRIGHT, DARK, Target
from plenoptic.scene.textures.color import Colour, as_colour
from plenoptic.scene.textures.texture import Texture, TextureFilter, Wrap

MARK = 0.15
"""Radius of a mark's disc over the edge of a square."""
_SIDES = 16
"""Of the polygon of a mark, which has the area of the disc."""


def checkerboard(
    columns: int, rows: int, *, square: float, margin: float = 0.0, dark: Material = DARK, bright: Material = BRIGHT
) -> Target:
    """A board of squares in the plane z = 0, whose inner corners are known.

    Unlike `pl.checkerboard`, which fills a rectangle, it consists of whole squares. `marked_checkerboard` need not be
    in view as a whole.

    Parameters
    ----------
    columns, rows : int
        Squares along x and along y, at least 2. Libraries that count corners count one less.
    square : float
        Edge of a square in mm.
    margin : float
        Width of a bright border around the squares in mm.
    dark, bright : Material
        The square in the upper left corner is dark.

    Returns
    -------
    Target
        Meshes: dark, bright. Points: the (rows - 1)(columns - 1) inner corners, row by row from the upper left one,
        each with `index` (row, column).

    Raises
    ------
    InvalidValueError
        Too few squares, lengths that are not above 0 (the margin: 0 or more).

    Examples
    --------
    >>> import plenoptic as pl
    >>> board = pl.targets.checkerboard(9, 6, square=2.0, margin=2.0)
    >>> board
    Target('checkerboard', 2 meshes, 176 triangles, 40 points)
    >>> board.points[0].tolist(), board.index[0].tolist()
    ([-7.0, 4.0, 0.0], [0, 0])
    """
    columns, rows = checked_shape((columns, rows), ("columns", "rows"), at_least=2, at_most=MOST_SQUARES)
    square, border = length_in_mm(square, "square"), not_negative(margin, "margin", "mm")
    return squares(columns, rows, square, border, dark, bright, np.zeros((rows, columns), dtype=bool))


def squares(
    columns: int, rows: int, square: float, border: float, dark: Material, bright: Material, marks: NDArray[np.bool_]
) -> Target:
    """A checkerboard, some squares of which have a disc of the other colour in the middle."""
    x, y = _lines(columns, square), _lines(rows, square)
    # Rows count downwards, lines upwards.
    is_dark, is_marked = (np.arange(rows)[::-1, None] + np.arange(columns)) % 2 == 0, marks[::-1]
    if border > 0:
        x, y = (np.concatenate([[axis[0] - border], axis, [axis[-1] + border]]) for axis in (x, y))
        is_dark, is_marked = np.pad(is_dark, 1), np.pad(is_marked, 1)
    corners = [grid_corners(x, y)]
    faces = [[grid_faces(is_dark & ~is_marked)], [grid_faces(~is_dark & ~is_marked)]]
    for colour, marked in enumerate((is_dark & is_marked, ~is_dark & is_marked)):
        row, column = np.nonzero(marked)
        cells = cell_corners(row * len(x) + column, len(x) - 1)
        dots, frames = dot_faces(sum(map(len, corners)), _SIDES, cells)
        middle = 0.5 * np.stack([x[column] + x[column + 1], y[row] + y[row + 1]], axis=1)
        rims = middle[:, None] + polygon(_SIDES, MARK * square * equal_area(_SIDES))
        corners.append(rims.reshape(-1, 2))
        faces[colour].append(frames)
        faces[1 - colour].append(dots)
    meshes = [
        flat_mesh(np.concatenate(corners), np.concatenate(each), material, name)
        for each, material, name in zip(faces, (dark, bright), ("dark", "bright"), strict=True)
    ]
    points, index = _lattice(columns - 1, rows - 1, square)
    if marks.any():
        return Target(meshes, in_plane(points), index, name="marked checkerboard", marks=marks)
    return Target(meshes, in_plane(points), index, name="checkerboard")


def point_grid(
    columns: int,
    rows: int,
    *,
    pitch: float,
    radius: float,
    sides: int = 64,
    dark: Material = DARK,
    bright: Material = BRIGHT,
) -> Target:
    """A grid of dark dots on a bright board in the plane z = 0, whose centres are known.

    Parameters
    ----------
    columns, rows : int
        Dots along x and along y.
    pitch : float
        Distance of neighbouring centres in mm; the board ends half a pitch beside the outermost ones.
    radius : float
        Of the dots, in mm, below half the pitch. A dot is a polygon of the area of this circle.
    sides : int
        Of that polygon, at least 4.
    dark, bright : Material
        Of dots and board. `Emissive` dots on a board of `Emissive(0.0)` are lamps in the dark.

    Returns
    -------
    Target
        Meshes: dots, board. Points: the centres, row by row from the upper left one, each with `index` (row, column).

    Raises
    ------
    InvalidValueError
        Too few dots, lengths that are not above 0, dots that touch.

    Examples
    --------
    >>> import plenoptic as pl
    >>> dots = pl.targets.point_grid(9, 7, pitch=2.0, radius=0.5)
    >>> dots
    Target('point grid', 2 meshes, 8190 triangles, 63 points)
    >>> dots.points[0].tolist()
    [-8.0, 6.0, 0.0]
    """
    columns, rows, sides = checked_shape((columns, rows, sides), ("columns", "rows", "sides"), at_most=MOST_SQUARES)
    sides = whole(sides, "sides", at_least=4)
    pitch = length_in_mm(pitch, "pitch")
    reach = length_in_mm(radius, "radius") * equal_area(sides)
    if not reach < pitch / 2:
        raise InvalidValueError(
            f"dots reach {reach:g} mm from their centres; reduce radius {radius:g} mm until that is below half the "
            f"pitch, {pitch / 2:g} mm"
        )
    centres, index = _lattice(columns, rows, pitch)
    lattice = grid_corners(_lines(columns, pitch), _lines(rows, pitch))
    rims = centres[:, None] + polygon(sides, reach)
    corners = np.concatenate([lattice, rims.reshape(-1, 2)])
    below = (rows - 1 - index[:, 0]) * (columns + 1) + index[:, 1]
    dots, frames = dot_faces(len(lattice), sides, cell_corners(below, columns))
    meshes = [flat_mesh(corners, dots, dark, "dots"), flat_mesh(corners, frames, bright, "board")]
    return Target(meshes, in_plane(centres), index, name="point grid")


def random_dots(
    columns: int,
    rows: int,
    *,
    dot: float,
    density: float = 0.5,
    seed: int = 0,
    dark: Colour = 0.05,
    bright: Colour = 0.8,
) -> Target:
    """A board of square dots in the plane z = 0, each dark or bright at random: texture for matching everywhere.

    The dots are texels of a texture that is not interpolated: edges are sharp, and millions of dots are two triangles.

    Parameters
    ----------
    columns, rows : int
        Dots along x and along y.
    dot : float
        Edge of a dot in mm.
    density : float
        Share of dark dots that is expected, in [0, 1].
    seed : int
        The same seed gives the same dots, on all machines.
    dark, bright : float or (float, float, float)
        Albedos of the Lambertian board. To let it shine: `mesh.with_material(pl.Emissive(mesh.material.albedo))`.

    Returns
    -------
    Target
        One mesh. Points: the centres of the dark dots, row by row from the upper left, each with `index` (row, column).

    Raises
    ------
    InvalidValueError
        No dots, a dot or seed that is no such number, a density outside [0, 1].
    SceneError
        Albedos outside [0, 1].

    Examples
    --------
    >>> import plenoptic as pl
    >>> board = pl.targets.random_dots(200, 100, dot=0.1, seed=3)
    >>> board.meshes[0].material
    Lambertian(albedo=Texture(texels=<100 x 200 x 1 float32>, ...))
    """
    columns, rows = checked_shape((columns, rows), ("columns", "rows"), at_most=MAX_POINTS)
    dot, probability = length_in_mm(dot, "dot"), finite(density, "density")
    if not 0 <= probability <= 1:
        raise InvalidValueError(
            f"density is {probability:g}; it must be within 0 and 1, the expected share of dark dots"
        )
    colours = [np.ravel(as_colour(c, n, at_most=1.0)) for c, n in ((bright, "bright"), (dark, "dark"))]
    # Raw numbers of the generator: NumPy promises that they stay the same; 53 of their bits make a number in [0, 1).
    raw = np.random.PCG64(seed_number(seed)).random_raw(rows * columns)
    is_dark = ((raw >> np.uint64(11)) * 2.0**-53 < probability).reshape(rows, columns)
    texels = np.stack(np.broadcast_arrays(*colours))[is_dark.astype(np.int64)]
    texture = Texture(texels, wrap=Wrap.CLAMP, filter=TextureFilter.NEAREST)
    width, height = columns * dot, rows * dot
    mesh = quad((-width / 2, -height / 2, 0), (width, 0, 0), (0, height, 0), material=Lambertian(texture))
    centres, index = _lattice(columns, rows, dot)
    dark_cells = is_dark.ravel()
    return Target([mesh], in_plane(centres[dark_cells]), index[dark_cells], name="random dots")


def _lines(cells: int, width: float) -> Floats:
    """The cells + 1 lines around cells of a width, centred on 0 and ascending."""
    return (np.arange(cells + 1, dtype=np.float64) - cells / 2) * width


def _lattice(columns: int, rows: int, pitch: float) -> tuple[Floats, NDArray[np.int64]]:
    """Places (n, 2) of a grid, row by row from the upper left one, and the row and column of each."""
    index = np.stack(np.divmod(np.arange(rows * columns), columns), axis=1)
    return grid_corners(_lines(columns - 1, pitch), _lines(rows - 1, pitch)[::-1]), index
