"""Linear ray transfer from groups of pixels, through their microlenses, to the elements of the lens: the kernels.

The intersection of a ray with an element is a smooth function of its points in the cell and on the sensor. Rays through
a design of points in the box of both give its linear fit and the largest deviation from it. An edge or a tangent of the
element's opening is then a plane in these four coordinates, with that deviation as its margin.
"""

from __future__ import annotations

import math

import numpy as np

from plenoptic.core.kernels.bundles import pad
from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, STATUS, WEIGHT, L, M, N, X, Y, Z
from plenoptic.core.numba.jit import device, kernel


def _design_points():
    """Points (RAYS, 4): centre, half the corners of a hypercube (a fractional factorial design), axial points."""
    corners = [(x, y, s, x * y * s) for x in (-1, 1) for y in (-1, 1) for s in (-1, 1)]
    axes = [sign * row for row in _AXIAL * np.eye(4) for sign in (-1, 1)]
    return np.array([np.zeros(4), *corners, *axes], dtype=np.float64)


_AXIAL = 0.55
DESIGN = _design_points()
RAYS = len(DESIGN)
_SUM_OF_SQUARES = float((DESIGN[:, 0] ** 2).sum())

_SAFETY = 2.0
"""Factor on margins, for deviations from the linear fit between the points of the design."""
_ROUNDING = 1e-9
"""Added to margins, relative to the size of the opening and the distance of the intersection from its centre."""


@kernel
def fill_transfer_rays(blocks, lenslets, candidates, chosen, centres, half):
    """Aim the rays of the design, once for each wavelength, from groups through candidates `chosen` (n,).

    `centres` (n, 2) are the centres of the groups, `half` the half sides of a group.
    """
    n_rays = half.rays
    n = 0
    for k in range(chosen.size):
        candidate = candidates.rows[chosen[k]]
        for r in range(n_rays):
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
            if candidates.details is not None:
                lenslets[n] = candidates.details[chosen[k]]
            n += 1
    pad(blocks, n)


@device
def _set_transfer(transfer, fit, candidate, half):
    """Convert a linear fit in units of half sides to one in mm from the centres of cell and group."""
    transfer.x_by_x, transfer.x_by_y = fit[0, 1] / candidate.half_x, fit[0, 2] / candidate.half_y
    transfer.y_by_x, transfer.y_by_y = fit[1, 1] / candidate.half_x, fit[1, 2] / candidate.half_y
    transfer.x_by_u, transfer.x_by_v = fit[0, 3] / half.x, fit[0, 4] / half.y
    transfer.y_by_u, transfer.y_by_v = fit[1, 3] / half.x, fit[1, 4] / half.y
    transfer.x = fit[0, 0] - transfer.x_by_x * candidate.x - transfer.x_by_y * candidate.y
    transfer.y = fit[1, 0] - transfer.y_by_x * candidate.x - transfer.y_by_y * candidate.y


@device
def _all_reach(points, element, first, n_rays):
    """True if all rays of a candidate reach an element and none is reflected there."""
    n_reached = 0
    for r in range(first, first + n_rays):
        n_reached += 1 if points[element, 2, r] == 0.0 else 0
    return n_reached == n_rays


@device
def _is_inside(points, element, first, n_rays, radius):
    """True if all rays of a candidate intersect an element inside its circle.

    Corners of the box outside the design are at most twice as far from the centre, in any direction, as those in it;
    another tenth covers nonlinearity.
    """
    if not _all_reach(points, element, first, n_rays):
        return False
    x, y, spread = points[element, 0, first], points[element, 1, first], 0.0
    for r in range(first, first + n_rays):
        dx, dy = points[element, 0, r] - x, points[element, 1, r] - y
        spread = max(spread, dx * dx + dy * dy)
    return math.hypot(x, y) + 2.2 * math.sqrt(spread) <= radius


@device
def _fit_linear(fit, points, element, first, n_rays):
    """Fit a linear function to the intersections (elements, 3, rays) of the design; return its margin.

    Intersections are x, y and status. The margin is -1 if a ray does not reach the element.
    """
    if not _all_reach(points, element, first, n_rays):
        return -1.0
    fit[:] = 0.0
    for r in range(n_rays):
        for axis in range(2):
            position = points[element, axis, first + r] / n_rays
            fit[axis, 0] += position
            for k in range(4):
                fit[axis, 1 + k] += position * DESIGN[r % RAYS, k] * (RAYS / _SUM_OF_SQUARES)
    margin = 0.0
    for r in range(n_rays):
        residual_x, residual_y = points[element, 0, first + r] - fit[0, 0], points[element, 1, first + r] - fit[1, 0]
        for k in range(4):
            residual_x -= fit[0, 1 + k] * DESIGN[r % RAYS, k]
            residual_y -= fit[1, 1 + k] * DESIGN[r % RAYS, k]
        margin = max(margin, residual_x * residual_x + residual_y * residual_y)
    return _SAFETY * math.sqrt(margin)


@kernel
def fill_ray_transfers(transfers, used, candidates, chosen, points, openings, half):
    """Fill the ray transfers of candidates `chosen` (n,) from the intersections of their rays with the elements.

    Elements that cannot stop light have none. Transfers are stored from index `used` on, as far as there is room;
    returns the index after the last one.
    """
    semi_diameter2, first_edge, exact = openings.semi_diameter2, openings.first_edge, openings.exact
    n_rays = half.rays
    fit = np.empty((2, 5))
    for k in range(chosen.size):
        candidate = candidates.rows[chosen[k]]
        candidate.first_transfer, candidate.complete, candidate.slack = used, 1, 0.0
        dark = False
        for e in range(semi_diameter2.size):
            margin, edges, radius = -1.0, first_edge[e + 1] - first_edge[e], math.sqrt(semi_diameter2[e])
            if not exact[e] or not _all_reach(points, e, n_rays * k, n_rays):
                candidate.complete = 0
            if radius < math.inf and (edges > 0 or not _is_inside(points, e, n_rays * k, n_rays, radius)):
                margin = _fit_linear(fit, points, e, n_rays * k, n_rays)
            if margin < 0.0:
                continue
            far, spread = math.hypot(fit[0, 0], fit[1, 0]), 0.0
            margin += _ROUNDING * (radius + far)
            for c in range(1, 5):
                spread += math.hypot(fit[0, c], fit[1, c])
            reach = spread + margin
            dark = far - reach > radius
            stops = far + reach > radius
            for j in range(first_edge[e], first_edge[e + 1]):
                nx, ny = openings.edges[j, 0], openings.edges[j, 1]
                excess = nx * fit[0, 0] + ny * fit[1, 0] - openings.edges[j, 2] - margin
                span = 0.0
                for c in range(1, 5):
                    span += abs(nx * fit[0, c] + ny * fit[1, c])
                stops = stops or excess + span > 0.0
                dark = dark or excess > span
            if dark:
                break
            if stops:
                candidate.slack = max(candidate.slack, margin / reach)
                if used < transfers.size:
                    _set_transfer(transfers[used], fit, candidate, half)
                    transfers[used].radius, transfers[used].margin = radius, margin
                    transfers[used].first_edge, transfers[used].edges = first_edge[e], edges
                used += 1
        candidate.transfers = used - candidate.first_transfer
        if dark:
            used, candidate.transfers = candidate.first_transfer, -1
    return used
