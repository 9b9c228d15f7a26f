"""Kernels that test rays against the opening of a stop.

Rays lie in the plane of the stop, in its own axes.
"""

from __future__ import annotations

import math

from plenoptic.core.kernels.ray_blocks import BLOCK, CLIPPED, NOT_FINITE, STATUS, WEIGHT, X, Y
from plenoptic.core.numba.jit import device
from plenoptic.optics.element_record import ARCS, MASK, POLYGON, RING, STAR
from plenoptic.optics.lens.lens_record import MASK_HEAD


@device
def clip_circle(ray, semi_diameter2, code):
    """Clip rays outside the circle around a stop."""
    for i in range(BLOCK):
        r2 = ray[X + i] * ray[X + i] + ray[Y + i] * ray[Y + i]
        lost = 0.0 if r2 <= semi_diameter2 else code + CLIPPED
        lost = lost if r2 < math.inf else code + NOT_FINITE
        was = ray[STATUS + i]
        ray[STATUS + i] = was if was != 0.0 else lost


@device
def _clip_edge(ray, nx, ny, apothem, code):
    """Clip rays beyond one straight edge."""
    for i in range(BLOCK):
        inside = nx * ray[X + i] + ny * ray[Y + i] <= apothem
        was = ray[STATUS + i]
        ray[STATUS + i] = was if was != 0.0 or inside else code + CLIPPED


@device
def _clip_arc(ray, a, b, limit, bend, code):
    """Clip rays beyond one arc: the edge of a curved blade, or the inner edge of a ring; see `PolygonStop.edges`."""
    for i in range(BLOCK):
        x, y = ray[X + i], ray[Y + i]
        inside = a * x + b * y + bend * (x * x + y * y) <= limit
        was = ray[STATUS + i]
        ray[STATUS + i] = was if was != 0.0 or inside else code + CLIPPED


@device
def _clip_notch(ray, one, other, code):
    """Clip rays between two tips of a star: those beyond both edges are lost."""
    ax, ay, bx, by, limit = one[0], one[1], other[0], other[1], one[2]
    for i in range(BLOCK):
        x, y = ray[X + i], ray[Y + i]
        inside = min(ax * x + ay * y, bx * x + by * y) <= limit
        was = ray[STATUS + i]
        ray[STATUS + i] = was if was != 0.0 or inside else code + CLIPPED


@device
def _through_mask(ray, masks, k, code):
    """Multiply weights by the transmission of the mask's cell at each ray; lost rays may have any position, or nan."""
    first, rows, columns = int(masks[MASK_HEAD * k]), masks[MASK_HEAD * k + 1], masks[MASK_HEAD * k + 2]
    per_mm, width = masks[MASK_HEAD * k + 3], int(columns)
    for i in range(BLOCK):
        u = 0.5 * columns + ray[X + i] * per_mm
        v = 0.5 * rows - ray[Y + i] * per_mm
        inside = u >= 0.0 and u <= columns and v >= 0.0 and v <= rows
        column = int(min(u, columns - 1.0) if inside else 0.0)
        row = int(min(v, rows - 1.0) if inside else 0.0)
        passing = masks[first + row * width + column] if inside else 0.0
        ray[WEIGHT + i] *= passing
        was = ray[STATUS + i]
        ray[STATUS + i] = was if was != 0.0 or passing > 0.0 else code + CLIPPED


@device
def clip_shape(ray, lens, k, code):
    """Clip rays at the edges of the stop in row k; `clip_circle` clips them at the circle around it."""
    kind, edges = lens.rows[k].kind, lens.edges[lens.first_edge[k] : lens.first_edge[k + 1]]
    if kind == POLYGON:
        for j in range(edges.shape[0]):
            _clip_edge(ray, edges[j, 0], edges[j, 1], edges[j, 2], code)
    elif kind in (ARCS, RING):
        for j in range(edges.shape[0]):
            _clip_arc(ray, edges[j, 0], edges[j, 1], edges[j, 2], edges[j, 3], code)
    elif kind == STAR:
        for j in range(0, edges.shape[0], 2):
            _clip_notch(ray, edges[j], edges[j + 1], code)
    elif lens.masks is not None:  # noqa: SIM102 - nested for compile-time pruning
        if kind == MASK:
            _through_mask(ray, lens.masks, k, code)
