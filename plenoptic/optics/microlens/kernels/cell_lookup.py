"""Lookup of the microlens at a point of the array, for light that travels forwards: device functions.

Arrays are an `ArrayRecord`.
"""

from __future__ import annotations

import math

from plenoptic.core.kernels.ray_blocks import BLOCK, OUTSIDE_MICROLENS, STATUS, WEIGHT, L, M, N, X, Y
from plenoptic.core.numba.jit import device
from plenoptic.optics.microlens.kernels.lens_table import bins_around

LENS_ROWS = 5
AXIS_X, AXIS_Y, INDEX_I, INDEX_J, POWER = (row * BLOCK for row in range(LENS_ROWS))
"""Rows of the microlenses of a block of rays: optical axis, lattice index (FREE: number and 0), and power."""

DESIGNED, NO_LENS = -1, -2
"""In place of a row of the lens table: lenses that are not in it, and no lens at all."""

_MAX_STEPS = 6
"""Cells in which a ray is searched; all but grazing rays are found in the first or second."""

_ON_EDGE = 1.0 + 1e-9
"""Tolerance with which a ray on an edge belongs to either cell."""


@device
def nearest_cell(x, y, basis, inverse):
    """Index and centre of the lattice point nearest to (x, y): one corner of the lattice mesh that holds the point."""
    i0 = math.floor(x * inverse[0, 0] + y * inverse[1, 0])
    j0 = math.floor(x * inverse[0, 1] + y * inverse[1, 1])
    best, best_x, best_y, best_i, best_j = math.inf, 0.0, 0.0, i0, j0
    for step in range(4):
        i, j = i0 + (step & 1), j0 + (step >> 1)
        cx = i * basis[0, 0] + j * basis[1, 0]
        cy = i * basis[0, 1] + j * basis[1, 1]
        distance2 = (x - cx) * (x - cx) + (y - cy) * (y - cy)
        if distance2 < best:
            best, best_x, best_y, best_i, best_j = distance2, cx, cy, i, j
    return best_i, best_j, best_x, best_y


@device
def in_extent(i, j, extent):
    """True if the lens (i, j) belongs to the array; `extent` is that of a `LatticeRecord`."""
    x, y = i * extent[0, 0] + j * extent[1, 0], i * extent[0, 1] + j * extent[1, 1]
    return abs(x) <= extent[2, 0] and abs(y) <= extent[2, 1]


@device
def _nearest_in_table(x, y, reach, lens_table):
    """Row of the lens in the table with the nearest design centre within about `reach`; NO_LENS if there is none."""
    lenses, bins = lens_table.lenses, lens_table.bins
    low_i, high_i, low_j, high_j = bins_around(x, y, reach, bins)
    best, row = math.inf, NO_LENS
    for i in range(low_i, high_i + 1):
        for j in range(low_j, high_j + 1):
            b = i * bins.columns + j
            for k in range(bins.first[b], bins.first[b + 1]):
                lens = lenses[bins.members[k]]
                dx, dy = x - lens.cell_x, y - lens.cell_y
                if dx * dx + dy * dy < best:
                    best, row = dx * dx + dy * dy, bins.members[k]
    return row


@device
def find_lens(x, y, array):
    """Lens in whose cell (x, y) lies: index, row of the lens table, optical axis and power."""
    lattice = array.lattice
    if array.lens_table is not None and array.lens_table.cells is not None:
        row = _nearest_in_table(x, y, array.opening.radius, array.lens_table)
        if row < 0:
            return 0, 0, NO_LENS, 0.0, 0.0, 0.0
        lens = array.lens_table.lenses[row]
        return row, 0, row, lens.axis_x, lens.axis_y, lens.power
    origin = lattice.origin
    i, j, cx, cy = nearest_cell(x - origin[0], y - origin[1], lattice.basis, lattice.inverse)
    cx, cy = cx + origin[0], cy + origin[1]
    row, power = DESIGNED, lattice.powers[0]
    if lattice.pattern is not None:
        pattern = lattice.pattern
        power = lattice.powers[pattern[i % pattern.shape[0], j % pattern.shape[1]]]
    if array.lens_table is not None and array.lens_table.lattice_index is not None:
        corner, rows = array.lens_table.lattice_index.corner, array.lens_table.lattice_index.rows
        a, b = i - corner[0], j - corner[1]
        if 0 <= a < rows.shape[0] and 0 <= b < rows.shape[1]:
            row = rows[a, b]
        if row >= 0:
            lens = array.lens_table.lenses[row]
            cx, cy, power = lens.axis_x, lens.axis_y, lens.power
    if lattice.extent is not None:  # noqa: SIM102 - nested for compile-time pruning
        if not in_extent(i, j, lattice.extent):
            row = NO_LENS
    return i, j, row, cx, cy, power


@device
def intersect_sphere(x, y, l, m, n, c):
    """Intersection of a ray from (x, y, 0) with a sphere of curvature c and vertex at the origin; see `trace`.

    Its x, y and z, the distance along the ray, and the squared cosine to the normal, negative where the ray misses.
    """
    e = -(x * l + y * m)
    x, y, z = x + e * l, y + e * m, e * n
    f = c * (x * x + y * y + z * z) - 2.0 * z
    g = n - c * (x * l + y * m + z * n)
    q2 = g * g - c * f
    q = math.sqrt(max(q2, 0.0))
    t = f / (g + q) if g >= 0.0 else (g - q) / c
    return x + t * l, y + t * m, z + t * n, e + t, q2


@device
def find_cells(ray, lens_rows, c, lattice):
    """Find the cells of a plain lattice in which rays from the plane z = 0 meet the spheres of curvature c.

    The spheres of neighbouring cells intersect above the edge between them, so that their caps form one surface. A ray
    less steep than the surface meets it once. A ray that meets the sphere of one cell beyond its edge meets that of the
    next cell there, or passes over it.
    """
    origin, basis, inverse = lattice.origin, lattice.basis, lattice.inverse
    for i in range(BLOCK):
        a, b, cx, cy = 0, 0, 0.0, 0.0
        if ray[STATUS + i] == 0.0:
            x, y = ray[X + i] - origin[0], ray[Y + i] - origin[1]
            l, m, n = ray[L + i], ray[M + i], ray[N + i]
            a, b, cx, cy = nearest_cell(x, y, basis, inverse)
            if c != 0.0:
                for _ in range(_MAX_STEPS):
                    hit_x, hit_y, _, _, _ = intersect_sphere(x - cx, y - cy, l, m, n, c)
                    next_a, next_b, next_x, next_y = nearest_cell(cx + hit_x, cy + hit_y, basis, inverse)
                    if next_a == a and next_b == b:
                        break
                    a, b, cx, cy = next_a, next_b, next_x, next_y
        lens_rows[AXIS_X + i] = cx + origin[0]
        lens_rows[AXIS_Y + i] = cy + origin[1]
        lens_rows[INDEX_I + i] = a
        lens_rows[INDEX_J + i] = b


@device
def is_inside(x, y, radius2, edges):
    """True if a point lies in the circle of squared radius `radius2` and inside all `edges` (k, 3)."""
    inside = x * x + y * y <= radius2
    for k in range(edges.shape[0]):
        inside = inside and edges[k, 0] * x + edges[k, 1] * y <= edges[k, 2] * _ON_EDGE
    return inside


@device
def _in_opening(x, y, row, axis, array):
    """True if (x, y) lies in the opening of a lens, which is in a row of the table or has its centre on its axis."""
    if array.opening.fills:
        return True
    ax, ay = axis
    if array.lens_table is not None:  # noqa: SIM102 - nested for compile-time pruning
        if row >= 0:
            lens = array.lens_table.lenses[row]
            ax, ay = lens.centre_x, lens.centre_y
    return is_inside(x - ax, y - ay, array.opening.radius2, array.opening.edges)


@device
def _in_cell(x, y, row, lens_table):
    """True if (x, y) lies in the cell of its nearest lens; cells of FREE lattices are limited by the pitch."""
    if row == NO_LENS:
        return False
    if lens_table is None:
        return True
    if lens_table.cells is None:
        return True
    lens = lens_table.lenses[row]
    return is_inside(x - lens.cell_x, y - lens.cell_y, math.inf, lens_table.cells[row])


@device
def find_lenses(ray, lens_rows, bow, towards_scene, array):
    """Find the microlenses that rays from the plane z = 0 meet, if lenses differ; rays that meet none are lost.

    Lenses are spheres of curvature `bow` times their power, or planes if `bow` is 0. Gaps are opaque, or clear in the
    plane of the vertices. A ray passes a clear gap if it meets that plane outside an opening before it can meet a
    sphere behind it (`towards_scene`), or if it has met no sphere in front.
    """
    clear = array.opening.clear
    lens_table = array.lens_table
    for i in range(BLOCK):
        a, b, ax, ay, power = 0, 0, 0.0, 0.0, 0.0
        if ray[STATUS + i] == 0.0:
            x, y, l, m, n = ray[X + i], ray[Y + i], ray[L + i], ray[M + i], ray[N + i]
            a, b, row, ax, ay, power = find_lens(x, y, array)
            plane_a, plane_b, plane_row, plane_x, plane_y = a, b, row, ax, ay
            hit_x, hit_y, converged = x, y, True
            if bow != 0.0:
                converged = False
                for _ in range(_MAX_STEPS):
                    hit_x, hit_y, _, _, _ = intersect_sphere(x - ax, y - ay, l, m, n, bow * power)
                    hit_x, hit_y = hit_x + ax, hit_y + ay
                    next_a, next_b, next_row, next_x, next_y, next_power = find_lens(hit_x, hit_y, array)
                    if next_a == a and next_b == b:
                        converged = True
                        break
                    a, b, row, ax, ay, power = next_a, next_b, next_row, next_x, next_y, next_power
            passes = (
                converged
                and _in_cell(hit_x, hit_y, row, lens_table)
                and _in_opening(hit_x, hit_y, row, (ax, ay), array)
            )
            if clear and (towards_scene or not passes):
                in_gap = not _in_opening(x, y, plane_row, (plane_x, plane_y), array)
                if in_gap:
                    a, b, row, ax, ay, power = plane_a, plane_b, plane_row, plane_x, plane_y, 0.0
                    passes = _in_cell(x, y, row, lens_table)
            if lens_table is not None:
                ray[WEIGHT + i] *= lens_table.lenses[row].transmission if row >= 0 else 1.0
            ray[STATUS + i] = 0.0 if passes else OUTSIDE_MICROLENS
        lens_rows[AXIS_X + i] = ax
        lens_rows[AXIS_Y + i] = ay
        lens_rows[INDEX_I + i] = a
        lens_rows[INDEX_J + i] = b
        lens_rows[POWER + i] = power
