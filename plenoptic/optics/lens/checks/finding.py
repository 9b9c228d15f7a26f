"""Findings of a lens check."""

from __future__ import annotations

import enum

from plenoptic.core.values import result


class FindingKind(enum.IntEnum):
    """Kind of a finding.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.optics.FindingKind(1).name
    'THIN_EDGE'
    """

    OVERLAP = 0
    """Neighbouring surfaces, or a surface and a stop, cross within their semi-diameters: a negative edge thickness."""
    THIN_EDGE = 1
    """The edge of a lens is thinner than 1 % of its semi-diameter."""
    EQUATOR = 2
    """A semi-diameter is more than 99 % of that of the sphere's or ellipsoid's equator."""
    STEEP = 3
    """An aspheric surface is steeper than 60 degrees."""
    GLASS = 4
    """A glass has another index (by more than 0.01) or Abbe number (by more than 10 %) than the bundled one of its
    name, or than another of the same name in the lens."""
    IRIS_FAR = 5
    """The iris stands farther outside the lens than both the length of the lens and its focal length."""
    IMAGE_INSIDE = 6
    """The image of a far object lies before the rim of the last surface."""
    IRIS_NOT_FILLED = 7
    """Other rims or stops, not the iris, limit the beam on the axis, to less than 95 % of the iris's semi-diameter."""
    NO_LIGHT = 8
    """No ray of those tried passes the lens."""
    TOTAL_REFLECTION = 9
    """Rays are totally reflected, or miss a surface, that neither a rim nor a stop has stopped before."""
    GRAZING = 10
    """Rays that pass the lens meet a surface at more than 84.3 degrees from its normal: 1 / cos i is above 10."""
    NEAR_TOTAL_REFLECTION = 11
    """Rays that pass the lens are nearly totally reflected: d i' / d i = n cos i / (n' cos i') is above 10."""
    CANCELLATION = 12
    """Lengths above 10^4 times the size of an element are added up on the way to points on it, so that more than 4 of
    the 15.7 decimal digits of float64 are lost."""
    VERTEX = 13
    """A surface without rotational symmetry is tilted or astigmatic at its vertex, by slopes above 0.001: Gaussian data
    leave that out."""
    APERTURE = 14
    """The entrance pupil, or the semi-diameter of the iris, is another than the lens's file says, by more than 1 %."""


@result
class Finding:
    """Something in a lens that looks wrong; `LensStack.check` makes them. Printed, it is its message.

    Attributes
    ----------
    kind : FindingKind
    elements : tuple of int
        Indices in `LensStack.elements` of its elements, in rising order.
    message : str
        A sentence with the numbers.

    Examples
    --------
    >>> import plenoptic as pl
    >>> lens = pl.LensStack([pl.CircularStop(4.0, thickness=1.0),
    ...                      pl.Surface(10.0, 2.0, pl.ConstantMedium(1.5), semi_diameter=8.0),
    ...                      pl.Surface(-10.0, semi_diameter=8.0)])
    >>> print(lens.check()[0])
    surfaces 1 and 2 cross 4.36 mm from the axis: at 8 mm there is -6 mm of glass between them; reduce a semi-diameter
    """

    kind: FindingKind
    elements: tuple[int, ...]
    message: str

    def __str__(self) -> str:
        return self.message
