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
    """Neighbouring surfaces, or a surface and a stop, intersect within their semi-diameters: negative edge
    thickness."""
    THIN_EDGE = 1
    """The edge of a lens is thinner than 1 % of its semi-diameter."""
    EQUATOR = 2
    """A semi-diameter exceeds 99 % of that of the sphere's or ellipsoid's equator."""
    STEEP = 3
    """An aspheric surface is steeper than 60 degrees."""
    GLASS = 4
    """A glass differs from the bundled glass of its name, or from one of the same name in the lens: in index by more
    than 0.01, or in Abbe number by more than 10 %."""
    IRIS_FAR = 5
    """The distance of the iris from the lens exceeds both the length and the focal length of the lens."""
    IMAGE_INSIDE = 6
    """The image of a far object lies before the rim of the last surface."""
    IRIS_NOT_FILLED = 7
    """Other rims or stops, not the iris, limit the beam on the axis, to less than 95 % of the iris's semi-diameter."""
    NO_LIGHT = 8
    """None of the traced rays passes the lens."""
    TOTAL_REFLECTION = 9
    """Unvignetted rays are totally reflected, or miss a surface."""
    GRAZING = 10
    """Transmitted rays have an angle of incidence above 84.3 degrees at a surface: 1 / cos i is above 10."""
    NEAR_TOTAL_REFLECTION = 11
    """Transmitted rays are close to total reflection: d i' / d i = n cos i / (n' cos i') is above 10."""
    CANCELLATION = 12
    """The lengths that enter an intersection exceed 10^4 times the size of the element: more than 4 of the 15.7 decimal
    digits of float64 are lost."""
    VERTEX = 13
    """A surface without rotational symmetry is tilted or astigmatic at its vertex, by slopes above 0.001, which
    Gaussian data neglect."""
    APERTURE = 14
    """The entrance pupil, or the semi-diameter of the iris, differs from that in the lens file by more than 1 %."""


@result
class Finding:
    """Implausible property of a lens; made by `LensStack.check`. `print` shows its message.

    Attributes
    ----------
    kind : FindingKind
    elements : tuple of int
        Indices in `LensStack.elements` of the elements concerned, in ascending order.
    message : str
        Sentence with the values and a remedy.

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


class Findings(tuple[Finding, ...]):
    """Findings of `LensStack.check`, a tuple that prints as sentences, one a line.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.load_lens("double-gauss-100mm-f2").check()
    no findings: nothing is implausible
    """

    __slots__ = ()

    def __repr__(self) -> str:
        return "\n".join(map(str, self)) or "no findings: nothing is implausible"
