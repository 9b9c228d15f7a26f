"""To which microlens a point of the array belongs, for light that travels forwards: device functions.

Arrays are an `ArrayRecord`.
"""

from __future__ import annotations

import math

from plenoptic.core.kernels.ray_blocks import BLOCK, OUTSIDE_MICROLENS, STATUS, WEIGHT, L, M, N, X, Y
from plenoptic.core.numba.jit import device
from plenoptic.optics.microlens.kernels.listed import bins_around

PLACE = 5
AXIS_X, AXIS_Y, FIRST, SECOND, POWER = (row * BLOCK for row in range(PLACE))
"""What a block of rays keeps of its microlenses: optical axis, lattice index (FREE: number and 0), and power."""

DESIGNED, NO_LENS = -1, -2
"""In place of a row of the list: lenses that are not listed, and none at all."""

_TRIES = 6
"""Cells in which a ray is looked for; all but rays along the surface are found in the first or second."""

_ON_EDGE = 1.0 + 1e-9
"""A ray on the edge belongs to either cell."""


@device
def nearest_cell(x, y, basis, inverse):
    """Index and centre of the lattice point nearest to (x, y): one corner of the mesh that holds the point."""
    i0 = math.floor(x * inverse[0, 0] + y * inverse[1, 0])
    j0 = math.floor(x * inverse[0, 1] + y * inverse[1, 1])
    best, best_x, best_y, best_i, best_j = math.inf, 0.0, 0.0, i0, j0
    for step in range(4):
        i, j = i0 + (step & 1), j0 + (step >> 1)
        cx = i * basis[0, 0] + j * basis[1, 0]
        cy = i * basis[0, 1] + j * basis[1, 1]
        far = (x - cx) * (x - cx) + (y - cy) * (y - cy)
        if far < best:
            best, best_x, best_y, best_i, best_j = far, cx, cy, i, j
    return best_i, best_j, best_x, best_y


@device
def _nearest_listed(x, y, reach, listed):
    """Row of the listed lens whose designed centre is nearest, no farther than about `reach`; NO_LENS without one."""
    lenses, bins = listed.lenses, listed.bins
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
def own_lens(x, y, array):
    """The lens in whose cell (x, y) lies: index, row of the list, optical axis and power."""
    lattice = array.lattice
    if array.listed is not None and array.listed.cells is not None:
        row = _nearest_listed(x, y, array.opening.radius, array.listed)
        if row < 0:
            return 0, 0, NO_LENS, 0.0, 0.0, 0.0
        lens = array.listed.lenses[row]
        return row, 0, row, lens.axis_x, lens.axis_y, lens.power
    origin = lattice.origin
    i, j, cx, cy = nearest_cell(x - origin[0], y - origin[1], lattice.basis, lattice.inverse)
    cx, cy = cx + origin[0], cy + origin[1]
    row, power = DESIGNED, lattice.powers[0]
    if lattice.pattern is not None:
        pattern = lattice.pattern
        power = lattice.powers[pattern[i % pattern.shape[0], j % pattern.shape[1]]]
    if array.listed is not None and array.listed.numbers is not None:
        corner, rows = array.listed.numbers.corner, array.listed.numbers.rows
        a, b = i - corner[0], j - corner[1]
        if 0 <= a < rows.shape[0] and 0 <= b < rows.shape[1]:
            row = rows[a, b]
        if row >= 0:
            lens = array.listed.lenses[row]
            cx, cy, power = lens.axis_x, lens.axis_y, lens.power
    return i, j, row, cx, cy, power


@device
def meets_sphere(x, y, l, m, n, c):
    """Intersection of a ray from (x, y, 0) with a sphere of curvature c whose vertex is the origin; see `trace`."""
    e = -(x * l + y * m)
    px, py, pz = x + e * l, y + e * m, e * n
    f = c * (px * px + py * py + pz * pz) - 2.0 * pz
    g = n - c * (px * l + py * m + pz * n)
    t = f / (g + math.sqrt(max(g * g - c * f, 0.0)))
    return px + t * l, py + t * m


@device
def find_cells(ray, place, c, lattice):
    """Cells of a plain lattice in which rays from the plane z = 0 meet the spheres of curvature c.

    The spheres of neighbouring cells meet at the edge between them, so that their caps are one surface, which a ray
    less steep than the surface meets once. A ray that meets the sphere of one cell beyond its edge meets that of the
    next cell there, or passes on over it.
    """
    origin, basis, inverse = lattice.origin, lattice.basis, lattice.inverse
    for i in range(BLOCK):
        a, b, cx, cy = 0, 0, 0.0, 0.0
        if ray[STATUS + i] == 0.0:
            x, y = ray[X + i] - origin[0], ray[Y + i] - origin[1]
            l, m, n = ray[L + i], ray[M + i], ray[N + i]
            a, b, cx, cy = nearest_cell(x, y, basis, inverse)
            if c != 0.0:
                for _ in range(_TRIES):
                    hit_x, hit_y = meets_sphere(x - cx, y - cy, l, m, n, c)
                    next_a, next_b, next_x, next_y = nearest_cell(cx + hit_x, cy + hit_y, basis, inverse)
                    if next_a == a and next_b == b:
                        break
                    a, b, cx, cy = next_a, next_b, next_x, next_y
        place[AXIS_X + i] = cx + origin[0]
        place[AXIS_Y + i] = cy + origin[1]
        place[FIRST + i] = a
        place[SECOND + i] = b


@device
def is_inside(x, y, radius2, edges):
    """True if a point lies in the circle of squared radius `radius2` and inside all `edges` (k, 3)."""
    inside = x * x + y * y <= radius2
    for k in range(edges.shape[0]):
        inside = inside and edges[k, 0] * x + edges[k, 1] * y <= edges[k, 2] * _ON_EDGE
    return inside


@device
def _in_opening(x, y, row, axis, array):
    """True if (x, y) lies in the opening of a lens, listed in a row or with its centre on its axis."""
    if array.opening.fills:
        return True
    ax, ay = axis
    if array.listed is not None:  # noqa: SIM102 - alone, so that it is pruned
        if row >= 0:
            lens = array.listed.lenses[row]
            ax, ay = lens.centre_x, lens.centre_y
    return is_inside(x - ax, y - ay, array.opening.radius2, array.opening.edges)


@device
def _in_cell(x, y, row, listed):
    """True if (x, y) lies in the cell of a lens, which is the one nearest to it; FREE ones end at the pitch."""
    if row == NO_LENS:
        return False
    if listed is None:
        return True
    if listed.cells is None:
        return True
    lens = listed.lenses[row]
    return is_inside(x - lens.cell_x, y - lens.cell_y, math.inf, listed.cells[row])


@device
def find_lenses(ray, place, bow, towards_scene, array):
    """Lenses that differ, where rays from the plane z = 0 meet them; rays that pass none are lost.

    Lenses are spheres of curvature `bow` times their power, or planes for 0. Beside their openings nothing passes or,
    where that is clear, all does, through the plane of the vertices: there it goes on where it meets that plane, before
    it can meet a sphere that lies behind (`towards_scene`) or if it has met none in front.
    """
    clear = array.opening.clear
    listed = array.listed
    for i in range(BLOCK):
        a, b, ax, ay, power = 0, 0, 0.0, 0.0, 0.0
        if ray[STATUS + i] == 0.0:
            x, y, l, m, n = ray[X + i], ray[Y + i], ray[L + i], ray[M + i], ray[N + i]
            a, b, row, ax, ay, power = own_lens(x, y, array)
            plane_a, plane_b, plane_row, plane_x, plane_y = a, b, row, ax, ay
            hit_x, hit_y, found = x, y, True
            if bow != 0.0:
                found = False
                for _ in range(_TRIES):
                    hit_x, hit_y = meets_sphere(x - ax, y - ay, l, m, n, bow * power)
                    hit_x, hit_y = hit_x + ax, hit_y + ay
                    next_a, next_b, next_row, next_x, next_y, next_power = own_lens(hit_x, hit_y, array)
                    if next_a == a and next_b == b:
                        found = True
                        break
                    a, b, row, ax, ay, power = next_a, next_b, next_row, next_x, next_y, next_power
            passes = found and _in_cell(hit_x, hit_y, row, listed) and _in_opening(hit_x, hit_y, row, (ax, ay), array)
            if clear and (towards_scene or not passes):
                beside = not _in_opening(x, y, plane_row, (plane_x, plane_y), array)
                if beside:
                    a, b, row, ax, ay, power = plane_a, plane_b, plane_row, plane_x, plane_y, 0.0
                    passes = _in_cell(x, y, row, listed)
            if listed is not None:
                ray[WEIGHT + i] *= listed.lenses[row].transmission if row >= 0 else 1.0
            ray[STATUS + i] = 0.0 if passes else OUTSIDE_MICROLENS
        place[AXIS_X + i] = ax
        place[AXIS_Y + i] = ay
        place[FIRST + i] = a
        place[SECOND + i] = b
        place[POWER + i] = power
