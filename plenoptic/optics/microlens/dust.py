"""Dust and scratches on a plane of the camera: listed, or random from a seed."""

from __future__ import annotations

import dataclasses
import enum
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.values import (
    Floats,
    Given,
    choice,
    finite,
    frozen_array,
    length_in_mm,
    not_negative,
    seed_number,
    set_field,
    value,
    whole,
)
from plenoptic.errors import InvalidValueError

MAX_BLEMISHES = 5_000_000
"""Limit of the number of random blemishes."""

_MAX_MEMBERS = 16
"""Limit of the mean number of bins that list a blemish; bins are widened until it holds."""


class BlemishSite(enum.IntEnum):
    """Plane on which blemishes lie, whose axes their positions refer to. See `Blemishes`."""

    SENSOR = 0
    """Parallel to the sensor, at a distance in front of it: on its cover glass, or on the pixels."""
    ARRAY = 1
    """The plane of the microlens array."""
    LENS_REAR = 2
    """The plane of the main lens's last vertex."""
    LENS_FRONT = 3
    """The plane of the main lens's first vertex."""


@value
class Blemishes:
    """Grains of dust and scratches on one plane; transmissions of overlapping ones multiply.

    Each blemish is a capsule, all points nearer than `radius` to the segment from `start` to `end`. A segment of
    length 0 is a round grain.

    Parameters
    ----------
    site : BlemishSite
        The plane.
    start, end : (n, 2) arrays
        Ends of the segments in mm, in the axes of sensor, array or lens, from its centre.
    radius : (n,) array or float
        In mm, above 0: radius of a grain, or half the width of a scratch.
    transmission : (n,) array or float
        Transmitted fraction of the light, 0 (opaque) to 1.
    height : float
        SENSOR: distance of the plane in front of the sensor in mm, along its normal; 0 is on the pixels. A path is
        attenuated where it crosses the plane, so that dust at a height has a blurred shadow. 0 for all other sites.

    Raises
    ------
    InvalidValueError
        If arrays differ in length, numbers are out of range, or another site than SENSOR has a height.

    Examples
    --------
    >>> import plenoptic as pl
    >>> grain = pl.Blemishes(pl.BlemishSite.SENSOR, start=[(0, 0)], end=[(0, 0)], radius=[0.1], transmission=[0.25])
    >>> grain.at([(0.0, 0.05), (0.2, 0.0)])
    array([0.25, 1.  ])
    """

    site: BlemishSite
    start: Given[Floats, ArrayLike]
    end: Given[Floats, ArrayLike]
    radius: Given[Floats, ArrayLike]
    transmission: Given[Floats, ArrayLike]
    height: float = dataclasses.field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        set_field(self, "site", choice(self.site, BlemishSite, "site of the blemishes"))
        set_field(self, "start", _numbers(self.start, "start", ("n", 2)))
        n = len(self.start)
        set_field(self, "end", _numbers(self.end, "end", (n, 2)))
        for name in ("radius", "transmission"):
            values = getattr(self, name)
            is_scalar = isinstance(values, int | float | np.number)
            set_field(self, name, _numbers(np.full(n, values) if is_scalar else values, name, (n,)))
        if not (self.radius > 0).all():
            raise InvalidValueError(f"radius of a blemish is {self.radius.min():g} mm; it must be above 0")
        if not ((self.transmission >= 0) & (self.transmission <= 1)).all():
            raise InvalidValueError(
                "transmission of the blemishes holds a number outside 0 to 1; it is the transmitted fraction"
            )
        set_field(self, "height", not_negative(self.height, "height of the blemishes", "mm"))
        if self.height > 0 and self.site is not BlemishSite.SENSOR:
            raise InvalidValueError(
                f"height of the blemishes is {self.height:g} mm at the site {self.site.name}; only SENSOR has one: "
                "leave it at 0"
            )

    def __len__(self) -> int:
        return len(self.radius)

    @classmethod
    def scattered(  # noqa: PLR0913
        cls,
        site: BlemishSite,
        *,
        half_size: tuple[float, float],
        dust_per_mm2: float = 0.0,
        dust_radius: float = 0.005,
        dust_spread: float = 0.5,
        scratches: int = 0,
        scratch_length: float = 1.0,
        scratch_width: float = 0.005,
        transmission: float = 0.0,
        seed: int = 0,
        height: float = 0.0,
    ) -> Blemishes:
        """Random dust and scratches, in this order, in a rectangle.

        Parameters
        ----------
        site : BlemishSite
            The plane.
        half_size : (float, float)
            Half the width and height of the rectangle in mm; it is centred on the plane's origin.
        dust_per_mm2 : float
            Mean number of grains per mm^2; their number follows Poisson's distribution.
        dust_radius : float
            Median radius of the grains in mm.
        dust_spread : float
            Standard deviation of the logarithm of the radius, which is normal; 0: all radii are equal.
        scratches : int
            Number of scratches. Their centres are uniform in the rectangle, and so are their directions.
        scratch_length, scratch_width : float
            Length of the segment, and width, in mm.
        transmission : float
            Transmission of each blemish, 0 (opaque) to 1.
        seed : int
            The same seed gives the same blemishes (with one version of NumPy); scratches do not change the dust.
        height : float
            As for `Blemishes`.

        Raises
        ------
        InvalidValueError
            If numbers are out of range, or more than five million blemishes are requested.

        Examples
        --------
        >>> import plenoptic as pl
        >>> dusty = pl.Blemishes.scattered(pl.BlemishSite.SENSOR, half_size=(5.0, 5.0), dust_per_mm2=2.0, seed=1)
        >>> 150 < len(dusty) < 250
        True
        """
        sides = frozen_array(half_size, name="half_size", shape=(2,))
        half = np.array([length_in_mm(side, "half_size") for side in sides])
        mean = 4.0 * float(half.prod()) * not_negative(dust_per_mm2, "dust_per_mm2")
        scratches = whole(scratches, "scratches", at_least=0)
        if mean + scratches > MAX_BLEMISHES:
            raise InvalidValueError(
                f"some {mean + scratches:.3g} blemishes are asked for, and the limit is {MAX_BLEMISHES}; "
                "reduce dust_per_mm2, scratches or half_size"
            )
        spread = not_negative(dust_spread, "dust_spread")
        median, width = length_in_mm(dust_radius, "dust_radius"), length_in_mm(scratch_width, "scratch_width")
        length = length_in_mm(scratch_length, "scratch_length")
        seed = seed_number(seed)
        dust, lines = (np.random.default_rng([seed, kind]) for kind in range(2))
        grains = int(dust.poisson(mean))
        grain = dust.uniform(-1.0, 1.0, (grains, 2)) * half
        middle = lines.uniform(-1.0, 1.0, (scratches, 2)) * half
        angle = lines.uniform(0.0, math.pi, scratches)
        arm = 0.5 * length * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        radius = median * np.exp(spread * dust.standard_normal(grains))
        return cls(
            site,
            np.concatenate([grain, middle - arm]),
            np.concatenate([grain, middle + arm]),
            np.concatenate([radius, np.full(scratches, 0.5 * width)]),
            finite(transmission, "transmission of the blemishes"),
            height=height,
        )

    def at(self, points: ArrayLike) -> Floats:
        """Transmission (n,) at points (n, 2) of the plane, in its axes in mm. See `Blemishes`."""
        from plenoptic.optics.microlens.kernels.dust_transmission import fill_transmission

        checked = frozen_array(points, name="points", shape=("n", 2))
        transmission = np.empty(len(checked))
        fill_transmission(transmission, checked, dust_record(self))
        return transmission


def _numbers(values: ArrayLike, name: str, shape: tuple[int | str, ...]) -> Floats:
    if len(shape) == 2 and isinstance(values, list | tuple) and not values:
        values = np.zeros((0, 2))
    array = frozen_array(values, name=f"{name} of the blemishes", shape=shape)
    if not np.isfinite(array).all():
        raise InvalidValueError(f"{name} of the blemishes holds a number that is not finite; correct it")
    return array


_CAPSULE_NAMES = ("start_x", "start_y", "along_x", "along_y", "inverse_length2", "radius2", "transmission")
CAPSULE = np.dtype([(name, "f8") for name in _CAPSULE_NAMES], align=True)
"""A grain or scratch: start, vector from there to the end, reciprocal of its squared length (0 for grains), squared
radius, transmission."""


class DustRecord(NamedTuple):
    """Dust and scratches of one plane, in a grid of bins for fast lookup."""

    grid: Floats
    """(5,): corner x, y of the grid in mm, bins per mm, numbers of columns and rows."""
    first: NDArray[np.int64]
    members: NDArray[np.int64]
    """Capsules in the order of bins: those of bin b from first[b] on."""
    capsules: NDArray[np.void]
    """(n,) of CAPSULE."""


def dust_record(blemishes: Blemishes) -> DustRecord:
    """Compile dust: at most six bins for each grain, wider ones where grains are larger than their distance."""
    from plenoptic.optics.microlens.kernels.dust_transmission import count_members, fill_dust_bins

    n, capsules = len(blemishes), _capsules(blemishes)
    if not n:
        grid = np.array([0.0, 0.0, 1.0, 1.0, 1.0])
        return DustRecord(grid, np.zeros(2, np.int64), np.zeros(0, np.int64), capsules)
    reach = blemishes.radius[:, None]
    low = (np.minimum(blemishes.start, blemishes.end) - reach).min(axis=0)
    high = (np.maximum(blemishes.start, blemishes.end) + reach).max(axis=0)
    margin = 16.0 * np.finfo(float).eps * float(np.abs([low, high]).max())
    low, high = low - margin, high + margin
    size = high - low
    width = max(math.sqrt(float(size[0]) * float(size[1]) / (2 * n)), float(size.max()) / (2 * n))
    while True:
        columns, rows = (np.floor(size / width) + 1).astype(int)
        grid = np.array([low[0], low[1], 1.0 / width, columns, rows])
        total = count_members(capsules, grid, margin)
        if total <= _MAX_MEMBERS * n or columns * rows == 1:
            break
        width *= 2.0
    first, members = np.zeros(columns * rows + 1, np.int64), np.empty(total, np.int64)
    fill_dust_bins(first, members, capsules, grid, margin)
    return DustRecord(grid, first, members, capsules)


def _capsules(blemishes: Blemishes) -> NDArray[np.void]:
    capsules = np.empty(len(blemishes), CAPSULE)
    along = blemishes.end - blemishes.start
    with np.errstate(divide="ignore", over="ignore"):
        inverse = 1.0 / np.einsum("ij,ij->i", along, along)
    inverse[~np.isfinite(inverse)] = 0.0
    capsules["start_x"], capsules["start_y"] = blemishes.start.T
    capsules["along_x"], capsules["along_y"] = along.T
    capsules["inverse_length2"] = inverse
    capsules["radius2"], capsules["transmission"] = blemishes.radius**2, blemishes.transmission
    return capsules


def plane_axes(turn: Floats, shift: Floats, *, height: float = 0.0) -> Floats | None:
    """(2, 3) affine map from x, y of points on a part's plane to the part's own axes; None for the identity.

    A point p of the part lies at turn @ p + shift, with turn (3, 3), shift (3,); the plane is z = -height in its own
    axes. The map uses x and y of a point of that plane alone: own = map[:, :2] @ (x, y) + map[:, 2].
    """
    inverse = np.linalg.inv(turn[:2, :2])
    middle = turn @ np.array([0.0, 0.0, -height]) + shift
    affine = np.column_stack([inverse, -inverse @ middle[:2]])
    return None if np.array_equal(affine, np.eye(3)[:2]) else affine
