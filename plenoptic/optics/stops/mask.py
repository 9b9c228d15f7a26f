"""Stops defined by an image of their transmission."""

from __future__ import annotations

import dataclasses
import os

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.display import picture_of
from plenoptic.core.files.file_limits import DEFAULT, FileLimits
from plenoptic.core.values import MAX_POINTS, Floats, broadcast, frozen_array, length_in_mm, set_field, value, whole
from plenoptic.errors import InvalidValueError
from plenoptic.optics.element_record import MASK, ElementRow
from plenoptic.optics.lens.placement import Placement, set_place
from plenoptic.optics.stops.polygon import convex_hull, subdivide


@value
class MaskStop:
    """A stop defined by an image of its transmission: any shape, several holes, grey levels.

    The transmission is constant over a cell of the image, and 0 outside of the image. Seen from the sensor along -z
    with y up, the mask has the orientation of the image: row 0 at the top, towards +y, and column 0 on the left,
    towards -x. The micro images of a white image show the iris in this orientation too. The weight of a ray is
    multiplied by the transmission at its intersection; if that is 0, the ray is clipped.

    Parameters
    ----------
    transmission : (H, W) array
        From 0, opaque, to 1, clear; above 0 somewhere. The centre of the image is on the axis.
    semi_diameter : float
        Radius in mm of the smallest circle about the axis that contains all non-opaque cells: the distance of their
        outermost corners. An opaque border has no effect. See `of_cells` for the size of a cell.
    thickness, placement
        As of `CircularStop`.

    Raises
    ------
    InvalidValueError
        If a number is out of range, or the image is opaque everywhere.

    Examples
    --------
    >>> import plenoptic as pl
    >>> mask = pl.optics.MaskStop([[0.0, 1.0], [0.5, 0.0]], semi_diameter=2.0**0.5)
    >>> mask.cell_size, mask.area
    (1.0, 1.5)
    >>> mask.transmission_at([0.5, -0.5], [0.5, -0.5]).tolist()
    [1.0, 0.5]
    """

    transmission: ArrayLike
    semi_diameter: float
    thickness: float = 0.0
    placement: Placement | None = dataclasses.field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        cells = frozen_array(self.transmission, name="transmission", shape=("rows", "columns"))
        set_field(self, "transmission", cells)
        set_place(self)
        if not ((cells >= 0) & (cells <= 1)).all():
            invalid = cells[~((cells >= 0) & (cells <= 1))][0]
            raise InvalidValueError(f"transmission holds {invalid:g}; it must be from 0, opaque, to 1, clear: scale it")
        if not cells.any():
            raise InvalidValueError("transmission is 0 everywhere; at least one cell must transmit light")

    @classmethod
    def of_cells(
        cls, transmission: ArrayLike, cell_size: float, *, thickness: float = 0.0, placement: Placement | None = None
    ) -> MaskStop:
        """A mask whose cells are squares of `cell_size` mm.

        Examples
        --------
        >>> import plenoptic as pl
        >>> pl.optics.MaskStop.of_cells([[1.0, 1.0], [1.0, 1.0]], 3.0).semi_diameter
        4.242640687119286
        """
        unit = cls(transmission, 1.0, thickness, placement=placement)
        return dataclasses.replace(unit, semi_diameter=length_in_mm(cell_size, "cell_size") / unit.cell_size)

    @classmethod
    def load(
        cls,
        path: str | os.PathLike[str],
        semi_diameter: float,
        *,
        thickness: float = 0.0,
        placement: Placement | None = None,
        limits: FileLimits = DEFAULT,
    ) -> MaskStop:
        """A mask from an image file: white is clear, black is opaque.

        Parameters
        ----------
        path : path-like
            Any file that `images.read_linear` reads; colours become the mean of their channels. Grey levels of integer
            files are decoded from sRGB to linear transmissions. Only exact black is opaque: files with lossy
            compression (JPEG) have open specks.
        semi_diameter, thickness, placement
            As of the class.
        limits : FileLimits
            Limits of the size of the file, and of the image.

        Raises
        ------
        FileError
            If the file cannot be read.
        InvalidValueError
            If it holds values above 1, or is black.

        Examples
        --------
        >>> import pathlib, tempfile, numpy as np, plenoptic as pl
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = pathlib.Path(folder) / "mask.exr"
        ...     pl.images.write_channels(path, {"Y": np.eye(3)})
        ...     mask = pl.optics.MaskStop.load(path, semi_diameter=5.0)
        >>> mask.transmission.tolist()
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
        """
        from plenoptic.core.files.images import read_linear

        cells = read_linear(path, limits=limits).mean(axis=2, dtype=np.float64)
        return cls(cells, semi_diameter, thickness, placement=placement)

    @property
    def cell_size(self) -> float:
        """Side of a cell in mm."""
        corners = _open_corners(np.asarray(self.transmission))
        return self.semi_diameter / float(np.hypot(*corners.T).max())

    @property
    def area(self) -> float:
        """Integral of the transmission in mm^2."""
        return float(np.sum(self.transmission)) * self.cell_size**2

    def transmission_at(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Transmission at points (x, y), mm; x and y are broadcast."""
        cells, per_mm = np.asarray(self.transmission), 1.0 / self.cell_size
        rows, columns = cells.shape
        x, y = broadcast(x=x, y=y)
        u, v = 0.5 * columns + x * per_mm, 0.5 * rows - y * per_mm
        inside = (u >= 0) & (u <= columns) & (v >= 0) & (v <= rows)
        column = np.minimum(np.where(inside, u, 0.0).astype(np.intp), columns - 1)
        row = np.minimum(np.where(inside, v, 0.0).astype(np.intp), rows - 1)
        return np.asarray(np.where(inside, cells[row, column], 0.0))

    def contains(self, x: ArrayLike, y: ArrayLike) -> NDArray[np.bool_]:
        """True where the transmission at points (x, y), mm, is above 0; x and y are broadcast."""
        return np.asarray(self.transmission_at(x, y) > 0)

    def outline(self, n: int = 64) -> Floats:
        """Points on the convex hull of all open cells, counter-clockwise, in mm.

        A (k, 2) array with k at least n, not closed: the corners of the hull, and points that divide its sides.
        """
        corners = convex_hull(self.cell_size * _open_corners(np.asarray(self.transmission)))
        return subdivide(corners, whole(n, "n", at_least=3, at_most=MAX_POINTS))

    def row(self) -> ElementRow:
        """Record of the stop for kernels."""
        cells = np.asarray(self.transmission)
        return ElementRow(MASK, self.semi_diameter * self.semi_diameter, cells=cells, cells_per_mm=1.0 / self.cell_size)

    def image(self, scale: float) -> MaskStop:
        """Image of the stop by a lens of magnification `scale`: scaled, and rotated by half a turn if negative."""
        cells = np.asarray(self.transmission)
        return MaskStop(cells[::-1, ::-1] if scale < 0 else cells, abs(scale) * self.semi_diameter)

    @property
    def filled_radius(self) -> float:
        """Radius in mm of the circle that holds all open cells; it stands for the unknown inner radius of a mask."""
        return self.semi_diameter

    _repr_html_ = picture_of


def _open_corners(cells: Floats) -> Floats:
    """Corners (k, 2) of the first and the last open cell of each row, x and y in cells from the centre."""
    rows, columns = cells.shape
    open_rows = np.flatnonzero(cells.any(axis=1))
    left = (cells[open_rows] > 0).argmax(axis=1) - 0.5 * columns
    right = 0.5 * columns - (cells[open_rows, ::-1] > 0).argmax(axis=1)
    top = 0.5 * rows - open_rows
    sides = [(x, y) for x in (left, right) for y in (top, top - 1.0)]
    return np.concatenate([np.stack(side, axis=1) for side in sides])
