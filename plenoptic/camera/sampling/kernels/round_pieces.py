"""Round pieces: images of round openings that lie within the cells of their microlenses, sampled as ellipses."""

from __future__ import annotations

import math

from plenoptic.camera.sampling.kernels.aimed_rays import displaced_point
from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, STATUS, WEIGHT, L, M, N, X, Y, Z
from plenoptic.core.kernels.sincos import turn
from plenoptic.core.numba.jit import device

ROUND_CORNERS = 24
"""Corners of the polygon of a round piece, a multiple of 4."""
ROUND_SCALE = math.sqrt(math.pi / (0.5 * ROUND_CORNERS * math.sin(2.0 * math.pi / ROUND_CORNERS)))
"""Its circumscribed circle over the ellipse of the same area."""


@device
def fill_motion(motion, transfer, det):
    """Motion over the pixel of the image of an opening, a matrix; `det` is the determinant of the transfer."""
    motion[0] = (transfer.x_by_y * transfer.y_by_u - transfer.y_by_y * transfer.x_by_u) / det
    motion[1] = (transfer.x_by_y * transfer.y_by_v - transfer.y_by_y * transfer.x_by_v) / det
    motion[2] = (transfer.y_by_x * transfer.x_by_u - transfer.x_by_x * transfer.y_by_u) / det
    motion[3] = (transfer.y_by_x * transfer.x_by_v - transfer.x_by_x * transfer.y_by_v) / det


@device
def fill_round_piece(polygon, motion, transfer, candidate, corners, where):
    """Polygon of the area of the image of a round opening, if all of that lies in the cell for all points of the pixel.

    Returns the area of the image, an ellipse that moves over the pixel; 0 if it is none. `where` is a rectangle of the
    sensor as in `fill_planes`.
    """
    (u, v), half = where
    det = transfer.x_by_x * transfer.y_by_y - transfer.x_by_y * transfer.y_by_x
    radius = transfer.radius + transfer.margin
    if transfer.edges > 0 or abs(det) * candidate.half_x * candidate.half_y <= transfer.margin * transfer.margin:
        return 0.0
    fill_motion(motion, transfer, det)
    x = (transfer.x_by_y * transfer.y - transfer.y_by_y * transfer.x) / det + motion[0] * u + motion[1] * v
    y = (transfer.y_by_x * transfer.x - transfer.x_by_x * transfer.y) / det + motion[2] * u + motion[3] * v
    for q in range(candidate.corners):
        corner, next_corner = candidate.first_corner + q, candidate.first_corner + (q + 1) % candidate.corners
        a, b = corners[1, next_corner] - corners[1, corner], corners[0, corner] - corners[0, next_corner]
        reach = (
            radius
            / abs(det)
            * math.hypot(a * transfer.y_by_y - b * transfer.y_by_x, b * transfer.x_by_x - a * transfer.x_by_y)
        )
        reach += abs(a * motion[0] + b * motion[2]) * half[0] + abs(a * motion[1] + b * motion[3]) * half[1]
        if a * (x - corners[0, corner]) + b * (y - corners[1, corner]) + reach > 0.0:
            return 0.0
    scale = ROUND_SCALE * radius / det
    for q in range(ROUND_CORNERS):
        angle = math.copysign(2.0 * math.pi * q / ROUND_CORNERS, det)
        on_x, on_y = scale * math.cos(angle), scale * math.sin(angle)
        polygon[0, q] = x + transfer.y_by_y * on_x - transfer.x_by_y * on_y
        polygon[1, q] = y - transfer.y_by_x * on_x + transfer.x_by_x * on_y
    return math.pi * radius * radius / abs(det)


@device
def point_in_ellipse(corners, first, u, v):
    """Point of the ellipse of a round piece, uniformly by area."""
    opposite, right, left = first + ROUND_CORNERS // 2, first + ROUND_CORNERS // 4, first + 3 * ROUND_CORNERS // 4
    c, s = turn(v)
    r = 0.5 * math.sqrt(u) / ROUND_SCALE
    c, s = r * c, r * s
    x = 0.5 * (corners[0, first] + corners[0, opposite])
    y = 0.5 * (corners[1, first] + corners[1, opposite])
    x += c * (corners[0, first] - corners[0, opposite]) + s * (corners[0, right] - corners[0, left])
    y += c * (corners[1, first] - corners[1, opposite]) + s * (corners[1, right] - corners[1, left])
    return x, y


@device
def aim_round_run(blocks, at, run, points, u, regions, place):
    """Aim `run` paths, from index `at` of a bundle on, at the round piece that is a pixel's whole region.

    Their random numbers are u (4, run), `points` (4, BLOCK) is a workspace, and `place` is the piece's number, the
    `PixelRecord` and the pixel's centre. Loops over the paths of a block are vectorised.
    """
    (chosen, pixel, centre), corners, first = place, regions.corners, 0
    piece = regions.pieces[chosen]
    while first < run:
        count = min(run - first, BLOCK - at % BLOCK)
        for k in range(count):
            random = u[2, first + k], u[3, first + k]
            points[0, k], points[1, k] = point_in_ellipse(corners, piece.first_corner, random[0], random[1])
            points[2, k], points[3, k] = pixel.width * (u[0, first + k] - 0.5), pixel.height * (u[1, first + k] - 0.5)
        for k in range(count):
            dx, dy = points[2, k], points[3, k]
            x, y = displaced_point(piece, (points[0, k], points[1, k]), (dx, dy))
            points[0, k], points[1, k] = piece.cell_x + x, piece.cell_y + y
            points[2, k], points[3, k] = points[0, k] - (centre[0] + dx), points[1, k] - (centre[1] + dy)
        begin = (at // BLOCK) * RAY + at % BLOCK
        for k in range(count):
            blocks[begin + X + k], blocks[begin + Y + k] = points[0, k], points[1, k]
            blocks[begin + L + k], blocks[begin + M + k] = points[2, k], points[3, k]
            blocks[begin + Z + k], blocks[begin + N + k] = piece.axis_x, piece.axis_y
            blocks[begin + WEIGHT + k], blocks[begin + STATUS + k] = piece.area, 0.0
        first += count
        at += count
