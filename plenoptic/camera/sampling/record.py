"""Records that sampling hands from stage to stage: aperture regions, batches of samples, pixels of a tile."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats
from plenoptic.optics.lens.record import LensRecord
from plenoptic.optics.microlens.microlens_record import SensorPlane

if TYPE_CHECKING:
    from plenoptic.camera.diffraction import BendRecord
    from plenoptic.camera.record import PixelRecord

SIDE = 4
"""Pixels along a side of a group, whose views of the lens are found together."""

NEAR = 8
"""Pixels along rows and columns over which a bend is short: what feeds so many around a pixel is found with it."""

CANDIDATE = np.dtype(
    [
        *((name, "f8") for name in ("cell_x", "cell_y", "axis_x", "axis_y", "x", "y", "half_x", "half_y", "slack")),
        *((name, "i8") for name in ("first_corner", "corners", "parted", "first_view", "views", "certain")),
    ],
    align=True,
)
"""A microlens that may feed a group of pixels: centre of its cell, optical axis, the box in which light may pass (its
middle and half sides, from the cell's centre), how large the margins of its planes are beside what they bound; first
and number of the corners of a polygon that holds all its light; 1 where that light comes in several parts, which views
do not show; first and number of its views of elements, -1 where it is dark; 1 where nothing but what the views show
stops light in that polygon."""

VIEW = np.dtype(
    [
        *((name, "f8") for name in ("x", "y", "x_by_x", "x_by_y", "y_by_x", "y_by_y")),
        *((name, "f8") for name in ("x_by_u", "x_by_v", "y_by_u", "y_by_v", "radius", "margin")),
        *((name, "i8") for name in ("first_edge", "edges")),
    ],
    align=True,
)
"""Where rays of a microlens meet an element, in mm from its axis, up to a margin: the ray through the centre of the
cell from that of a group, and by how much more for points of the cell (x, y) and of the sensor (u, v) beside these;
the radius of the element's circle, the margin, and the first and the number of the edges around its hole."""

PLANE = np.dtype([(name, "f8") for name in ("a", "b", "limit", "s", "t", "high", "gap")], align=True)
"""An edge or a tangent of what an element lets pass, or an edge of a moving piece's cell: a x + b y + s u + t v <=
limit, where (x, y) is a point of the piece, and (u, v) one of the sensor from the centre of the pixel; how far the
piece reaches along (a, b); how far inside the limit light is certain to pass."""

PIECE = np.dtype(
    [
        *((name, "f8") for name in ("cell_x", "cell_y", "axis_x", "axis_y", "area", "xu", "xv", "yu", "yv")),
        *((name, "i8") for name in ("first_corner", "corners", "first_plane", "planes", "certain")),
    ],
    align=True,
)
"""The part of a microlens that feeds a pixel: a polygon that is cut with planes, and the place from which it is
measured: the centre of the cell, moved by (xu u + xv v, yu u + yv v) for points (u, v) of the pixel from its centre.
Centre of the cell and optical axis; the area of the polygon, uncut, and of those before it; first and number of corners
and of planes; 1 where all light inside the planes' gaps passes."""


class Candidates(NamedTuple):
    """The microlenses that may feed groups of pixels."""

    first: NDArray[np.int64]
    """(groups + 1,): where each group's candidates begin."""
    rows: NDArray[np.void]
    """(n,) of CANDIDATE."""
    details: NDArray[np.void] | None
    """(n,) of MICROLENS: what paths keep of their microlens; None where these do not differ."""


class Regions(NamedTuple):
    """Aperture regions of pixels."""

    pieces: NDArray[np.void]
    """(n,) of PIECE."""
    first: NDArray[np.int64]
    """(pixels + 1,): where each pixel's pieces begin."""
    corners: Floats
    """(2, c): x and y."""
    planes: NDArray[np.void]
    """(m,) of PLANE."""
    details: NDArray[np.void] | None
    """(n,) of MICROLENS: what paths keep of their microlens; None where these do not differ."""


class Openings(NamedTuple):
    """Openings of the lens's elements, in the order in which light from the sensor meets them."""

    elements: tuple[LensRecord, ...]
    """Each alone, without rims."""
    semi_diameter2: Floats
    """(elements,): mm^2."""
    edges: Floats
    """(k, 3) edges of the convex polygons around the holes of stops that are not round: x, y, distance."""
    first_edge: NDArray[np.int64]
    """(elements + 1,): where each element's edges begin."""
    whole: NDArray[np.bool_]
    """(elements,): whether these let all pass that they bound."""


class Around(NamedTuple):
    """The pixels to which light of a tile's may be headed before it bends: the tile's, then those so near that light is
    shared with them, then others up to `NEAR` rows and columns beside them, on the sensor and around it. Their regions
    are those of `FedPixels`.
    """

    own: NDArray[np.int64]
    """(p, 2): rows and columns on the sensor of the tile's pixels."""
    corner: tuple[int, int]
    """The first row and column of the grid."""
    grid: NDArray[np.int32]
    """(rows, columns): numbers of the pixels, -1 for others."""
    numbers: NDArray[np.int64]
    """(s,): on the sensor, of those that share their light; beyond all of it for pixels beside the sensor."""
    givers: NDArray[np.int64]
    """(p, pixels): from which of these the tile's pixels get light, in the order of a `SpreadTable`."""
    centres: Floats
    """(k, 2): see `pixel_centres`."""
    areas: Floats
    """(p,): the largest area of a region to which light of each of the tile's pixels may be headed."""
    shape: tuple[int, int]
    """Rows and columns of the sensor."""
    plane: SensorPlane
    bend: BendRecord


class SpreadTable(NamedTuple):
    """Light of a pixel by the position to which it was headed, for short diffraction deflections; see
    `sampling.spread`.
    """

    parts: Floats
    """(rows, pixels): shares of the pixels around, down and across from the nearest corner, times the area of a pixel
    over that which sees light. Rows run over levels, what passed openings and what passed beside them, and places in
    the pixel, down and across."""
    means: Floats | None
    """(1, pixels): of all paths, whatever light they bring, or (channels, pixels), times the weights of their
    wavelengths; None where they are others in each pixel."""
    reach: int
    """Pixels on each side."""
    fine: int
    """Places along a side of a pixel."""
    kinds: int
    """1, or 2 where light passes beside openings."""
    plane: SensorPlane
    wavelengths: Floats
    """(n + 1,): the camera's, then those that paths draw, in mm."""
    levels: int
    """Sizes of the pattern on the sensor: several for several wavelengths, and where it is tilted."""
    low: float
    """The least wavelength times distance from the array, in mm^2."""
    per_level: float
    """Levels for each mm^2 more."""


class FedPixels(NamedTuple):
    """The pixels of a tile that light can reach."""

    place: NDArray[np.int64]
    """(p,): their numbers in the tile."""
    number: NDArray[np.int64]
    """(p,): on the whole sensor."""
    centres: Floats
    """(p, 2): see `pixel_centres`."""
    regions: Regions
    """What feeds them."""
    pixel: PixelRecord
    """What of a pixel sees light."""
    certain: bool
    """Whether it is known of pieces what surely passes: that is asked for white images."""
    around: Around | None = None
    """Where light bends; the regions are then those of its pixels. None where it does not."""
    spread: SpreadTable | None = None
    """How light is shared between pixels; None where all of it stays."""

    @property
    def areas(self) -> Floats:
        """(p,): the area that feeds each pixel, at most."""
        if self.around is not None:
            return self.around.areas
        # The column before the rows: picking whole rows of a structured array takes two hundred times as long.
        return np.asarray(self.regions.pieces["area"][self.regions.first[1:] - 1])


class Bends(NamedTuple):
    """Quantities for starting the paths of a bundle with diffraction."""

    far: NDArray[np.int64] | None
    """Room for the numbers of those whose light comes from far away; None where bends are not drawn."""
    spots: NDArray[np.int64] | None
    """Room for rows of the `SpreadTable`; None where light is not shared."""
    waves: NDArray[np.int64] | None
    """Numbers of the paths' wavelengths; None where all have the camera's."""


class Batch(NamedTuple):
    """Some samples of every pixel of a tile: `first` have been rendered before.

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
    """A batch with its net."""
    from plenoptic.core.kernels import sobol

    net = np.empty((sobol.DIMENSIONS, -(-samples // streams)), dtype=np.uint32)
    sobol.fill_net(net, first_index)
    return Batch(first, samples, streams, first_stream, first_index, seed, net)
