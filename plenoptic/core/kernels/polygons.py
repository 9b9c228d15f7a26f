"""Convex polygons: device functions. Corners are columns of an array (3, room): x, y and a buffer for distances."""

from __future__ import annotations

import math

from plenoptic.core.numba.jit import device


@device
def cut(polygon, first, n, a, b, limit):
    """Clip a polygon by the half-plane a x + b y <= limit; its n corners begin at `first`. Return the new number.

    The corners inside are consecutive: the clipped polygon begins where the line enters and ends where it leaves.
    """
    inside = 0
    for i in range(first, first + n):
        distance = limit - (a * polygon[0, i] + b * polygon[1, i])
        polygon[2, i] = distance
        inside += 1 if distance >= 0.0 else 0
    if inside == n or inside == 0:
        return inside
    behind = first + n
    start = first
    if polygon[2, behind - 1] >= 0.0 and polygon[2, first] >= 0.0:
        while polygon[2, start] >= 0.0:
            start += 1
    while polygon[2, start] < 0.0:
        start = start + 1 if start + 1 < behind else first
    end = start + inside - 1
    end = end if end < behind else end - n
    before, after = start - 1 if start > first else behind - 1, end + 1 if end + 1 < behind else first
    f = polygon[2, end] / (polygon[2, end] - polygon[2, after])
    leave_x = polygon[0, end] + f * (polygon[0, after] - polygon[0, end])
    leave_y = polygon[1, end] + f * (polygon[1, after] - polygon[1, end])
    f = polygon[2, start] / (polygon[2, start] - polygon[2, before])
    enter_x = polygon[0, start] + f * (polygon[0, before] - polygon[0, start])
    enter_y = polygon[1, start] + f * (polygon[1, before] - polygon[1, start])
    if start == first:
        leave, enter = first + inside, first + inside + 1
    elif start <= end:
        # To the front.
        leave, enter = first + inside + 1, first
        for i in range(inside):
            polygon[0, first + 1 + i], polygon[1, first + 1 + i] = polygon[0, start + i], polygon[1, start + i]
    else:
        leave, enter = end + 1, end + 2
        if start == end + 2:
            for i in range(behind - 1, start - 1, -1):
                polygon[0, i + 1], polygon[1, i + 1] = polygon[0, i], polygon[1, i]
        elif start != end + 3:
            for i in range(behind - start):
                polygon[0, end + 3 + i], polygon[1, end + 3 + i] = polygon[0, start + i], polygon[1, start + i]
    polygon[0, leave], polygon[1, leave] = leave_x, leave_y
    polygon[0, enter], polygon[1, enter] = enter_x, enter_y
    return inside + 2


@device
def area_of(polygon, first, n):
    """Area of a polygon."""
    twice = 0.0
    x, y = polygon[0, first], polygon[1, first]
    for q in range(first + 1, first + n - 1):
        ax, ay = polygon[0, q] - x, polygon[1, q] - y
        twice += ax * (polygon[1, q + 1] - y) - ay * (polygon[0, q + 1] - x)
    return 0.5 * twice


@device
def point_in(polygon, first, n, area, v):
    """Point of the triangle of the polygon's fan at cumulative area `area`, at the fraction v across the triangle."""
    x, y = polygon[0, first], polygon[1, first]
    k = first + 1
    ax, ay = polygon[0, k] - x, polygon[1, k] - y
    bx, by = polygon[0, k + 1] - x, polygon[1, k + 1] - y
    remaining, twice = 2.0 * area, ax * by - ay * bx
    while remaining >= twice and k < first + n - 2:
        remaining -= twice
        k += 1
        ax, ay = bx, by
        bx, by = polygon[0, k + 1] - x, polygon[1, k + 1] - y
        twice = ax * by - ay * bx
    root = math.sqrt(min(max(remaining / twice, 0.0), 1.0)) if twice > 0.0 else 0.0
    a, b = root * (1.0 - v), root * v
    return x + a * ax + b * bx, y + a * ay + b * by
