"""The microlens array: lenses on a lattice, of one or several types, or at listed centres."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.display import picture_of
from plenoptic.core.values import (
    SMALLEST_LENGTH,
    Floats,
    Given,
    choice,
    coordinate,
    finite,
    frozen_array,
    length_in_mm,
    positions,
    read_only,
    set_field,
    value,
)
from plenoptic.errors import InvalidValueError
from plenoptic.optics.coatings.coating import SurfaceCoating
from plenoptic.optics.coatings.surface_powers import check_coating
from plenoptic.optics.glass.media import Medium, check_medium
from plenoptic.optics.microlens.aperture import MicrolensAperture, Opening, Walls, opening_of
from plenoptic.optics.microlens.imperfections import Imperfections, MicrolensDeviations, MicrolensImperfections
from plenoptic.optics.microlens.lattice import (
    Lattice,
    cell_polygon,
    checked_extent,
    checked_pitch,
    default_pattern,
    lattice_basis,
    polygon_area,
    polygon_edges,
)
from plenoptic.optics.microlens.lenslets import Lenslets, lenslets
from plenoptic.optics.microlens.models import MicrolensModel
from plenoptic.optics.microlens.plano_convex import ConvexSide

_MAX_DISTANCES = 1 << 22
_DESIGN_WAVELENGTH, _DEFAULT_INDEX = 587.6, 1.5
"""Wavelength of the focal lengths in nm, and the index of microlenses without a medium."""
_MAX_PITCHES = 1e6
"""Limit of the extent of listed centres, which are sorted into bins of two pitches."""


@value
class MicrolensArray:
    """Microlenses in a plane, centred on a lattice or listed.

    Parameters
    ----------
    pitch : float or (float, float)
        Distance between nearest neighbours in mm; RECTANGULAR: along x and y. FREE: largest extent of a cell from its
        centre along x and y.
    focal_lengths : tuple of float
        Focal length of each type of microlens in mm, in the medium behind the main lens, at 587.6 nm. Positive for
        convex lenses, and in the models THIN and PINHOLE also negative.
    lattice : Lattice
    model : MicrolensModel
        PINHOLE, THIN, or one of the plates FLAT_HIGH_INDEX and SPHERICAL with the fields below.
    thickness : float
        Plates: axial thickness in mm, from the vertex of the curved side to the flat side.
    index : float
        Plates: refractive index at 587.6 nm, relative to that medium. The radius of curvature is f (index - 1).
        FLAT_HIGH_INDEX: at least 10.
    convex_side : ConvexSide
        Plates: direction in which the curved side faces.
    pattern : (p, q) array of int, optional
        Type of the lens (i, j), whose centre is i a + j b with the rows a, b of `basis`: pattern[i mod p, j mod q].
        None: (i - j) mod the number of types, with which hexagonal arrays of three types have no equal neighbours.
    centres : (n, 2) array, optional
        FREE: the centres in mm.
    types : (n,) array of int, optional
        FREE: the type of each lens; None: all are of the first.
    aperture : MicrolensAperture, optional
        Openings of the lenses and the gaps between them; None: lenses fill their cells.
    medium : Medium, optional
        Material of the lenses, anything that `Surface` accepts; `index` is then its index at 587.6 nm and is left
        out. Surfaces keep their curvature, so that the power is proportional to index - 1; a PINHOLE has no power.
        Like `index` it counts as relative to the medium behind the main lens: a glass of a catalogue is right in air
        only. None: the index is the same at all wavelengths.
    extent : (float, float), optional
        Width and height in mm, along x and y, of the part of the plane in which a microlens has its centre. An opaque
        frame surrounds these lenses: they are whole, and pixels that see none of them are dark. None: microlenses
        wherever light arrives. FREE lattices list their lenses in place of it.
    walls : Walls
        OPAQUE separates the spaces behind the cells, up to the sensor, as in an array of cameras.
    imperfections : MicrolensImperfections or MicrolensDeviations, optional
        Deviations of individual lenses from this design; None: no deviations.
    coating : SingleLayer, Coating or Reflectance, optional
        SPHERICAL: coating of both sides, by which images lose the light that these reflect and absorb, and that a
        medium with an internal transmittance absorbs; ``Coating()`` is bare glass. Films lie from the medium behind
        the main lens to the glass. None: no light is lost.

    Raises
    ------
    InvalidValueError
        If the medium is invalid, or given together with another index; a pitch or thickness is not positive, a focal
        length is 0, an index is too low, a sphere is too small to cover its cell, centres coincide, or a type, lattice,
        model or side does not exist, or another model than SPHERICAL has a coating; a PrescriptionError for a coating
        that is none.

    Notes
    -----
    Arrays take no memory for each lens unless lenses are listed or have imperfections.

    Examples
    --------
    >>> import plenoptic as pl
    >>> array = pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,), lattice=pl.Lattice.HEXAGONAL)
    >>> f"{array.cell_area:.6f} mm^2"
    '0.040780 mm^2'
    >>> multi_focus = pl.MicrolensArray(pitch=0.217, focal_lengths=(1.7, 2.0, 2.4))
    >>> multi_focus.lenses((-0.3, -0.3), (0.3, 0.3)).type.tolist()
    [2, 1, 1, 0, 2, 2, 1]
    >>> glass = pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,), model=pl.optics.MicrolensModel.SPHERICAL,
    ...     convex_side=pl.optics.ConvexSide.SENSOR, walls=pl.optics.Walls.OPAQUE)
    >>> f"{glass.radius:g} mm"
    '1 mm'
    """

    pitch: float | tuple[float, float]
    focal_lengths: tuple[float, ...]
    lattice: Lattice = Lattice.HEXAGONAL
    model: MicrolensModel = MicrolensModel.THIN
    thickness: float = 0.1
    index: float = _DEFAULT_INDEX
    convex_side: ConvexSide = ConvexSide.SCENE
    _: dataclasses.KW_ONLY
    pattern: Given[NDArray[np.int64] | None, ArrayLike | None] = Given(default=None)
    centres: Given[Floats | None, ArrayLike | None] = Given(default=None)
    types: Given[NDArray[np.int64] | None, ArrayLike | None] = Given(default=None)
    aperture: MicrolensAperture | None = None
    imperfections: Imperfections | None = None
    extent: tuple[float, float] | None = None
    walls: Walls = Walls.NONE
    medium: Medium | None = None
    coating: SurfaceCoating | None = None

    def __post_init__(self) -> None:
        set_field(self, "lattice", choice(self.lattice, Lattice, "lattice"))
        set_field(self, "pitch", checked_pitch(self.pitch, self.lattice))
        lengths = self.focal_lengths if isinstance(self.focal_lengths, tuple | list) else (self.focal_lengths,)
        focal_lengths = tuple(coordinate(f, "focal_lengths") for f in lengths)
        if not focal_lengths or min(map(abs, focal_lengths)) < SMALLEST_LENGTH:
            raise InvalidValueError(
                f"focal_lengths is {focal_lengths}; give one in mm for each type, not 0, such as (2.0,)"
            )
        set_field(self, "focal_lengths", focal_lengths)
        set_field(self, "model", choice(self.model, MicrolensModel, "model"))
        set_field(self, "convex_side", choice(self.convex_side, ConvexSide, "convex_side"))
        set_field(self, "thickness", length_in_mm(self.thickness, "thickness of the microlenses"))
        set_field(self, "index", finite(self.index, "index of the microlenses"))
        self._check_medium()
        if not self.index > 1:
            raise InvalidValueError(f"index of the microlenses is {self.index}; it must be above 1")
        set_field(self, "walls", choice(self.walls, Walls, "walls"))
        if self.extent is not None:
            set_field(self, "extent", checked_extent(self.extent, self.lattice))
        self._check_types()
        for name, kinds in (
            ("aperture", (MicrolensAperture,)),
            ("imperfections", (MicrolensImperfections, MicrolensDeviations)),
        ):
            if getattr(self, name) is not None and not isinstance(getattr(self, name), kinds):
                raise InvalidValueError(f"{name} is {getattr(self, name)!r}; it must be a {kinds[0].__name__} or None")
        if self.aperture is not None:
            _ = self.opening
        check_coating(self.coating)
        if self.coating is not None and not (self.is_plate and not self.model.is_flat):
            raise InvalidValueError(
                f"coating is given for {self.model.name} microlenses, which have no surfaces of glass that could "
                "reflect light; leave it out, or take MicrolensModel.SPHERICAL"
            )
        self.model.refraction.check(self)

    def _check_medium(self) -> None:
        """Set the index to that of the medium at the wavelength of the focal lengths."""
        if self.medium is None:
            return
        check_medium(self.medium, "medium of the microlenses")
        index = finite(self.medium.index(_DESIGN_WAVELENGTH), "index of the medium of the microlenses")
        if self.index not in (_DEFAULT_INDEX, index):
            raise InvalidValueError(
                f"index of the microlenses is {self.index:g}, and their medium has {index:g} at 587.6 nm; leave one of "
                f"them out (index={_DEFAULT_INDEX:g} is left out)"
            )
        set_field(self, "index", index)

    def _check_types(self) -> None:
        free = self.lattice is Lattice.FREE
        for name in ("centres", "types") if not free else ("pattern",):
            if getattr(self, name) is not None:
                raise InvalidValueError(
                    f"{name} is given for the lattice {self.lattice.name}; "
                    + ("list types instead" if free else "it belongs to Lattice.FREE: leave it out")
                )
        if free:
            if self.centres is None:
                raise InvalidValueError("the lattice is FREE and has no centres; give centres, an (n, 2) array in mm")
            set_field(self, "centres", positions(self.centres, name="centres", shape=("n", 2)))
            if not len(self.centres):
                raise InvalidValueError("centres is empty; list centres in mm")
            if (extent := float(np.ptp(self.centres, axis=0).max())) > _MAX_PITCHES * max(self.pitches):
                raise InvalidValueError(
                    f"centres reach over {extent:g} mm, more than {_MAX_PITCHES:g} times the pitch "
                    f"{max(self.pitches):g} mm; give both in mm"
                )
            if len(np.unique(self.centres, axis=0)) < len(self.centres):
                raise InvalidValueError("centres lists a place twice; give each microlens its own")
        for name, shape in (("pattern", ("p", "q")), ("types", (None if self.centres is None else len(self.centres),))):
            values = getattr(self, name)
            if values is None:
                continue
            array = frozen_array(values, name=name, shape=shape, dtype=np.int64)
            if not array.size or array.min() < 0 or array.max() >= len(self.focal_lengths):
                raise InvalidValueError(
                    f"{name} holds types outside 0 to {len(self.focal_lengths) - 1}; give each a focal length"
                )
            set_field(self, name, array)

    @property
    def pitches(self) -> tuple[float, float]:
        """Pitch along x and y in mm; the same number twice except for RECTANGULAR."""
        return self.pitch if isinstance(self.pitch, tuple) else (self.pitch, self.pitch)

    @property
    def half_extent(self) -> Floats:
        """(2,) largest distance of a design centre from x = 0 and y = 0 in mm, with a margin for rounding; or inf."""
        half = np.full(2, np.inf) if self.extent is None else 0.5 * np.array(self.extent)
        return read_only(half + 1e-9 * np.array(self.pitches))

    @property
    def type_pattern(self) -> NDArray[np.int64]:
        """(p, q) array of types: lens (i, j) has the type type_pattern[i mod p, j mod q]."""
        return read_only(default_pattern(len(self.focal_lengths)) if self.pattern is None else self.pattern)

    @property
    def focal_length(self) -> float:
        """Focal length in mm of the lens at the array's centre, or of the first one of a FREE lattice."""
        if self.lattice is Lattice.FREE:
            return self.focal_lengths[0 if self.types is None else int(self.types[0])]
        return self.focal_lengths[int(self.type_pattern[0, 0])]

    @property
    def is_plate(self) -> bool:
        """True if rays pass two surfaces of glass, so that thickness, index and convex side matter."""
        return self.model.is_plate

    @property
    def radius(self) -> float:
        """Plates: radius of curvature of the lens at the centre in mm, f (index - 1)."""
        return self.focal_length * (self.index - 1.0)

    @property
    def principal_separation(self) -> float:
        """Distance from the front to the rear principal plane in mm: 0 for an ideal thin lens."""
        return self.model.refraction.depths(self).separation

    def index_at(self, wavelength: float) -> float:
        """Refractive index at a wavelength in nm."""
        if self.medium is None or wavelength == _DESIGN_WAVELENGTH:
            return self.index
        return float(self.medium.index(wavelength))

    def power_factor(self, wavelength: float) -> float:
        """Power at a wavelength in nm over that at 587.6 nm: the ratio of n - 1, since curvatures are constant."""
        return (self.index_at(wavelength) - 1.0) / (self.index - 1.0)

    def focal_lengths_at(self, wavelength: float) -> tuple[float, ...]:
        """Focal lengths of the types in mm at a wavelength in nm."""
        factor = self.power_factor(wavelength)
        return tuple(f / factor for f in self.focal_lengths)

    @property
    def basis(self) -> Floats:
        """(2, 2) array: rows are the lattice vectors in mm; centres are integer combinations, except for FREE."""
        return read_only(lattice_basis(self.lattice, self.pitches))

    @property
    def cell_edges(self) -> Floats:
        """(k, 3) array: outward normal x, y and distance from the centre of each edge of a cell."""
        return read_only(polygon_edges(self.cell_corners))

    @property
    def cell_radius(self) -> float:
        """Distance from a cell's centre to its corners in mm; of the largest possible cell for FREE."""
        return float(np.hypot(*self.cell_corners.T).max())

    @property
    def cell_corners(self) -> Floats:
        """(k, 2) array: corners of the central cell in mm, counter-clockwise; of the largest possible one for FREE."""
        return read_only(cell_polygon(self.lattice, self.pitches))

    @property
    def cell_area(self) -> float:
        """Area of a cell in mm^2; of the largest possible one for FREE."""
        return polygon_area(self.cell_corners)

    @property
    def opening(self) -> Opening:
        """Opening of a microlens; the fill factor of FREE ones refers to a square of the pitch."""
        if self.aperture is None:
            return Opening(self.cell_corners)
        free = self.lattice is Lattice.FREE
        return opening_of(self.aperture, cell_polygon(Lattice.SQUARE, self.pitches) if free else self.cell_corners)

    def lenses(self, low: ArrayLike, high: ArrayLike) -> Lenslets:
        """Microlenses whose design centres lie in a box, with their individual properties.

        Parameters
        ----------
        low, high : (2,) arrays
            Corners of the box on the plane of the array in mm.

        Examples
        --------
        >>> import plenoptic as pl
        >>> array = pl.MicrolensArray(pitch=1.0, focal_lengths=(2.0,), lattice=pl.Lattice.SQUARE)
        >>> array.lenses((-0.5, -0.5), (1.5, 0.5)).centre.tolist()
        [[0.0, 0.0], [1.0, 0.0]]
        """
        return lenslets(self, frozen_array(low, name="low", shape=(2,)), frozen_array(high, name="high", shape=(2,)))

    def nearest(self, points: Floats) -> Floats:
        """Design centres (n, 2) in mm of the cells that hold points (n, 2) of the array's plane; nan beyond the extent.

        Examples
        --------
        >>> import numpy as np, plenoptic as pl
        >>> array = pl.MicrolensArray(pitch=1.0, focal_lengths=(2.0,), lattice=pl.Lattice.SQUARE)
        >>> array.nearest(np.array([[0.6, 0.4]]))
        array([[1., 0.]])
        """
        points = frozen_array(points, name="points", shape=("n", 2))
        if self.centres is not None:
            each = max(1, _MAX_DISTANCES // len(self.centres))
            parts = [
                np.linalg.norm(points[k : k + each, None] - self.centres, axis=-1).argmin(axis=1)
                for k in range(0, len(points), each)
            ]
            return np.asarray(self.centres[np.concatenate([np.empty(0, np.int64), *parts])])
        base = np.floor(points @ np.linalg.inv(self.basis))
        corners = np.stack([base + step for step in ([0, 0], [0, 1], [1, 0], [1, 1])]) @ self.basis
        distance = np.linalg.norm(corners - points, axis=-1)
        nearest = np.take_along_axis(corners, distance.argmin(axis=0)[None, :, None], axis=0)[0]
        return np.where((np.abs(nearest) <= self.half_extent).all(axis=1, keepdims=True), nearest, np.nan)

    _repr_html_ = picture_of
