"""The lights of a scene as kernels read them: one table of probabilities, and rows for each kind."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats

TRIANGLE, POINT, SUN, ENVIRONMENT, SHEET = range(5)
"""Kinds of sampled lights."""

LIGHT = np.dtype([("row", np.int64), ("instance", np.int32), ("kind", np.uint8)])
"""Sampled light: row of the triangles, points, suns or sheets; instance of a triangle, -1 for a plain one; kind."""

CORNER, EDGE_1, EDGE_2, FRONT_NORMAL, SHADOW_OFFSET, EXTENT = 0, 3, 6, 9, 12, 13
AREA_COLUMNS = 14
"""Columns of a triangle that emits, in the world: a corner, both edges from there, the unit normal towards the front,
the distance before it at which shadow rays end, and half the diagonal of the box around the mesh that shines."""

POINT_LIGHT = np.dtype(
    [(name, np.float64) for name in ("x", "y", "z", "axis_x", "axis_y", "axis_z", "cos_outer", "cos_inner")]
)
"""Position in mm, axis of a spot, and cosines of its outer and inner angle, both -2 where light goes everywhere."""

SUN_LIGHT = np.dtype([(name, np.float64) for name in ("x", "y", "z", "cap", "pdf")])
"""Direction to the sun, 1 - cosine of its angular radius, and the probability with which it is drawn."""

SHEET_LIGHT = np.dtype(
    [
        (name, np.float64)
        for name in ("x", "y", "z", "along_x", "along_y", "along_z", "across_x", "across_y", "across_z")
    ]
    + [(name, np.float64) for name in ("waist", "tangent", "start")]
)
"""Middle of the waist in mm, direction and normal of the sheet, half width of the waist in mm, tangent of the
divergence, and distance along the direction at which the light begins, -inf if infinitely far."""

DIRECTION, END, PDF = 0, 3, 6
DRAWN_COLUMNS = 7
"""Columns of a drawn light: unit direction to it, the point at which its shadow ray ends, and its density."""

DELTA = -1.0
"""The density of a direction that is the only one: a mirror's, or that of a point, a sheet or a sun without extent."""


class Environment(NamedTuple):
    """An environment of H x W texels. All arrays are C-contiguous and read-only.

    A texel is drawn with a probability proportional to its solid angle times its radiance, the mean of its channels, as
    far as that exceeds 0.75 of the mean over all directions: first its row, then its column, then a direction in it,
    uniform in solid angle.
    """

    texels: NDArray[np.float32]
    """(H, W, C): radiance."""
    rows_cdf: Floats
    """(H,): cumulative probability of the rows; the last is exactly 1."""
    columns_cdf: Floats
    """(H, W): that of the columns of each row, the last exactly 1; zeros in rows that are not drawn."""
    rows_guide: NDArray[np.uint16]
    """(G,): first row whose cumulative probability exceeds k / G."""
    columns_guide: NDArray[np.uint16]
    """(H, G): that of the columns of each row."""
    edges: Floats
    """(H, 3): 1 - cosine of both edges of each row, from the nearer pole; 1 where that is the upper one, else -1."""
    pdf: Floats
    """(H, W), 1/sr: probability per solid angle, the same all over a texel; 0 where it is not drawn."""
    rotation: Floats | None
    """(9,): the map's rotation, row by row. None where it has the axes of the world."""
    probability: float
    """With which the environment is drawn as a light."""
    total: float
    """Radiance, the mean of its channels, integrated over all directions."""


class Sky(NamedTuple):
    """Background of rays that hit nothing; C channels."""

    background: Floats | None
    """(C,): constant radiance of the world. None where it is black or a map."""
    suns: NDArray[Any] | None
    """(ns,) of SUN_LIGHT."""
    sun_colors: Floats | None
    """(ns, C): radiance of the disc; irradiance where there is none."""
    environment: Environment | None
    """None where there is no map, or a black one."""


class Lights(NamedTuple):
    """Lights that are drawn directly, and the sky. n items, C channels. All arrays are read-only.

    A constant background is no item: rays that are scattered find it as well.
    """

    cdf: Floats | None
    """(n,): cumulative probability, the last exactly 1. None, as is the next one, where nothing is drawn."""
    items: NDArray[Any] | None
    """(n,) of LIGHT."""
    areas: Floats | None
    """(nl, AREA_COLUMNS): triangles that emit, which are the first items. None where none is drawn."""
    points: NDArray[Any] | None
    """(np,) of POINT_LIGHT: points and spots."""
    point_colors: Floats | None
    """(np, C): intensity."""
    sheets: NDArray[Any] | None
    """(nh,) of SHEET_LIGHT."""
    sheet_colors: Floats | None
    """(nh, C): irradiance in the middle of the waist."""
    sky: Sky
    far: float
    """mm: how far it is, at most, from any point of the scene to beyond all of it."""
    middle: tuple[float, float, float]
    """mm: of the box around meshes and lamps."""
    candidates: int
    """Lights that are drawn at an interaction. One of them is chosen by its contribution."""


class DrawnLights(NamedTuple):
    """One light for each interaction."""

    rows: Floats
    """(n, DRAWN_COLUMNS)."""
    radiance: Floats
    """(n, channels of the paths): radiance over density; irradiance over probability where the density is DELTA."""
