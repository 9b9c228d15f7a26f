"""Third-order aberrations surface by surface, and primary chromatic aberration."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from plenoptic.core.display import picture_of
from plenoptic.core.values import Floats, check_has, coordinate, finite, result
from plenoptic.errors import InvalidValueError
from plenoptic.optics.glass.media import C_LINE, D_LINE, F_LINE
from plenoptic.optics.lens.gaussian.marginal_and_chief import ParaxialRay, chief_ray, lagrange_invariant, marginal_ray
from plenoptic.optics.lens.gaussian.paraxial import image_position, image_side_aperture
from plenoptic.optics.lens.pupil.beam import checked_wavelengths
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.surfaces.surface import Surface

_SUMS = ("spherical", "coma", "astigmatism", "petzval", "distortion")
_LINES = (F_LINE, D_LINE, C_LINE)


@result
class SeidelSums:
    """Seidel sums S_I to S_V, element by element, in mm. Made by `seidel_sums`.

    Attributes
    ----------
    spherical, coma, astigmatism, petzval, distortion : (n,) arrays
        S_I, S_II, S_III, S_IV and S_V of each element in mm, as Welford defines them; 0 for stops.
    aperture : float
        n' u' of the marginal ray behind the lens, negative for converging light.
    wavelength : float
        nm.

    References
    ----------
    W. T. Welford, Aberrations of Optical Systems, 1986, chapter 8. Other definitions differ by
    factors: here W040 is S_I / 8, not S_I / 4.
    """

    spherical: Floats
    coma: Floats
    astigmatism: Floats
    petzval: Floats
    distortion: Floats
    aperture: float
    wavelength: float

    @property
    def table(self) -> Floats:
        """(n, 5): one row for each element, S_I to S_V in mm."""
        return np.stack([getattr(self, name) for name in _SUMS], axis=1)

    @property
    def total(self) -> Floats:
        """(5,): S_I to S_V of the lens in mm."""
        return np.asarray(self.table.sum(axis=0))

    @property
    def wavefront(self) -> Floats:
        """(5,): wavefront coefficients W040, W131, W222, W220 and W311 at the rim of pupil and field, in mm.

        S_I / 8, S_II / 2, S_III / 2, (S_III + S_IV) / 4 and S_V / 2 (Welford, chapter 8): W220 is the sagittal field
        curvature, and W220 + W222 the tangential one.
        """
        s1, s2, s3, s4, s5 = self.total
        return np.array([s1 / 8, s2 / 2, s3 / 2, (s3 + s4) / 4, s5 / 2])

    @property
    def transverse(self) -> Floats:
        """(5,): transverse aberrations in the Gaussian image plane in mm.

        Spherical aberration of the marginal ray S_I / (2 n'u') and tangential coma 3 S_II / (2 n'u'). Rim rays by
        tangential field curvature (3 S_III + S_IV) / (2 n'u'), by sagittal field curvature (S_III + S_IV) / (2 n'u').
        Distortion of the chief ray S_V / (2 n'u'). The pupil is a disc of radius 1 and the object lies above the axis.
        A ray through the pupil point (x, y) then misses the Gaussian image by (dW/dx, dW/dy) / (n'u'). The wavefront is
        W = W040 r^4 + W131 r^2 y + W222 y^2 + W220 r^2 + W311 y. Infinite or nan if the emerging light is collimated.
        """
        s1, s2, s3, s4, s5 = self.total
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.array([s1, 3 * s2, 3 * s3 + s4, s3 + s4, s5]) / np.float64(2.0 * self.aperture)

    def __repr__(self) -> str:
        head = f"SeidelSums at {self.wavelength:g} nm, mm\n  element " + "".join(f"{name:>13}" for name in _SUMS)
        rows = [f"  {i:>7} " + "".join(f"{s:>13.5g}" for s in row) for i, row in enumerate(self.table) if row.any()]
        return "\n".join([head, *rows, "      sum " + "".join(f"{s:>13.5g}" for s in self.total)])

    _repr_html_ = picture_of


def seidel_sums(lens: LensStack, *, field: float, z_object: float = -math.inf, wavelength: float = 587.6) -> SeidelSums:
    r"""Seidel sums of a lens, with conics and aspheres.

    With the marginal ray (y, u) through the rim of the iris, the chief ray (:math:`\bar y, \bar u`) through its
    centre, A = n (u + y c), :math:`\bar A = n (\bar u + \bar y c)` and the invariant H,

    .. math:: S_I = -\sum A^2 y\, \Delta(u/n), \quad S_{II} = -\sum A \bar A y\, \Delta(u/n), \quad
              S_{III} = -\sum \bar A^2 y\, \Delta(u/n), \quad S_{IV} = -\sum H^2 c\, \Delta(1/n), \quad
              S_V = -\sum \bar A \{ \bar A^2 \Delta(1/n^2)\, y + (H - \bar A y)\, \bar y c\, \Delta(1/n) \}

    An r^4 term g beyond that of the sphere of the same vertex curvature adds :math:`8 g\, \Delta n\, y^4` to S_I. It
    adds the same times :math:`\bar y / y`, its square and its cube to S_II, S_III and S_V.

    Parameters
    ----------
    lens : LensStack
        Decentred and tilted elements count as centred.
    field, z_object, wavelength
        See `plenoptic.paraxial.chief_ray`; the sums refer to this field.

    Returns
    -------
    SeidelSums
        Sums by element, in the order of travel. S_I > 0 is undercorrected spherical aberration, S_IV > 0 a field curved
        towards the lens.

    Raises
    ------
    InvalidValueError
        If the object is not in front of the lens, the field of an object at infinity is 90 degrees or more, or object
        and iris are conjugate; a field beyond 1e15.

    References
    ----------
    W. T. Welford, Aberrations of Optical Systems, 1986, chapter 8, with S_V in the form without 0 / 0 for A = 0.

    Examples
    --------
    >>> import plenoptic as pl
    >>> sums = pl.aberrations.seidel_sums(pl.load_lens("double-gauss-100mm-f2"), field=0.17)
    >>> bool(abs(sums.total[0]) < 0.2 * abs(sums.spherical).max())       # surfaces balance each other
    True
    """
    marginal = marginal_ray(lens, z_object, wavelength)
    chief = chief_ray(lens, coordinate(field, "field"), z_object, wavelength)
    invariant = lagrange_invariant(marginal, chief)
    table = np.zeros((len(lens.elements), len(_SUMS)))
    for i, element in enumerate(lens.elements):
        if isinstance(element, Surface):
            table[i] = _spherical_part(element, marginal, chief, invariant, i)
            table[i] += _aspheric_part(element, marginal, chief, i)
    spherical, coma, astigmatism, petzval, distortion = table.T
    aperture = image_side_aperture(lens, marginal, wavelength)
    return SeidelSums(spherical, coma, astigmatism, petzval, distortion, aperture, float(wavelength))


def _spherical_part(surface: Surface, marginal: ParaxialRay, chief: ParaxialRay, invariant: float, i: int) -> Floats:
    c, n, n_behind = surface.vertex_curvature, marginal.index[i], marginal.index[i + 1]
    signed = surface.signed_index(n_behind)
    y, y_bar = marginal.height[i], chief.height[i]
    a = n * (marginal.angle[i] + y * c)
    a_bar = n * (chief.angle[i] + y_bar * c)
    slope_step = marginal.angle[i + 1] / n_behind - marginal.angle[i] / n
    inverse_step, inverse_square_step = 1 / signed - 1 / n, 1 / n_behind**2 - 1 / n**2
    distortion = a_bar * (a_bar**2 * inverse_square_step * y + (invariant - a_bar * y) * y_bar * c * inverse_step)
    bent, petzval = y * slope_step, invariant**2 * c * inverse_step
    return -np.array([a * a * bent, a * a_bar * bent, a_bar**2 * bent, petzval, distortion])


def _aspheric_part(surface: Surface, marginal: ParaxialRay, chief: ParaxialRay, i: int) -> Floats:
    """Contribution of the r^4 term beyond that of the sphere of the same vertex curvature."""
    if surface.freeform is not None:
        raise InvalidValueError(
            f"surface {i} has a freeform term, for which Seidel sums are not defined; leave it out, or use spot "
            "diagrams"
        )
    fourth = surface.aspheric[1] if len(surface.aspheric) > 1 else 0.0
    excess = ((1.0 + surface.conic) * surface.curvature**3 - surface.vertex_curvature**3) / 8.0 + fourth
    strength = 8.0 * excess * (surface.signed_index(marginal.index[i + 1]) - marginal.index[i])
    y, y_bar = marginal.height[i], chief.height[i]
    return np.asarray(strength * np.array([y**4, y**3 * y_bar, y**2 * y_bar**2, 0.0, y * y_bar**3]))


@result
class ChromaticShift:
    """Axial and lateral chromatic shift: paraxial focus and image height of each wavelength. Made by `chromatic_shift`.

    Attributes
    ----------
    wavelengths : (n,) array
        nm.
    focus : (n,) array
        z of the image of the axial point in the lens frame, mm.
    height : (n,) array
        Height of the chief ray in the image plane of the reference wavelength, mm.
    reference : float
        Reference wavelength in nm, which defines the image plane of `height`.
    """

    wavelengths: Floats
    focus: Floats
    height: Floats
    reference: float

    @property
    def axial(self) -> float:
        """Focus of the last wavelength less that of the first, mm: positive for a simple lens from F to C."""
        return float(self.focus[-1] - self.focus[0])

    @property
    def lateral(self) -> float:
        """Height of the last wavelength less that of the first, mm."""
        return float(self.height[-1] - self.height[0])

    @property
    def secondary_spectrum(self) -> float:
        """Mean focus of the first and the last wavelength less that of the reference, mm.

        For an achromat at F, d and C, whose foci at F and C coincide, it is positive, about f / 2000.
        """
        at_reference = self.focus[np.flatnonzero(self.wavelengths == self.reference)[0]]
        return float(0.5 * (self.focus[0] + self.focus[-1]) - at_reference)

    _repr_html_ = picture_of


def chromatic_shift(
    lens: LensStack,
    *,
    wavelengths: Sequence[float] = _LINES,
    reference: float | None = None,
    field: float = 0.0,
    z_object: float = -math.inf,
) -> ChromaticShift:
    """Paraxial image positions and heights against the wavelength.

    Parameters
    ----------
    lens : LensStack
    wavelengths : sequence of float, optional
        nm; the hydrogen and helium lines F, d and C by default.
    reference : float, optional
        One of the wavelengths, whose image plane defines the heights; by default the middle one of the list.
    field, z_object
        See `seidel_sums`.

    Raises
    ------
    InvalidValueError
        If there are no wavelengths, the reference is not among them, a glass is not defined at one of them, or `field`
        is not 0 and the emerging light is collimated.

    References
    ----------
    W. T. Welford, Aberrations of Optical Systems, 1986, chapter 10.

    Examples
    --------
    >>> import plenoptic as pl
    >>> shift = pl.aberrations.chromatic_shift(pl.load_lens("singlet-100mm-f4"))
    >>> round(shift.axial, 2)                           # about f / V = 100 / 64.2; below 0.2 for an achromat
    1.53
    """
    lines = np.array(checked_wavelengths(wavelengths))
    middle = float(lines[len(lines) // 2]) if reference is None else finite(reference, "reference")
    if middle not in lines:
        raise InvalidValueError(f"reference is {middle:g} nm; it must be one of the wavelengths {lines.tolist()}")
    focus = np.array([image_position(lens, z_object, w) for w in lines.tolist()])
    plane, height = float(focus[np.flatnonzero(lines == middle)[0]]), np.zeros(len(lines))
    if finite(field, "field") == 0.0:
        return ChromaticShift(lines, focus, height, middle)
    if math.isinf(plane):
        raise InvalidValueError(
            f"field is {field:g}, but the emerging light is collimated, so the image has no height; give field=0"
        )
    for i, w in enumerate(lines.tolist()):
        ray = chief_ray(lens, field, z_object, w)
        height[i] = ray.height[-1] + ray.angle[-1] * (plane - float(lens.vertices[-1]))
    return ChromaticShift(lines, focus, height, middle)


def colour_sums(
    lens: LensStack, *, field: float, z_object: float = -math.inf, wavelengths: Sequence[float] = _LINES
) -> Floats:
    r"""Chromatic sums C_I (axial) and C_II (lateral), element by element.

    .. math:: C_I = \sum A y\, \Delta(\delta n / n), \qquad C_{II} = \sum \bar A y\, \Delta(\delta n / n)

    Parameters
    ----------
    lens : LensStack
    field, z_object
        As for `seidel_sums`.
    wavelengths : (3,) sequence of float, optional
        Short, middle and long, nm: dn = n(short) - n(long); rays are traced at the middle one.

    Returns
    -------
    (n, 2) array
        C_I and C_II of each element in mm. To the first order in dn, sum(C_I) / (n' u'^2) is the focal shift from short
        to long. -sum(C_II) / (n' u') is the shift of the image height.

    References
    ----------
    W. T. Welford, Aberrations of Optical Systems, 1986, chapter 10.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.aberrations.colour_sums(pl.load_lens("achromat-100mm-f4.4"), field=0.01).shape
    (4, 2)
    """
    lines = checked_wavelengths(wavelengths)
    if len(lines) != 3:
        raise InvalidValueError(f"wavelengths is {list(lines)}; it must be three: short, middle, long, nm")
    check_has(lens, "lens", "LensStack", "pl.load_lens(...)", "indices")
    short, middle, long = lines
    spread = np.asarray(lens.indices(short)) - np.asarray(lens.indices(long))
    marginal = marginal_ray(lens, z_object, middle)
    chief = chief_ray(lens, field, z_object, middle)
    sums = np.zeros((len(lens.elements), 2))
    for i, element in enumerate(lens.elements):
        if isinstance(element, Surface):
            c, n, y = element.vertex_curvature, marginal.index[i], marginal.height[i]
            step = spread[i + 1] / marginal.index[i + 1] - spread[i] / n
            sums[i] = y * step * n * np.array([marginal.angle[i] + y * c, chief.angle[i] + chief.height[i] * c])
    return sums
