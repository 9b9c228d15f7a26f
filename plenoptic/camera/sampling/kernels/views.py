"""Kernels of linear ray transfer: openings of a lens as seen from groups of pixels through their microlenses.

Where a ray meets an element is a smooth function of its point in the cell and its point on the sensor. Rays through a
design of points in the box of both show that function, and how far it is from a linear one; an edge or a tangent of
the opening then is a plane in these four coordinates, with that distance as its margin.
"""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.kernels.bundles import pad
from plenoptic.core.kernels.ray_blocks import BLOCK, OUTSIDE_MICROLENS, RAY, STATUS, WEIGHT, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import device, kernel


def _design():
    """(RAYS, 4): the middle, half the corners of a cube (a fractional factorial design), and points on its axes."""
    corners = [(x, y, s, x * y * s) for x in (-1, 1) for y in (-1, 1) for s in (-1, 1)]
    axes = [sign * row for row in _ON_AXES * np.eye(4) for sign in (-1, 1)]
    return np.array([np.zeros(4), *corners, *axes], dtype=np.float64)


_ON_AXES = 0.55
DESIGN = _design()
RAYS = len(DESIGN)
_SQUARES = float((DESIGN[:, 0] ** 2).sum())

_SAFETY = 2.0
"""Of margins: the largest distance from a linear function at other points than those of the design."""
_ROUNDING = 1e-9
"""Of the size of an opening and of where it is met, added to margins."""


@kernel
def fill_view_rays(blocks, own, found, chosen, centres, half):
    """Aim the rays of the design, once for each of some wavelengths, from groups through candidates `chosen` (n,).

    `centres` (n, 2) are those of the groups, `half` the half sides of a group.
    """
    each = half.rays
    n = 0
    for k in range(chosen.size):
        candidate = found.rows[chosen[k]]
        for r in range(each):
            base, i = (n // BLOCK) * RAY, n % BLOCK
            ray = blocks[base : base + RAY]
            row = DESIGN[r % RAYS]
            x = candidate.cell_x + candidate.x + row[0] * candidate.half_x
            y = candidate.cell_y + candidate.y + row[1] * candidate.half_y
            ray[X + i], ray[Y + i] = x, y
            ray[L + i] = x - (centres[k, 0] + row[2] * half.x)
            ray[M + i] = y - (centres[k, 1] + row[3] * half.y)
            ray[Z + i], ray[N + i] = candidate.axis_x, candidate.axis_y
            ray[WEIGHT + i], ray[STATUS + i] = 1.0, 0.0
            if found.details is not None:
                own[n] = found.details[chosen[k]]
            n += 1
    pad(blocks, n)


@kernel
def fill_reopened(blocks):
    """Rays that only a microlens's rim has stopped go on."""
    for b in range(blocks.size // RAY):
        for i in range(b * RAY + STATUS, b * RAY + STATUS + BLOCK):
            if blocks[i] == OUTSIDE_MICROLENS:
                blocks[i] = 0.0


@device
def _set_view(view, fit, candidate, half):
    """A linear function of coordinates in units of half sides as one of mm from the centres of cell and group."""
    view.x_by_x, view.x_by_y = fit[0, 1] / candidate.half_x, fit[0, 2] / candidate.half_y
    view.y_by_x, view.y_by_y = fit[1, 1] / candidate.half_x, fit[1, 2] / candidate.half_y
    view.x_by_u, view.x_by_v = fit[0, 3] / half.x, fit[0, 4] / half.y
    view.y_by_u, view.y_by_v = fit[1, 3] / half.x, fit[1, 4] / half.y
    view.x = fit[0, 0] - view.x_by_x * candidate.x - view.x_by_y * candidate.y
    view.y = fit[1, 0] - view.y_by_x * candidate.x - view.y_by_y * candidate.y


@device
def _all_arrive(points, element, first, each):
    """True if all rays of a candidate arrive at an element and none is reflected there."""
    arrived = 0
    for r in range(first, first + each):
        arrived += 1 if points[element, 2, r] == 0.0 else 0
    return arrived == each


@device
def _is_inside(points, element, first, each, radius):
    """True if all rays of a candidate certainly meet an element inside its circle.

    Corners of a box that are not in the design are at most twice as far from the middle, in any direction, as those in
    it are, with a tenth for nonlinear terms.
    """
    if not _all_arrive(points, element, first, each):
        return False
    x, y, spread = points[element, 0, first], points[element, 1, first], 0.0
    for r in range(first, first + each):
        dx, dy = points[element, 0, r] - x, points[element, 1, r] - y
        spread = max(spread, dx * dx + dy * dy)
    return math.hypot(x, y) + 2.2 * math.sqrt(spread) <= radius


@device
def _fitted(fit, points, element, first, each):
    """The linear function of the design that is nearest to the points (elements, 3, rays), and its margin.

    Points have x, y and whether the ray came there; -1 where one did not.
    """
    if not _all_arrive(points, element, first, each):
        return -1.0
    fit[:] = 0.0
    for r in range(each):
        for axis in range(2):
            at = points[element, axis, first + r] / each
            fit[axis, 0] += at
            for k in range(4):
                fit[axis, 1 + k] += at * DESIGN[r % RAYS, k] * (RAYS / _SQUARES)
    margin = 0.0
    for r in range(each):
        left_x, left_y = points[element, 0, first + r] - fit[0, 0], points[element, 1, first + r] - fit[1, 0]
        for k in range(4):
            left_x -= fit[0, 1 + k] * DESIGN[r % RAYS, k]
            left_y -= fit[1, 1 + k] * DESIGN[r % RAYS, k]
        margin = max(margin, left_x * left_x + left_y * left_y)
    return _SAFETY * math.sqrt(margin)


@kernel
def fill_views(views, used, found, chosen, points, openings, half):
    """The views of candidates `chosen` (n,) from where their rays meet the elements.

    Only those elements are kept that may stop light. They are stored from number `used` on, as far as there is room;
    returns the number behind them.
    """
    ends, first_edge, whole = openings.semi_diameter2, openings.first_edge, openings.whole
    each = half.rays
    fit = np.empty((2, 5))
    for k in range(chosen.size):
        candidate = found.rows[chosen[k]]
        candidate.first_view, candidate.certain, candidate.slack = used, 1, 0.0
        dark = False
        for e in range(ends.size):
            margin, edges = -1.0, first_edge[e + 1] - first_edge[e]
            if not whole[e] or not _all_arrive(points, e, each * k, each):
                candidate.certain = 0
            if ends[e] < math.inf and (edges > 0 or not _is_inside(points, e, each * k, each, math.sqrt(ends[e]))):
                margin = _fitted(fit, points, e, each * k, each)
            if margin < 0.0:
                continue
            radius, far, spread = math.sqrt(ends[e]), math.hypot(fit[0, 0], fit[1, 0]), 0.0
            margin += _ROUNDING * (radius + far)
            for c in range(1, 5):
                spread += math.hypot(fit[0, c], fit[1, c])
            reach = spread + margin
            dark = far - reach > radius
            stops = far + reach > radius
            for j in range(first_edge[e], first_edge[e + 1]):
                nx, ny = openings.edges[j, 0], openings.edges[j, 1]
                over = nx * fit[0, 0] + ny * fit[1, 0] - openings.edges[j, 2] - margin
                wide = 0.0
                for c in range(1, 5):
                    wide += abs(nx * fit[0, c] + ny * fit[1, c])
                stops = stops or over + wide > 0.0
                dark = dark or over > wide
            if dark:
                break
            if stops:
                candidate.slack = max(candidate.slack, margin / reach)
                if used < views.size:
                    _set_view(views[used], fit, candidate, half)
                    views[used].radius, views[used].margin = radius, margin
                    views[used].first_edge, views[used].edges = first_edge[e], edges
                used += 1
        candidate.views = used - candidate.first_view
        if dark:
            used, candidate.views = candidate.first_view, -1
    return used
