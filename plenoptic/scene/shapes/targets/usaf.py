"""The resolution chart of the US Air Force of 1951."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from plenoptic.core.values import Floats, not_negative, positive, whole
from plenoptic.errors import InvalidValueError
from plenoptic.scene.materials.registry import Material
from plenoptic.scene.shapes.targets.checker_layouts import flat_mesh, free_rectangles, in_plane, joined_rectangles, snap
from plenoptic.scene.shapes.targets.target import BRIGHT, DARK, Target

_WIDTHS = 2.0 ** (-np.arange(6) / 6)
"""Width of the bars of each element, in units of those of its group's first one."""

_STEP, _HEIGHT, _LENGTH = 7.0, 5.0, 12.0
"""From element to element down a column, height and length of an element, in widths of its bars."""

_DOWN = _STEP * (_WIDTHS.sum() - _WIDTHS[0] - _WIDTHS[5]) + _HEIGHT * _WIDTHS[5]
_ACROSS = 26.0
"""Height and length of a pair of groups, in widths of the bars of its first element: columns and the first element
leave room between them for the next pair, four times smaller."""

_FIXED = np.array(
    [(_LENGTH * _WIDTHS[1] + _ACROSS - _LENGTH / 2) / 2 - _ACROSS / 8, -(_DOWN - _HEIGHT) / 2 + _DOWN / 8]
) * (4 / 3)
"""The point on which pairs of groups converge, from the upper left corner of a pair: it has each pair in the middle of
the room that the last one leaves. A corner that is offset by d from the last pair's lies 4 / 3 d from the limit."""

LARGEST = 10
"""Numbers of groups go from minus this to this, bars from half a metre to half a micrometre: 1e-12 of the chart's size,
its rounding, is then less than 1e-8 of a bar."""

_ROUNDING = 16 * float(np.finfo(np.float64).eps)


def usaf_1951(
    groups: Iterable[int] = range(6),
    *,
    scale: float = 1.0,
    margin: float | None = None,
    dark: Material = DARK,
    bright: Material = BRIGHT,
) -> Target:
    """The three-bar resolution chart of MIL-STD-150A in the plane z = 0, dark bars on a bright board.

    Element e of group g has three vertical bars and, on their right, three horizontal ones of 2^(g + (e - 1) / 6) line
    pairs per mm. With w, half a line pair, bars are w wide and 5 w long, with gaps of w between them and of 2 w
    between the two sets.

    Groups lie as in the standard's chart: pairs of an even and the next odd one, each pair inside the one before it and
    four times smaller. Elements 2 to 6 of the even group make the left column, its element 1 lies at the lower right,
    below the right column of the odd group's elements 1 to 6. Distances between elements (2 w) and between columns are
    this package's own; numbers and the solid squares are left out.

    Parameters
    ----------
    groups : iterable of int
        Each from -10 to 10; each adds six elements.
    scale : float
        How many times larger the chart is: frequencies are those of the standard divided by it.
    margin : float, optional
        Bright border around the elements in mm; None: twice the width of the widest bar.
    dark, bright : Material
        Of bars and board.

    Returns
    -------
    Target
        Meshes: bars, board. Points: the middle of each element, between its two sets, whose own middles are 3.5 w to
        the left (vertical bars) and to the right of it; each with `index` (group, element) and `frequencies` in line
        pairs per mm, w being 1 / (2 frequency).

    Raises
    ------
    InvalidValueError
        No groups, groups out of range or given twice, a scale that is not above 0, a negative margin.

    Notes
    -----
    MIL-STD-150A, Photographic Lenses, section 5.1.1.7.

    Examples
    --------
    >>> import plenoptic as pl
    >>> chart = pl.targets.usaf_1951(range(-2, 2))
    >>> chart.index[8].tolist(), chart.frequencies[8].round(4)
    ([-1, 3], np.float64(0.63))
    """
    numbers = _groups(groups)
    size = positive(scale, "scale")
    index = np.array([(group, element) for group in numbers for element in range(1, 7)])
    frequencies = 2.0 ** (index[:, 0] + (index[:, 1] - 1) / 6) / size
    width = 0.5 / frequencies
    places = np.array([_place(group, element) for group, element in index.tolist()]) * size
    low, high = places.min(axis=0), (places + width[:, None] * [_LENGTH, _HEIGHT]).max(axis=0)
    border = 2 * width.max() if margin is None else not_negative(margin, "margin", "mm")
    # Elements that lie flush do so to the last bit, so that no slivers are left between their ends.
    x = (places - (low + high) / 2)[:, :1] + width[:, None] * _ACROSS_LINES
    y = (places - (low + high) / 2)[:, 1:] + width[:, None] * _UP_LINES
    x, y = (snap(lines, _ROUNDING * (high - low).max()) for lines in (x, y))
    parts = [_element(*lines) for lines in zip(x, y, strict=True)]
    blocks = np.stack([x[:, 0], y[:, 0], x[:, -1], y[:, -1]], axis=1)
    outer = [*(blocks[:, :2].min(axis=0) - border), *(blocks[:, 2:].max(axis=0) + border)]
    rectangles = np.concatenate([*parts, free_rectangles(outer, blocks)])
    is_bar = np.zeros(len(rectangles), dtype=bool)
    is_bar[: len(parts) * len(_IS_BAR)] = np.tile(_IS_BAR, len(parts))
    corners, faces = joined_rectangles(rectangles)
    meshes = [
        flat_mesh(corners, np.concatenate([faces[k] for k in np.flatnonzero(is_bar)]), dark, "bars"),
        flat_mesh(corners, np.concatenate([faces[k] for k in np.flatnonzero(~is_bar)]), bright, "board"),
    ]
    middles = 0.5 * (blocks[:, :2] + blocks[:, 2:])
    return Target(meshes, in_plane(middles), index, frequencies, "USAF 1951")


def _groups(groups: Iterable[int]) -> list[int]:
    if not isinstance(groups, Iterable) or getattr(groups, "ndim", 1) == 0:
        raise InvalidValueError(f"groups is {groups!r}; it must be a sequence of whole numbers, such as range(-2, 4)")
    numbers = [whole(group, "group", at_least=-LARGEST) for group in groups]
    if not numbers or max(numbers) > LARGEST or len(set(numbers)) < len(numbers):
        raise InvalidValueError(f"groups are {numbers}; give one or more, each once and from {-LARGEST} to {LARGEST}")
    return numbers


def _place(group: int, element: int) -> Floats:
    """Lower left corner of an element in mm, from the point on which groups converge."""
    pair, odd = divmod(group, 2)
    unit = 0.5 * 2.0 ** (-2 * pair)
    widths = _WIDTHS / (1 + odd)
    width = widths[element - 1]
    first = 0 if odd else 1
    left = _ACROSS - _LENGTH * width if odd or element == 1 else 0.0
    below = -_STEP * widths[first : element - 1].sum() - _HEIGHT * width if odd or element > 1 else -_DOWN
    return unit * (np.array([left, below]) - _FIXED)


_ACROSS_LINES, _UP_LINES = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 7.0, 12.0]), np.arange(6.0)
"""Lines between the parts of an element, from its lower left corner, in widths of its bars."""

_IS_BAR = np.array([True, False, True, False, True, False, True, False, True, False, True])


def _element(x: Floats, y: Floats) -> Floats:
    """(11, 4): vertical bars and gaps, the gap between the sets, horizontal bars and gaps from below, as rectangles."""
    upright = [(x[k], y[0], x[k + 1], y[5]) for k in range(6)]
    lying = [(x[6], y[k], x[7], y[k + 1]) for k in range(5)]
    return np.array(upright + lying)
