"""Displacement of blurred corners where the main lens's pupil cuts the cone of light through a microlens.

A pixel p sees the corner through the point a of the microlens where the pixel p - kc a sees it through the centre, and
the rim of the pupil likewise where p - ku a does: kc and ku are the radii of both blurs over that of the microlens,
signed. Where the rim cuts the cone, the centre of the visible points a is not 0, and the light at p is that of the
scene elsewhere. By the virtual depth 1 / w of the corner, kc = ku - w.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats

_LEVELS, _WIDTH = (0.5, 0.9), 0.687
"""Fractions of a disc on one side of a straight edge, and the distance of the edge's places over the disc's radius."""
_PIXEL = 1.0 / 3.0
"""Square of the radius of a disc whose points scatter along an axis as those of a pixel do."""
_CHORDS = np.cos(np.linspace(0.0, np.pi, 257))
_LEAST = 0.05
"""Least fraction of the disc that counts."""


def visible_centre(
    visible: Floats, image: NDArray[np.int64], row: NDArray[np.int64], column: NDArray[np.int64]
) -> Floats:
    """Centre (..., 2) of the visible part of a disc, beside a straight edge, over its radius.

    By the visible fractions (n, s, s) in windows; it lies where they increase.
    """
    hidden = (np.arccos(_CHORDS) - _CHORDS * np.sqrt(1.0 - _CHORDS**2)) / np.pi
    moment = 2.0 / (3.0 * np.pi) * (1.0 - _CHORDS**2) ** 1.5
    used = hidden <= 1.0 - _LEAST
    fraction = 1.0 - hidden[used][::-1]
    distance = np.interp(visible[image, row, column], fraction, moment[used][::-1] / fraction)
    last = visible.shape[1] - 1
    rows, columns = ([np.clip(each + step, 0, last) for step in (-1, 0, 1)] for each in (row, column))
    # Differences of means of three pixels.
    increase = np.stack(
        [
            sum(visible[image, rows[2], c] - visible[image, rows[0], c] for c in columns),
            sum(visible[image, r, columns[2]] - visible[image, r, columns[0]] for r in rows),
        ],
        axis=-1,
    )
    length = np.hypot(increase[..., 0], increase[..., 1])
    return np.asarray(increase * (distance / np.maximum(length, 1e-300))[..., None])


def border_blur(visible: Floats) -> Floats:
    """Radius (n,) in pixels of the blur of micro images' borders, by their visible fractions (n, s, s)."""
    wide, narrow = (np.sqrt(np.count_nonzero(visible > level, axis=(1, 2)) / np.pi) for level in _LEVELS)
    return np.asarray((wide - narrow) / _WIDTH)


def cone_displacement(blur: Floats, border: Floats, w: Floats, kind: NDArray[np.int64], pitch: float) -> Floats:
    """Displacement (n,) in pixels of corners, outwards, over `visible_centre`.

    By the blur of each corner and of the border of its micro image, radii in pixels, and the type of its microlens. For
    each type the sign of ku is that with which |ku - w| agrees with the blur; microlenses fill their cells.
    """
    by_depth, rim = 0.5 * pitch * w, np.sqrt(np.maximum(border**2 - _PIXEL, 0.0))
    for k in np.unique(kind):
        rows = kind == k
        misses = [np.median(np.abs(np.abs(sign * rim - by_depth)[rows] - blur[rows])) for sign in (1.0, -1.0)]
        rim[rows] *= 1.0 if misses[0] <= misses[1] else -1.0
    # Pixels that the rim divides are not displaced.
    return np.asarray(np.sign(rim * (rim - by_depth)) * np.abs(rim) / np.maximum(border, 1e-300) * blur)
