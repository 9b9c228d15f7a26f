"""To which microlens a point of the array belongs, for light that travels forwards: device functions.

A `lattice` is a tuple, in the order of the arguments of `own_lens` from `origin` on; what an array lacks is None.
"""

from __future__ import annotations

import math

from plenoptic.core.jit import device
from plenoptic.core.kernels.ray_blocks import BLOCK, OUTSIDE_MICROLENS, STATUS, WEIGHT, L, M, N, X, Y
from plenoptic.optics.microlens.kernels.to_lens import CELL_X, CELL_Y, CENTRE_X, CENTRE_Y, LANE, POWER, TRANSMISSION

PLACE = 5
AXIS_X, AXIS_Y, FIRST, SECOND, BEND = (row * BLOCK for row in range(PLACE))
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
def _nearest_listed(x, y, reach, bins, bin_first, members, lenses):
    """Row of the listed lens whose designed centre is nearest, no farther than about `reach`; NO_LENS without one."""
    low_i = max(math.floor((x - reach - bins[0]) / bins[2]), 0)
    low_j = max(math.floor((y - reach - bins[1]) / bins[2]), 0)
    high_i = min(math.floor((x + reach - bins[0]) / bins[2]), int(bins[3]) - 1)
    high_j = min(math.floor((y + reach - bins[1]) / bins[2]), int(bins[4]) - 1)
    best, row = math.inf, NO_LENS
    for i in range(low_i, high_i + 1):
        for j in range(low_j, high_j + 1):
            b = i * int(bins[4]) + j
            for k in range(bin_first[b], bin_first[b + 1]):
                dx, dy = x - lenses[members[k], CELL_X], y - lenses[members[k], CELL_Y]
                if dx * dx + dy * dy < best:
                    best, row = dx * dx + dy * dy, members[k]
    return row


@device
def own_lens(x, y, origin, basis, inverse, powers, pattern, corner, rows, reach, bins, bin_first, members, lenses):
    """The lens in whose cell (x, y) lies: index, row of the list, optical axis and power.

    `rows` (p, q) leads from the lattice index, less `corner`, to the row of `lenses`. With `bins` the lattice is FREE.
    """
    if bins is not None:
        row = _nearest_listed(x, y, reach, bins, bin_first, members, lenses)
        if row < 0:
            return 0, 0, NO_LENS, 0.0, 0.0, 0.0
        return row, 0, row, lenses[row, LANE], lenses[row, LANE + 1], lenses[row, POWER]
    i, j, cx, cy = nearest_cell(x - origin[0], y - origin[1], basis, inverse)
    cx, cy = cx + origin[0], cy + origin[1]
    row, power = DESIGNED, powers[0]
    if pattern is not None:
        power = powers[pattern[i % pattern.shape[0], j % pattern.shape[1]]]
    if rows is not None:
        a, b = i - corner[0], j - corner[1]
        if 0 <= a < rows.shape[0] and 0 <= b < rows.shape[1]:
            row = rows[a, b]
        if row >= 0:
            cx, cy, power = lenses[row, LANE], lenses[row, LANE + 1], lenses[row, POWER]
    return i, j, row, cx, cy, power


@device
def meets_sphere(x, y, l, m, n, c):
    """Where a ray from (x, y, 0) meets a sphere of curvature c whose vertex is the origin; see `trace`."""
    e = -(x * l + y * m)
    px, py, pz = x + e * l, y + e * m, e * n
    f = c * (px * px + py * py + pz * pz) - 2.0 * pz
    g = n - c * (px * l + py * m + pz * n)
    t = f / (g + math.sqrt(max(g * g - c * f, 0.0)))
    return px + t * l, py + t * m


@device
def find_cells(ray, place, c, origin, basis, inverse):
    """Cells of a plain lattice in which rays from the plane z = 0 meet the spheres of curvature c.

    The spheres of neighbouring cells meet at the edge between them, so that their caps are one surface, which a ray
    less steep than the surface meets once. A ray that meets the sphere of one cell beyond its edge meets that of the
    next cell there, or passes on over it.
    """
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
    """Whether a point lies in the circle of squared radius `radius2` and inside all `edges` (k, 3)."""
    inside = x * x + y * y <= radius2
    for k in range(edges.shape[0]):
        inside = inside and edges[k, 0] * x + edges[k, 1] * y <= edges[k, 2] * _ON_EDGE
    return inside


@device
def _in_opening(x, y, row, ax, ay, edges, radius2, lenses):
    """Whether (x, y) lies in the opening of a lens, listed in a row or with its centre at (ax, ay)."""
    if edges is None:
        return True
    if lenses is not None:  # noqa: SIM102 - alone, so that it is pruned
        if row >= 0:
            ax, ay = lenses[row, CENTRE_X], lenses[row, CENTRE_Y]
    return is_inside(x - ax, y - ay, radius2, edges)


@device
def _in_cell(x, y, row, cells, lenses):
    """Whether (x, y) lies in the cell of a lens, which is the one nearest to it; FREE ones end at the pitch."""
    if row == NO_LENS:
        return False
    if cells is None:
        return True
    return is_inside(x - lenses[row, CELL_X], y - lenses[row, CELL_Y], math.inf, cells[row])


@device
def find_lenses(ray, place, bow, towards_scene, clear, edges, radius2, cells, lenses, lattice):
    """Lenses that differ, where rays from the plane z = 0 meet them; rays that pass none are lost.

    Lenses are spheres of curvature `bow` times their power, or planes for 0. `edges` and `radius2` end the openings;
    beside them nothing passes or, for `clear`, all does, through the plane of the vertices: there it goes on where it
    meets that plane, before it can meet a sphere that lies behind (`towards_scene`) or if it has met none in front.
    """
    for i in range(BLOCK):
        a, b, ax, ay, power = 0, 0, 0.0, 0.0, 0.0
        if ray[STATUS + i] == 0.0:
            x, y, l, m, n = ray[X + i], ray[Y + i], ray[L + i], ray[M + i], ray[N + i]
            a, b, row, ax, ay, power = own_lens(x, y, *lattice)
            plane_a, plane_b, plane_row, plane_x, plane_y = a, b, row, ax, ay
            hit_x, hit_y, found = x, y, True
            if bow != 0.0:
                found = False
                for _ in range(_TRIES):
                    hit_x, hit_y = meets_sphere(x - ax, y - ay, l, m, n, bow * power)
                    hit_x, hit_y = hit_x + ax, hit_y + ay
                    next_a, next_b, next_row, next_x, next_y, next_power = own_lens(hit_x, hit_y, *lattice)
                    if next_a == a and next_b == b:
                        found = True
                        break
                    a, b, row, ax, ay, power = next_a, next_b, next_row, next_x, next_y, next_power
            passes = (
                found
                and _in_cell(hit_x, hit_y, row, cells, lenses)
                and _in_opening(hit_x, hit_y, row, ax, ay, edges, radius2, lenses)
            )
            if clear and (towards_scene or not passes):
                beside = not _in_opening(x, y, plane_row, plane_x, plane_y, edges, radius2, lenses)
                if beside:
                    a, b, row, ax, ay, power = plane_a, plane_b, plane_row, plane_x, plane_y, 0.0
                    passes = _in_cell(x, y, row, cells, lenses)
            if lenses is not None:
                ray[WEIGHT + i] *= lenses[row, TRANSMISSION] if row >= 0 else 1.0
            ray[STATUS + i] = 0.0 if passes else OUTSIDE_MICROLENS
        place[AXIS_X + i] = ax
        place[AXIS_Y + i] = ay
        place[FIRST + i] = a
        place[SECOND + i] = b
        place[BEND + i] = power
