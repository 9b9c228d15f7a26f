"""The microlens array: a lattice of equal lenses that tile a plane."""

from __future__ import annotations

import enum
import math

import numpy as np
from numpy.typing import NDArray

from plenoptic._values import choice, finite, positive, read_only, set_field, value
from plenoptic.errors import InvalidValueError

_HIGH_INDEX = 10.0


class Lattice(enum.IntEnum):
    """How the microlenses lie; one microlens is on the axis.

    Examples
    --------
    >>> import plenoptic as pl
    >>> [lattice.name for lattice in pl.Lattice]
    ['HEXAGONAL', 'SQUARE']
    """

    HEXAGONAL = 0
    """Nearest neighbours along y; columns pitch sqrt(3)/2 apart along x."""
    SQUARE = 1
    """Neighbours along x and y."""


class MicrolensModel(enum.IntEnum):
    """How a microlens refracts.

    PINHOLE: all light of a cell passes its centre, undeviated. THIN: an ideal thin lens in one plane. FLAT_HIGH_INDEX:
    two planes of high index, one with the normals of a sphere, as published Blender models have it. SPHERICAL: an
    exact plano-convex lens of glass.

    Examples
    --------
    >>> import plenoptic as pl
    >>> [model.name for model in pl.MicrolensModel]
    ['PINHOLE', 'THIN', 'FLAT_HIGH_INDEX', 'SPHERICAL']
    """

    PINHOLE = 0
    """All light that reaches the cell passes its centre, undeviated: every depth is sharp. It counts as if the whole
    cell were open, so that images are as bright as with the other models."""
    THIN = 1
    """Ideal thin lens in one plane."""
    FLAT_HIGH_INDEX = 2
    """Two planes of a medium of high index; on one of them light is refracted by the normals of the sphere of radius
    f (index - 1), as if the lens had its curvature but no height (Michels et al. 2018, section 4)."""
    SPHERICAL = 3
    """Exact plano-convex lens: a sphere and a plane of glass."""


class ConvexSide(enum.IntEnum):
    """Which side of a plano-convex microlens is curved.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.ConvexSide.SCENE.name
    'SCENE'
    """

    SCENE = 0
    SENSOR = 1


@value
class MicrolensArray:
    """A plane tiled by equal microlenses.

    Parameters
    ----------
    pitch : float
        Distance between nearest neighbours in mm.
    focal_lengths : tuple of float
        Focal length in mm, at 587.6 nm; positive for convex lenses, and in the models THIN and PINHOLE also negative.
    lattice : Lattice
    model : MicrolensModel
        PINHOLE, THIN, or one of the plates FLAT_HIGH_INDEX and SPHERICAL with the fields below.
    thickness : float
        Plates: axial thickness in mm, from the vertex of the curved side to the flat side.
    index : float
        Plates: refractive index at 587.6 nm; the radius of curvature is f (index - 1). FLAT_HIGH_INDEX: at least 10.
    convex_side : ConvexSide
        Plates: where the curved side faces.

    Raises
    ------
    InvalidValueError
        For a pitch or thickness that is not positive, a focal length of 0, an index that is too low,
        a sphere too small to cover its cell, or a lattice, model or side that is none.

    Examples
    --------
    >>> import plenoptic as pl
    >>> array = pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,), lattice=pl.Lattice.HEXAGONAL)
    >>> f"{array.cell_area:.6f} mm^2"
    '0.040780 mm^2'
    """

    pitch: float
    focal_lengths: tuple[float, ...]
    lattice: Lattice = Lattice.HEXAGONAL
    model: MicrolensModel = MicrolensModel.THIN
    thickness: float = 0.1
    index: float = 1.5
    convex_side: ConvexSide = ConvexSide.SCENE

    def __post_init__(self) -> None:
        set_field(self, "pitch", positive(self.pitch, "pitch", "mm"))
        given = self.focal_lengths if isinstance(self.focal_lengths, tuple | list) else (self.focal_lengths,)
        focal_lengths = tuple(finite(f, "focal_lengths") for f in given)
        if len(focal_lengths) != 1:
            raise InvalidValueError(
                f"focal_lengths has {len(focal_lengths)} entries; arrays have one kind of microlens, give (f,)"
            )
        if focal_lengths[0] == 0:
            raise InvalidValueError("a focal length of 0 mm is impossible; give the focal length in mm, such as 2.0")
        set_field(self, "focal_lengths", focal_lengths)
        set_field(self, "lattice", choice(self.lattice, Lattice, "lattice"))
        set_field(self, "model", choice(self.model, MicrolensModel, "model"))
        set_field(self, "convex_side", choice(self.convex_side, ConvexSide, "convex_side"))
        set_field(self, "thickness", positive(self.thickness, "thickness of the microlenses", "mm"))
        set_field(self, "index", finite(self.index, "index of the microlenses"))
        if not self.index > 1:
            raise InvalidValueError(f"index of the microlenses is {self.index}; it must be above 1")
        if self.is_plate:
            self._check_plate()

    def _check_plate(self) -> None:
        if self.focal_lengths[0] < 0:
            raise InvalidValueError(
                f"focal length {self.focal_lengths[0]:g} mm: a plano-convex microlens collects light; use one above 0"
            )
        if self.radius < self.cell_radius:
            raise InvalidValueError(
                f"radius of curvature {self.radius:g} mm is below the cell's corner at {self.cell_radius:g} mm; "
                "increase the focal length or the index, or reduce the pitch"
            )
        if self.model is MicrolensModel.FLAT_HIGH_INDEX:
            if self.index < _HIGH_INDEX:
                raise InvalidValueError(
                    f"index of the microlenses is {self.index:g}; FLAT_HIGH_INDEX stands for a nearly flat lens and "
                    f"needs at least {_HIGH_INDEX:g}: give index=100.0, or choose SPHERICAL"
                )
            return
        sag = self.cell_radius**2 / (self.radius + math.sqrt(self.radius**2 - self.cell_radius**2))
        if sag > self.thickness:
            raise InvalidValueError(
                f"thickness {self.thickness:g} mm is below the sag {sag:g} mm at the cell's corner; increase it"
            )

    @property
    def focal_length(self) -> float:
        """Focal length of the lens on the axis in mm."""
        return self.focal_lengths[0]

    @property
    def is_plate(self) -> bool:
        """Whether rays pass two surfaces of glass, so that thickness, index and convex side matter."""
        return self.model in (MicrolensModel.FLAT_HIGH_INDEX, MicrolensModel.SPHERICAL)

    @property
    def radius(self) -> float:
        """Plates: radius of curvature in mm, f (index - 1)."""
        return self.focal_length * (self.index - 1.0)

    @property
    def principal_separation(self) -> float:
        """Distance from the front to the rear principal plane in mm: 0 for a thin lens."""
        return self.thickness * (1.0 - 1.0 / self.index) if self.is_plate else 0.0

    @property
    def basis(self) -> NDArray[np.float64]:
        """(2, 2) array: rows are the lattice vectors in mm; centres are their whole multiples."""
        if self.lattice is Lattice.HEXAGONAL:
            vectors = [[self.pitch * math.sqrt(3) / 2, self.pitch / 2], [0.0, self.pitch]]
        else:
            vectors = [[self.pitch, 0.0], [0.0, self.pitch]]
        return read_only(np.array(vectors))

    @property
    def cell_edges(self) -> NDArray[np.float64]:
        """(k, 3) array: outward normal x, y and distance from the centre of each edge of a cell."""
        sides, first = (6, math.pi / 6) if self.lattice is Lattice.HEXAGONAL else (4, 0.0)
        angle = first + 2 * math.pi * np.arange(sides) / sides
        distance = np.full(sides, self.pitch / 2)
        return read_only(np.stack([np.cos(angle), np.sin(angle), distance], axis=1))

    @property
    def cell_radius(self) -> float:
        """Distance from a cell's centre to its corners in mm."""
        return self.pitch / math.sqrt(3) if self.lattice is Lattice.HEXAGONAL else self.pitch / math.sqrt(2)

    @property
    def cell_corners(self) -> NDArray[np.float64]:
        """(k, 2) array: corners of the cell on the axis in mm, counter-clockwise."""
        sides, first = (6, 0.0) if self.lattice is Lattice.HEXAGONAL else (4, math.pi / 4)
        angle = first + 2 * math.pi * np.arange(sides) / sides
        return read_only(self.cell_radius * np.stack([np.cos(angle), np.sin(angle)], axis=1))

    @property
    def cell_area(self) -> float:
        """Area of a cell in mm^2."""
        return abs(float(np.linalg.det(self.basis)))

    def nearest(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Centres of the cells that hold points.

        Parameters
        ----------
        points : (n, 2) array
            Points on the plane of the array in mm.

        Returns
        -------
        (n, 2) array
            Centres in mm.

        Examples
        --------
        >>> import numpy as np, plenoptic as pl
        >>> array = pl.MicrolensArray(pitch=1.0, focal_lengths=(2.0,), lattice=pl.Lattice.SQUARE)
        >>> array.nearest(np.array([[0.6, 0.4]]))
        array([[1., 0.]])
        """
        base = np.floor(np.asarray(points) @ np.linalg.inv(self.basis))
        corners = np.stack([base + step for step in ([0, 0], [0, 1], [1, 0], [1, 1])]) @ self.basis
        distance = np.linalg.norm(corners - points, axis=-1)
        return np.asarray(np.take_along_axis(corners, distance.argmin(axis=0)[None, :, None], axis=0)[0])
