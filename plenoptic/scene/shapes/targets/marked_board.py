"""A checkerboard with marks that tell its parts apart."""

from __future__ import annotations

import numpy as np

from plenoptic.core.values import length_in_mm, not_negative, whole
from plenoptic.scene.materials.registry import Material
from plenoptic.scene.shapes.targets.boards import squares
from plenoptic.scene.shapes.targets.target import BRIGHT, DARK, Target

_MOST = 64
"""Squares along a side."""
_MARKS = np.unpackbits(np.frombuffer(bytes.fromhex(
    "603d40f2d9439cf67a5f252fb02c4a888d7ebb8925c060e071627f4bfa7605df8b9ac7f4acfa752e0b9bd44f08e61bfe9132727"
    "47027c082a1b9c59ad36ee5b19f69e150c1683545c4b5ab2dc95d1759a84e9631cf543fb5c95239d3480f8e0e4e69a670f7534c"
    "a08a3f4c936bacc175c6f2354c8e4c14761ad09eb2e6d481953c3fdceb6616cd0696712ae29334b13e04256762fa5fe27d42501"
    "8f346b4c3343f7642363203ea21d43a424e7a254bee6f8f9f3fbdeb2e2ffa9d3f849a3bab14e53026f10c6d95ce60de319a14d2"
    "568a74ccceb477da79dacd70f77fe36359d9e38575e41477b79afaa396c16cd0a14ce16e142c38c82d8aaf726faf0a15c181034"
    "7d9b78b77cd8da5c4763237c8d09b4fa4d661150796ceff13c64a98210ff0d62790d6ed7b991f8cb8d9e7d0772fc242ec112acd"
    "9818ab1a18d68f130ce35bce0cf08e20b981b12775abae0f3e1e5d39762ba9caea8de38b6af80133906d60fbcadaab5435c7347"
    "405005ab0ea6e6237db6f75dbf1bd0e8a01e9331a9f06dbcde2b24678c81bd7069b0d10cdcbaceb9a26c4e81b1cbde0027d653e"
    "4da33b83cc24a2feb5318edc35f1a6e66a2c9c1cf19483cb4ac69bf7bb89acce77c16dc4bc7854dad18e61b80217f0b24d38486"
    "93380656c03a766eb9b05c29fda4871c8d2ffc62e7e0d031e34c5dd1715814f966868412af65304782ccbca61359dfe86"
), dtype=np.uint8)).reshape(_MOST, _MOST).astype(bool)  # fmt: skip
"""Any two windows of 4 x 4 squares, in all turns that keep dark squares dark, differ in one square, those of the upper
left 29 x 29 squares in two, of 15 x 15 in three; four to twelve squares have marks. From a search square by square."""


def marked_checkerboard(
    columns: int, rows: int, *, square: float, margin: float = 0.0, dark: Material = DARK, bright: Material = BRIGHT
) -> Target:
    """A checkerboard in the plane z = 0 with a round mark of the other colour in the middle of half of its squares.

    Any 4 x 4 squares tell which they are and how they are turned, so that `pl.calibration.find_corners` does not need
    the whole board in view. A mark is one bit, which is averaged over micro images too small for the codes of ArUco
    markers.

    Parameters
    ----------
    columns, rows : int
        Squares along x and along y, from 4 to 64.
    square : float
        Edge of a square in mm. A mark has 0.3 of it as its diameter.
    margin : float
        Width of a bright border around the squares in mm.
    dark, bright : Material
        The square in the upper left corner is dark.

    Returns
    -------
    Target
        Meshes: dark, bright. Points: the inner corners, as those of `checkerboard`; `marks` has the squares' marks.

    Raises
    ------
    InvalidValueError
        If a number or a length is beyond its limits, which `checkerboard` has too.

    Examples
    --------
    >>> import plenoptic as pl
    >>> board = pl.targets.marked_checkerboard(9, 6, square=2.0, margin=2.0)
    >>> board
    Target('marked checkerboard', 2 meshes, 944 triangles, 40 points)
    >>> board.marks[1].astype(int).tolist()
    [0, 1, 1, 1, 1, 0, 1, 0, 0]
    """
    columns, rows = (whole(n, name, at_least=4, at_most=_MOST) for n, name in ((columns, "columns"), (rows, "rows")))
    edge, border = length_in_mm(square, "square"), not_negative(margin, "margin", "mm")
    return squares(columns, rows, edge, border, dark, bright, _MARKS[:rows, :columns])
