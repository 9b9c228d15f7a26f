"""Records of aperture sampling: aperture regions, the illuminated pixels of a tile, and batches of samples."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats
from plenoptic.optics.lens.lens_record import LensRecord
from plenoptic.optics.microlens.microlens_record import SensorPlane

if TYPE_CHECKING:
    from plenoptic.camera.camera_record import PixelRecord
    from plenoptic.camera.diffraction import DeflectionRecord

GROUP_SIDE = 4
"""Pixels along each side of a group, for which the linear ray transfers are computed together."""

NEAR, MAX_NEAR = 8, 32
"""Rows and columns up to which a diffraction deflection counts as near, at least and at most: aperture regions of so
many pixels around a tile are computed with it."""

FAR = 64
"""Rows and columns up to which groups of pixels around a tile are known to be dark, and deflections from there drawn
again; a multiple of `GROUP_SIDE`."""

CANDIDATE = np.dtype(
    [
        *((name, "f8") for name in ("cell_x", "cell_y", "axis_x", "axis_y", "x", "y", "half_x", "half_y", "slack")),
        *((name, "i8") for name in ("first_corner", "corners", "disconnected", "first_transfer", "transfers")),
        ("complete", "i8"),
    ],
    align=True,
)
"""Microlens that may illuminate a group of pixels.

Centre of its cell, optical axis; bounding box of the light in the cell (centre and half sides, from the cell's centre);
slack, the largest margin of its planes relative to the size that they bound. First corner and number of corners of the
convex polygon that bounds its light. 1 if that light is disconnected, which linear transfers cannot represent. First
transfer and number of transfers, -1 if it is dark. 1 if the elements of its transfers are all that stops light in the
polygon."""

RAY_TRANSFER = np.dtype(
    [
        *((name, "f8") for name in ("x", "y", "x_by_x", "x_by_y", "y_by_x", "y_by_y")),
        *((name, "f8") for name in ("x_by_u", "x_by_v", "y_by_u", "y_by_v", "radius", "margin")),
        *((name, "i8") for name in ("first_edge", "edges")),
    ],
    align=True,
)
"""Linear ray transfer from pixel and microlens to a lens element: the intersection in mm from the element's axis.

Intersection of the ray through the centres of group and cell; its derivatives with respect to the point in the cell
(x, y) and on the sensor (u, v), both from these centres; radius of the element's circle; margin, the bound on the
error of the linear map; first edge and number of edges of the polygon around its hole."""

PLANE = np.dtype([(name, "f8") for name in ("a", "b", "limit", "s", "t", "high", "gap")], align=True)
"""Half-space a x + b y + s u + t v <= limit that bounds the light through an element, or a moving piece's cell.

(x, y) is a point of the piece, (u, v) one of the sensor from the pixel's centre. high: the largest a x + b y on the
piece. gap: light further inside the limit than this is never vignetted."""

PIECE = np.dtype(
    [
        *((name, "f8") for name in ("cell_x", "cell_y", "axis_x", "axis_y", "area", "xu", "xv", "yu", "yv")),
        *((name, "i8") for name in ("first_corner", "corners", "first_plane", "planes", "has_core", "is_round")),
    ],
    align=True,
)
"""Piece of a microlens's aperture that illuminates a pixel: a convex polygon, clipped by planes for each point.

Its origin is the cell's centre, displaced by (xu u + xv v, yu u + yv v) for points (u, v) from the pixel's centre.
Centre of the cell and optical axis; cumulative area in mm^2 of the unclipped polygons of the pixel, up to this one;
first and number of corners and of planes. 1 if all light inside the planes' gaps is unvignetted. 1 if it is an ellipse:
its polygon then has the same area, and corners in the same directions as those of a circle's."""


class Candidates(NamedTuple):
    """Microlenses that may illuminate groups of pixels."""

    first: NDArray[np.int64]
    """(groups + 1,): first candidate of each group."""
    rows: NDArray[np.void]
    """(n,) of CANDIDATE."""
    details: NDArray[np.void] | None
    """(n,) of MICROLENS: lenslet parameters; None if all microlenses are alike."""


class Regions(NamedTuple):
    """Aperture regions of pixels: the pieces of microlens apertures that illuminate each of them."""

    pieces: NDArray[np.void]
    """(n,) of PIECE."""
    first: NDArray[np.int64]
    """(pixels + 1,): first piece of each pixel."""
    corners: Floats
    """(2, c): x and y."""
    planes: NDArray[np.void]
    """(m,) of PLANE."""
    details: NDArray[np.void] | None
    """(n,) of MICROLENS: lenslet parameters; None if all microlenses are alike."""


class Openings(NamedTuple):
    """Openings of the elements of a lens, in the order in which light from the sensor meets them."""

    elements: tuple[LensRecord, ...]
    """Single elements, without rims."""
    semi_diameter2: Floats
    """(elements,): mm^2."""
    edges: Floats
    """(k, 3) edges of the convex polygons around the holes of stops that are not round: x, y, distance."""
    first_edge: NDArray[np.int64]
    """(elements + 1,): first edge of each element."""
    exact: NDArray[np.bool_]
    """(elements,): True if the opening equals its circle or polygon, False if that only bounds it."""


class SourcePixels(NamedTuple):
    """Pixels from which diffraction can carry light into a tile.

    The tile's own pixels, then those within the reach of the diffraction kernel, then near ones, on the sensor and
    around it. The regions of `IlluminatedPixels` are those of these pixels, in this order.
    """

    pixels: NDArray[np.int64]
    """(p, 2): row and column on the sensor of each pixel of the tile."""
    corner: tuple[int, int]
    """First row and column of the grid."""
    grid: NDArray[np.int32]
    """(rows, columns): index of the source pixel, -1 for none."""
    numbers: NDArray[np.int64]
    """(s,): number on the sensor of each pixel of tile and kernel; above all of these outside the sensor."""
    kernel_sources: NDArray[np.int64]
    """(p, pixels): source pixels of each pixel of the tile, in the order of a `KernelTable`."""
    centres: Floats
    """(k, 2): see `pixel_centres`."""
    lit_groups: NDArray[np.bool_]
    """(rows, columns): False for groups of `GROUP_SIDE` pixels at which no light is aimed, up to `FAR` around the tile.
    """
    first_group: tuple[int, int]
    """Row and column of the first of these groups."""
    shape: tuple[int, int]
    """Rows and columns of the sensor."""
    plane: SensorPlane
    deflection: DeflectionRecord


class KernelTable(NamedTuple):
    """Weights of the diffraction kernel: the share of the light aimed at a pixel that arrives in its neighbours."""

    weights: Floats
    """(rows, pixels): weights of the pixels around, down and across from the nearest corner, over the fill factor. Rows
    run over pattern scales, patterns (light through openings, light through gaps), and places in the pixel, down and
    across."""
    means: Floats | None
    """(1, pixels): mean of the weights over all paths, or (channels, pixels), times the spectral weights; None where
    they differ between pixels."""
    reach: int
    """Pixels on each side."""
    subdivisions: int
    """Places along a side of a pixel."""
    patterns: int
    """1, or 2 if light passes through gaps between openings."""
    plane: SensorPlane
    wavelengths: Floats
    """(n + 1,): the camera's wavelength, then those drawn by paths, in mm."""
    scales: int
    """Sizes of the pattern on the sensor: several for several wavelengths or a tilted sensor."""
    lowest_scale: float
    """Least wavelength times distance from the array, in mm^2."""
    scales_per_area: float
    """Number of scales per mm^2."""


class IlluminatedPixels(NamedTuple):
    """Pixels of a tile that light can reach, with their aperture regions."""

    place: NDArray[np.int64]
    """(p,): their indices in the tile."""
    number: NDArray[np.int64]
    """(p,): their numbers on the sensor."""
    centres: Floats
    """(p, 2): see `pixel_centres`."""
    regions: Regions
    pixel: PixelRecord
    """Light-sensitive area of a pixel."""
    has_core: bool
    """True if pieces state their unvignetted core, the control variate of white images."""
    sources: SourcePixels | None = None
    """Source pixels of diffraction, whose regions `regions` then are; None without diffraction at microlenses."""
    kernel: KernelTable | None = None
    """Weights by which pixels share light; None if all of it stays in its pixel."""

    @property
    def areas(self) -> Floats:
        """(p,): upper bound on the area of each pixel's region in mm^2."""
        if self.sources is not None:  # deflected light can come from anywhere
            return np.full(self.place.size, self.sources.deflection.area)
        # The column before the rows: picking whole rows of a structured array takes two hundred times as long.
        return np.asarray(self.regions.pieces["area"][self.regions.first[1:] - 1])


class DeflectedSamples(NamedTuple):
    """Arrays that sampling with diffraction fills or reads, one element per path."""

    distant: NDArray[np.int64] | None
    """Filled with the indices of paths deflected from distant pixels; None if deflections are not drawn."""
    kernel_rows: NDArray[np.int64] | None
    """Filled with rows of the `KernelTable`; None without a kernel."""
    waves: NDArray[np.int64] | None
    """Wavelength index of each path; None if all have the camera's."""


class Batch(NamedTuple):
    """Samples of every pixel of a tile; `first` samples have been rendered before.

    `streams` are the independent random streams among which they are divided, from number `first_stream` on; each
    begins with its point `first_index`.
    """

    first: int
    samples: int
    streams: int
    first_stream: int
    first_index: int
    seed: np.uint64
    net: NDArray[np.uint32]
    """(4, points): the bit-reversed Sobol points that all streams scramble."""


def batch_record(seed: np.uint64, first: int, samples: int, streams: int, first_stream: int, first_index: int) -> Batch:
    """Batch with its Sobol net."""
    from plenoptic.core.kernels import sobol

    net = np.empty((sobol.DIMENSIONS, -(-samples // streams)), dtype=np.uint32)
    sobol.fill_net(net, first_index)
    return Batch(first, samples, streams, first_stream, first_index, seed, net)
