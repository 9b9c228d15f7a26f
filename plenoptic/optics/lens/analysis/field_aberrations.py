"""Aberrations against the field, by real rays: distortion, field curvature, coma, distortion of depth.

Fields lie along +y: half angles in rad for objects at infinity, otherwise heights in mm in the plane z_object. Rays are
aimed at the real iris; rims do not clip them. A field without a chief ray gives nan. Vignetting and relative
illumination are in `illumination`.
"""

from __future__ import annotations

import enum
import math

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.display import picture_of
from plenoptic.core.rays import RayBundle
from plenoptic.core.values import Floats, check_kind, choice, frozen_array, number, positive, result
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.analysis.astigmatic import foci, require_axis
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points, image_position, magnification, object_position
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.pupil.ray_aiming import aimed_rays, aimed_rays_reverse, chief_ray
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.lens.trace import trace_part


class Projection(enum.IntEnum):
    """Projection of the half angle theta by an ideal lens of focal length f.

    RECTILINEAR: f tan(theta), straight lines stay straight. EQUIDISTANT: f theta, the approximate projection of most
    fisheyes. STEREOGRAPHIC: 2 f tan(theta / 2), circles stay circles. EQUISOLID: 2 f sin(theta / 2), equal solid angles
    have equal areas. ORTHOGRAPHIC: f sin(theta), equal illumination by a uniform sky.

    Examples
    --------
    >>> import plenoptic as pl
    >>> float(pl.aberrations.Projection.EQUIDISTANT.height(100.0, 0.5))
    50.0
    """

    RECTILINEAR = 0
    EQUIDISTANT = 1
    STEREOGRAPHIC = 2
    EQUISOLID = 3
    ORTHOGRAPHIC = 4

    def height(self, focal_length: float, angle: ArrayLike) -> Floats:
        """Image height in mm of a half angle in rad; negative angles have negative heights."""
        theta = np.asarray(angle, dtype=np.float64)
        scaled = {
            Projection.RECTILINEAR: lambda: np.tan(theta),
            Projection.EQUIDISTANT: lambda: theta,
            Projection.STEREOGRAPHIC: lambda: 2.0 * np.tan(theta / 2.0),
            Projection.EQUISOLID: lambda: 2.0 * np.sin(theta / 2.0),
            Projection.ORTHOGRAPHIC: lambda: np.sin(theta),
        }[self]()
        return np.asarray(focal_length * scaled)


def checked_fields(lens: LensStack, fields: ArrayLike, z_object: float, *, name: str = "fields") -> Floats:
    """Fields (n,) of a lens: finite, angles below pi."""
    check_kind(lens, "lens", LensStack, "camera.lens")
    radii = frozen_array(np.atleast_1d(np.asarray(fields, dtype=object)), name=name, shape=(None,))
    far = number(z_object, "z_object") == -math.inf
    if not np.all(np.abs(radii) < (math.pi if far else math.inf)):
        unit = "angles below pi, in rad" if far else "finite heights in mm"
        raise InvalidValueError(f"{name} reach {np.max(np.abs(radii)):g}; with this z_object they must be {unit}")
    return radii


def image_plane(lens: LensStack, z_object: float, wavelength: float) -> float:
    """Position z in mm of the paraxial image plane; an error if the image is at infinity."""
    z = image_position(lens, z_object, wavelength)
    if not math.isfinite(z):
        raise InvalidValueError(f"{lens.name!r} images z_object {z_object:g} mm to infinity; move the object")
    return z


def trace_past_rims(lens: LensStack, rays: RayBundle) -> RayBundle:
    """Trace a bundle without clipping by rims; a lens that is not LensModel.EXACT is traced by its model."""
    if lens.model is not LensModel.EXACT:
        return lens.trace(rays)
    return trace_part(lens, rays, 0, len(lens.elements) - 1, clipping=False)


def chief_rays(lens: LensStack, fields: Floats, z_object: float, wavelength: float) -> RayBundle:
    """Chief rays of fields (n,) along +y, in front of the lens."""
    rays = [chief_ray(lens, field=(0.0, y), z_object=z_object, wavelength=wavelength) for y in fields.tolist()]
    origin, direction = (np.reshape([getattr(ray, name) for ray in rays], (-1, 3)) for name in ("origin", "direction"))
    return RayBundle(origin, direction, wavelength, status=np.ravel([ray.status for ray in rays]))


@result
class Distortion:
    """Heights of chief rays in the paraxial image plane. Made by `distortion`.

    Attributes
    ----------
    fields : (n,) array
        rad, or mm.
    height : (n,) array
        y of the real chief ray in mm: mostly below 0, since the image is inverted.
    ideal : (n,) array
        y of the ideal image in mm.
    projection : Projection
    z_image : float
        Paraxial image plane, mm.
    z_object : float
        mm; -inf for an object at infinity.
    """

    fields: Floats
    height: Floats
    ideal: Floats
    projection: Projection
    z_image: float
    z_object: float

    @property
    def relative(self) -> Floats:
        """(height - ideal) / ideal, (n,): negative for barrel, positive for pincushion distortion; 0 on the axis."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.ideal == 0, 0.0 * self.height, self.height / self.ideal - 1.0)

    _repr_html_ = picture_of


def distortion(
    lens: LensStack,
    fields: ArrayLike,
    *,
    z_object: float = -math.inf,
    wavelength: float = 587.6,
    projection: Projection = Projection.RECTILINEAR,
) -> Distortion:
    """Distortion: intersections of chief rays with the paraxial image plane, relative to an ideal projection.

    Parameters
    ----------
    lens : LensStack
    fields : (n,) array
        Along +y: half angles in rad, or heights in mm in the plane z_object.
    z_object : float, optional
        mm; -inf for an object at infinity.
    wavelength : float, optional
        nm.
    projection : Projection, optional
        Ideal projection for an object at infinity. For a finite object the ideal image is the paraxial one:
        RECTILINEAR.

    Raises
    ------
    InvalidValueError
        If the image is at infinity or the projection does not reach the fields.

    References
    ----------
    W. J. Smith, Modern Optical Engineering, 4th ed., chapter 5.

    Examples
    --------
    >>> import plenoptic as pl
    >>> distortion = pl.aberrations.distortion(pl.load_lens("double-gauss-100mm-f2"), [0.0, 0.2, 0.35])
    >>> (100 * distortion.relative).round(2).tolist()
    [0.0, -0.3, -1.08]
    """
    radii, ideal = checked_fields(lens, fields, z_object), choice(projection, Projection, "projection")
    require_axis(lens, "distortion is")
    z_image = image_plane(lens, z_object, wavelength)
    if z_object != -math.inf:
        if ideal is not Projection.RECTILINEAR:
            raise InvalidValueError(
                f"projection is {ideal.name} with z_object {z_object:g} mm; the image of a plane is RECTILINEAR: "
                "leave it at that, or give z_object=-math.inf and angles"
            )
        heights = magnification(lens, z_object, wavelength) * radii
    else:
        if ideal is Projection.RECTILINEAR and np.any(np.abs(radii) >= math.pi / 2):
            raise InvalidValueError(
                f"fields reach {np.max(np.abs(radii)):g} rad, which has no RECTILINEAR image; stay below pi / 2 or use "
                "Projection.EQUIDISTANT"
            )
        heights = -ideal.height(cardinal_points(lens, wavelength).front_efl, radii)
    out = trace_past_rims(lens, chief_rays(lens, radii, z_object, wavelength))
    return Distortion(radii, out.at_z(z_image)[:, 1], heights, ideal, z_image, z_object)


@result
class FieldCurvature:
    """Foci of narrow beams around chief rays. Made by `field_curvature`.

    Attributes
    ----------
    fields, z_image, z_object
        As in `Distortion`.
    sagittal, tangential : (n,) array
        z of the foci minus z of the paraxial image plane, mm: negative towards the lens.
    height : (n,) array
        y of the chief ray in the paraxial image plane, mm.
    """

    fields: Floats
    sagittal: Floats
    tangential: Floats
    height: Floats
    z_image: float
    z_object: float

    @property
    def astigmatism(self) -> Floats:
        """Tangential minus sagittal, (n,), mm."""
        return np.asarray(self.tangential - self.sagittal)

    @property
    def medial(self) -> Floats:
        """Mean of sagittal and tangential, (n,), mm: about the position of the smallest spot."""
        return np.asarray((self.tangential + self.sagittal) / 2.0)

    _repr_html_ = picture_of


def field_curvature(
    lens: LensStack, fields: ArrayLike, *, z_object: float = -math.inf, wavelength: float = 587.6
) -> FieldCurvature:
    """Sagittal and tangential image surfaces, hence astigmatism, by Coddington's equations along real chief rays.

    Parameters
    ----------
    lens : LensStack
        Centred, LensModel.EXACT.
    fields, z_object, wavelength
        See `distortion`.

    Raises
    ------
    InvalidValueError
        If the lens is not centred or not EXACT, or the image is at infinity.

    References
    ----------
    R. Kingslake and R. B. Johnson, Lens Design Fundamentals, 2nd ed., section 11.1.

    Examples
    --------
    >>> import plenoptic as pl
    >>> surfaces = pl.aberrations.field_curvature(pl.load_lens("singlet-100mm-f4"), [0.0, 0.1])
    >>> surfaces.sagittal.round(2).tolist(), surfaces.tangential.round(2).tolist()
    ([0.0, -0.82], [0.0, -1.8])
    """
    radii = checked_fields(lens, fields, z_object)
    z_image = image_plane(lens, z_object, wavelength)
    chiefs = chief_rays(lens, radii, z_object, wavelength)
    narrow_foci = foci(lens, chiefs, parallel=z_object == -math.inf)
    sagittal, tangential = narrow_foci.sagittal[:, 2] - z_image, narrow_foci.tangential[:, 2] - z_image
    return FieldCurvature(radii, sagittal, tangential, narrow_foci.ray.at_z(z_image)[:, 1], z_image, z_object)


@result
class Coma:
    """Sagittal and tangential coma. Made by `coma`.

    Attributes
    ----------
    fields, z_image, z_object
        As in `Distortion`.
    sagittal, tangential : (n,) array
        Mean y of two rays through opposite points of the zone, along x and along y, minus y of the chief ray, in mm.
    zone : float
        Distance of these points from the centre of the iris in units of its semi-diameter.
    """

    fields: Floats
    sagittal: Floats
    tangential: Floats
    zone: float
    z_image: float
    z_object: float

    _repr_html_ = picture_of


def coma(
    lens: LensStack, fields: ArrayLike, *, zone: float = 1.0, z_object: float = -math.inf, wavelength: float = 587.6
) -> Coma:
    """Sagittal and tangential coma of a zone of the iris, in the paraxial image plane.

    Parameters
    ----------
    lens, fields, z_object, wavelength
        See `distortion`.
    zone : float, optional
        Radius of the zone in units of the semi-diameter of the iris.

    Returns
    -------
    Coma
        In third order the tangential coma is 3 times the sagittal one, and both grow with the field and with zone^2.

    Raises
    ------
    InvalidValueError
        If the image is at infinity or the zone is not above 0.

    References
    ----------
    R. Kingslake and R. B. Johnson, Lens Design Fundamentals, 2nd ed., chapter 9.

    Examples
    --------
    >>> import plenoptic as pl
    >>> coma = pl.aberrations.coma(pl.load_lens("singlet-100mm-f4"), [0.02], zone=0.1)
    >>> bool(abs(coma.tangential[0] / coma.sagittal[0] - 3) < 0.01)
    True
    """
    radii, size = checked_fields(lens, fields, z_object), positive(zone, "zone")
    require_axis(lens, "coma is")
    z_image = image_plane(lens, z_object, wavelength)
    pupil = size * np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    y = np.empty((len(radii), 5))
    for i, field in enumerate(radii.tolist()):
        rays = aimed_rays(lens, field=(0.0, field), pupil=pupil, z_object=z_object, wavelength=wavelength)
        y[i] = trace_past_rims(lens, rays).at_z(z_image)[:, 1]
    return Coma(radii, (y[:, 1] + y[:, 2]) / 2 - y[:, 0], (y[:, 3] + y[:, 4]) / 2 - y[:, 0], size, z_image, z_object)


@result
class DepthDistortion:
    """Object points in focus on a flat sensor. Made by `depth_distortion`.

    Attributes
    ----------
    heights : (n,) array
        y of points of the sensor, mm.
    z_image : (m,) array
        Planes of the sensor, mm.
    z_object : (m,) array
        Their paraxial conjugates, mm.
    sagittal, tangential : (m, n) array
        z in mm of the object points in focus on the chief rays; above 0 if the lens is focused beyond infinity.
    """

    heights: Floats
    z_image: Floats
    z_object: Floats
    sagittal: Floats
    tangential: Floats

    @property
    def medial(self) -> Floats:
        """Harmonic mean of the sagittal and tangential z, (m, n), mm: the mean of their reciprocals."""
        with np.errstate(divide="ignore"):
            return np.asarray(2.0 / (1.0 / self.sagittal + 1.0 / self.tangential))

    _repr_html_ = picture_of


def depth_distortion(
    lens: LensStack, heights: ArrayLike, *, z_image: ArrayLike, wavelength: float = 587.6
) -> DepthDistortion:
    """Object points in focus on flat sensors, against the image height: field curvature in object space.

    The difference from `z_object` is the depth error of a camera calibrated on the axis, which measures depth by focus
    or disparity. Chief rays are traced in reverse from the sensor.

    Parameters
    ----------
    lens, wavelength
        See `field_curvature`.
    heights : (n,) array
        y on the sensor, mm.
    z_image : float or (m,) array
        Planes of the sensor behind the lens, mm. For a plenoptic camera, those of the virtual images.

    Raises
    ------
    InvalidValueError
        If the lens is not centred or not EXACT, or a plane does not lie behind it.

    References
    ----------
    O. Johannsen et al., On the calibration of focused plenoptic cameras, LNCS 8200, 2013 (the term).

    Examples
    --------
    >>> import plenoptic as pl
    >>> depth = pl.aberrations.depth_distortion(pl.load_lens("double-gauss-100mm-f2"), [0.0, 20.0], z_image=134.624)
    >>> depth.z_object.round(2).tolist(), depth.medial.round(2).tolist()
    ([-404.0], [[-404.0, -399.29]])
    """
    radii = checked_fields(lens, heights, 0.0, name="heights")
    planes = checked_fields(lens, z_image, 0.0, name="z_image")
    sagittal, tangential = np.empty((2, len(planes), len(radii)))
    for i, z in enumerate(planes.tolist()):
        for j, y in enumerate(radii.tolist()):
            ray = aimed_rays_reverse(lens, image_point=(0.0, y), z_image=z, pupil=[[0.0, 0.0]], wavelength=wavelength)
            narrow_foci = foci(lens, ray, parallel=False, reverse=True)
            sagittal[i, j], tangential[i, j] = narrow_foci.sagittal[0, 2], narrow_foci.tangential[0, 2]
    conjugates = np.array([object_position(lens, z, wavelength) for z in planes.tolist()])
    return DepthDistortion(radii, planes, conjugates, sagittal, tangential)
