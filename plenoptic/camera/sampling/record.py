"""What sampling hands from stage to stage: regions that feed pixels, batches of samples, and the pixels of a tile."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats

TRIANGLE = np.dtype(
    [(name, "f8") for name in ("x", "y", "ax", "ay", "bx", "by", "area", "axis_x", "axis_y")], align=True
)
"""A triangle of a region: a corner, two edges from there, the area up to and with this triangle, and the optical axis
of its microlens."""


class Regions(NamedTuple):
    """What feeds pixels."""

    triangles: NDArray[np.void]
    """(n,) of TRIANGLE."""
    first: NDArray[np.int64]
    """(pixels + 1,): where each pixel's triangles begin."""
    details: NDArray[np.void] | None
    """(n,) of MICROLENS: what paths keep of their microlens; None where these do not differ."""


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
