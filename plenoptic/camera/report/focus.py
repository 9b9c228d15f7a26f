"""Focus of the microlenses of one type: planes, depth of field, virtual depth, disparity, resolution."""

from __future__ import annotations

import enum
import math

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.report.optics import (
    Cone,
    cell_area,
    image_plane,
    lateral_magnification,
    neighbour_distance,
    object_plane,
    opening_width,
)
from plenoptic.core.values import value
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.analysis.focus import best_focus
from plenoptic.optics.lens.gaussian.matrices import over
from plenoptic.optics.lens.models import FocusCriterion, LensModel

_STEPS = 8
"""Corrections of the traced focus; each makes the error some ten to a thousand times smaller."""
_EXACT = 1e-10
"""Error of the traced image that ends the search, over its distance."""
SAME = 1e-9
"""Relative difference of b and f up to which microlenses count as focused at infinity, as in `focused_at`."""


class CameraKind(enum.IntEnum):
    """Kind of camera, by the image that the microlenses relay.

    Examples
    --------
    >>> import plenoptic as pl
    >>> [kind.name for kind in pl.CameraKind]
    ['CONVENTIONAL', 'PLENOPTIC_1', 'KEPLERIAN', 'GALILEAN', 'CAMERA_ARRAY']
    """

    CONVENTIONAL = 0
    """No microlenses: the main lens images onto the sensor."""
    PLENOPTIC_1 = 1
    """Microlenses focused at infinity; the main lens images onto the array (R. Ng et al. 2005)."""
    KEPLERIAN = 2
    """Focused plenoptic camera whose image lies in front of the array: real."""
    GALILEAN = 3
    """Focused plenoptic camera whose image would lie behind the array: virtual."""
    CAMERA_ARRAY = 4
    """Microlenses without a main lens (LensModel.NONE): they see the scene itself."""


@value
class MicrolensFocus:
    """Focus of the microlenses of one type, as part of a report. See `camera_report`.

    With s the distance behind the array at which the main lens forms an image (negative in front of it), b the distance
    from array to sensor, f the focal length and d the opening of a microlens, p their pitch and q that of the pixels:

    - sharp: 1/s = 1/b - 1/f, and s = 0 for a plenoptic 1.0;
    - virtual depth v = ``|s| / b``;
    - depth of field: light of a point is spread on the sensor over ``d b |1/s - 1/b + 1/f|``, at most q. In a plenoptic
      1.0 a point moves between the views of neighbouring pixels by at most one microlens: ``|s| <= p b / q``. Without
      microlenses it is spread over at most q by the exit pupil;
    - disparity: ``p b / |s| / q`` pixels between the images of neighbouring microlenses, relative to their centres; in
      a plenoptic 1.0, s q / (b p) microlenses between the views of neighbouring pixels, positive for near objects;
    - effective resolution: 1 / max(v, 1) of the sensor's pixels along each axis; in a plenoptic 1.0, microlenses.

    Attributes
    ----------
    type : int
        Row of the array's `focal_lengths`; 0 without microlenses.
    kind : CameraKind
    focal_length : float or None
        mm, at the camera's wavelength.
    image_distance : float
        s in mm; 0 in a plenoptic 1.0 and without microlenses.
    virtual_depth : float or None
        v; None without microlenses.
    z : float
        The plane in focus by Gaussian optics in the camera's frame, mm; -inf for the horizon, nan where there is none
        in front of the lens.
    z_traced : float
        The same by exact rays that fill the iris (least RMS spot in the main lens's image).
    z_far, z_near : float
        Limits of the depth of field by Gaussian optics; nan if there is none.
    magnification : float
        Of the main lens for the plane in focus; nan without one in focus, 1 without a main lens.
    object_sampling : float
        Distance in the plane in focus of the points that neighbouring pixels see (plenoptic 1.0: neighbouring
        microlenses), mm.
    lenses_across, lenses_seeing : float
        Diameter of the light of a point in focus on the array over the pitch, and how many microlenses that light
        covers on average, at least 1; nan without microlenses.
    disparity : float or None
        Of the plane in focus.
    disparity_far, disparity_near : float or None
        At the limits of the depth of field.
    effective_resolution : float or None
        Of the sensor's pixels, along each axis, in focus; None for a camera array.

    References
    ----------
    C. Perwass and L. Wietzke, Single lens 3D-camera with extended depth-of-field, Proc. SPIE 8291, 2012
    (doi 10.1117/12.909882): virtual depth, effective resolution. T. Georgiev and A. Lumsdaine, Focused plenoptic camera
    and rendering, J. Electronic Imaging 19, 2010 (doi 10.1117/1.3442712). R. Ng et al., Light field photography with a
    hand-held plenoptic camera, Stanford CTSR 2005-02.
    """

    type: int
    kind: CameraKind
    focal_length: float | None
    image_distance: float
    virtual_depth: float | None
    z: float
    z_traced: float
    z_far: float
    z_near: float
    magnification: float
    object_sampling: float
    lenses_across: float
    lenses_seeing: float
    disparity: float | None
    disparity_far: float | None
    disparity_near: float | None
    effective_resolution: float | None


def kind_of(camera: PlenopticCamera, focal_length: float | None) -> CameraKind:
    """The kind of a camera through its microlenses of one focal length; None: without microlenses."""
    if focal_length is None:
        return CameraKind.CONVENTIONAL
    if camera.lens.model is LensModel.NONE:
        return CameraKind.CAMERA_ARRAY
    image = sharp_image(camera, focal_length)
    if image == 0:
        return CameraKind.PLENOPTIC_1
    return CameraKind.GALILEAN if image > 0 else CameraKind.KEPLERIAN


def sharp_image(camera: PlenopticCamera, focal_length: float | None) -> float:
    """Position s of the main lens's sharp image in mm behind the array; -inf for a camera array focused at infinity."""
    if focal_length is None:
        return 0.0
    b = camera.microlenses_to_sensor
    if math.isclose(b, focal_length, rel_tol=SAME):
        return -math.inf if camera.lens.model is LensModel.NONE else 0.0
    return b * focal_length / (focal_length - b)


def microlens_focus(camera: PlenopticCamera, type_: int, cone: Cone) -> MicrolensFocus:
    """All of it for one type of microlens."""
    array, q = camera.microlenses, camera.sensor.pixel_pitch
    f = None if array is None else array.focal_lengths_at(camera.wavelength)[type_]
    kind, s = kind_of(camera, f), sharp_image(camera, f)
    z_image = camera.stop_to_microlenses + s
    z, (far, near) = plane_in_front(camera, z_image), _limits(camera, kind, s, cone)
    m = lateral_magnification(camera.lens, z, camera.wavelength) if not math.isnan(z) else math.nan
    spacing, across, seeing, resolution = 1.0, math.nan, math.nan, 1.0
    pixel, v = q, None
    disparities: list[float | None] = [None] * 3
    if array is not None:
        b, p = camera.microlenses_to_sensor, neighbour_distance(array)
        width = footprint(cone, s)
        across, seeing = width / p, max(1.0, math.pi / 4 * width**2 / cell_area(array))
        images = [image_plane(camera.lens, x, camera.wavelength) - camera.stop_to_microlenses for x in (far, near)]
        disparities = [disparity_of(kind, x, b, p, q) for x in (s, *images)]
        v = abs(s) / b
        if kind is CameraKind.PLENOPTIC_1:
            resolution = min(1.0, q / math.sqrt(cell_area(array)) / abs(1.0 + b * cone.vergence))
            pixel = p
        else:
            resolution, spacing = 1.0 / max(v, 1.0), 1.0 / v
    return MicrolensFocus(
        type=type_,
        kind=kind,
        focal_length=f,
        image_distance=s,
        virtual_depth=v,
        z=z,
        z_traced=traced_plane(camera, z_image),
        z_far=far,
        z_near=near,
        magnification=m,
        object_sampling=over(pixel, abs(m) * spacing),
        lenses_across=across,
        lenses_seeing=seeing,
        disparity=disparities[0],
        disparity_far=disparities[1],
        disparity_near=disparities[2],
        effective_resolution=None if kind is CameraKind.CAMERA_ARRAY else resolution,
    )


def footprint(cone: Cone, s: float) -> float:
    """Diameter on the array of the light that converges at s behind it, filling the exit pupil, in mm."""
    if math.isinf(s):
        return over(2.0 * cone.slope, abs(cone.vergence))
    return over(2.0 * cone.slope * abs(s), abs(1.0 + s * cone.vergence))


def disparity_of(kind: CameraKind, s: float, b: float, p: float, q: float) -> float:
    """Between neighbouring microlenses in pixels, or between neighbouring views in microlenses; see MicrolensFocus."""
    return s * q / (b * p) if kind is CameraKind.PLENOPTIC_1 else over(p * b / q, abs(s))


def traced_plane(camera: PlenopticCamera, z_image: float) -> float:
    """The plane in front of the lens whose image by exact rays is sharpest at z_image; nan where there is none.

    Newton's method with the longitudinal magnification of Gaussian optics. Ideal lenses need none of it: their rays
    follow Gaussian optics.
    """
    lens, wavelength = camera.lens, camera.wavelength
    if lens.model is not LensModel.EXACT:
        return plane_in_front(camera, z_image)
    aim, front = z_image, float(lens.vertices[0])
    for _ in range(_STEPS):
        z = object_plane(lens, aim, wavelength)
        beyond = not z < front
        if beyond:
            z = -math.inf
        try:
            focus = best_focus(lens, z_object=z, wavelength=wavelength, criterion=FocusCriterion.RMS_SPOT)
        except InvalidValueError:
            return math.nan
        off = focus - z_image
        if not abs(off) > _EXACT * abs(z_image):
            break
        if beyond and off > SAME * abs(z_image):
            return math.nan
        aim = (image_plane(lens, z, wavelength) if beyond else aim) - off
    if not math.isfinite(off) or (beyond and abs(off) > SAME * abs(z_image)):
        return math.nan
    return -math.inf if _at_horizon(camera, z) else z


def _at_horizon(camera: PlenopticCamera, z: float) -> bool:
    """True if the images of a plane and of the horizon agree to rounding."""
    image, horizon = (image_plane(camera.lens, x, camera.wavelength) for x in (z, -math.inf))
    return abs(image - horizon) <= SAME * abs(horizon)


def plane_in_front(camera: PlenopticCamera, z_image: float) -> float:
    """The object plane of an image; nan where it does not lie in front of the lens."""
    z = object_plane(camera.lens, z_image, camera.wavelength)
    if camera.lens.model is not LensModel.NONE and _at_horizon(camera, z):
        return -math.inf
    return z if z < float(camera.lens.vertices[0]) else math.nan


def _limits(camera: PlenopticCamera, kind: CameraKind, s: float, cone: Cone) -> tuple[float, float]:
    """The depth of field (far, near), nan if there is none.

    In t = 1 / (distance before the lens), from 0 (the horizon) to inf (the lens), image positions run through all
    numbers once, in one direction. The sharp part is an arc of that circle with the plane in focus in it, and ends at
    two places.
    """
    lens, front = camera.lens, float(camera.lens.vertices[0])

    def place(z_image: float) -> float:
        z = object_plane(lens, z_image, camera.wavelength)
        return 0.0 if math.isinf(z) else over(1.0, front - z)

    ends = sharp_ends(camera, kind, s, cone)
    best = place(camera.stop_to_microlenses + s)
    if ends is None:
        return -math.inf, front
    places = [place(camera.stop_to_microlenses + end) for end in ends]
    beyond = [t for t in places if t > best]
    far = max((t for t in places if t < best), default=-math.inf)
    near = min(beyond, default=math.inf)
    if near <= 0 or (best < 0 and not beyond):
        return math.nan, math.nan
    return -math.inf if far <= 0 else front - 1.0 / far, front - 1.0 / near


def sharp_ends(camera: PlenopticCamera, kind: CameraKind, s: float, cone: Cone) -> tuple[float, float] | None:
    """Images, behind the array, at the limits of the depth of field; None where everything is sharp."""
    array, q = camera.microlenses, camera.sensor.pixel_pitch
    if array is None:
        # 2 R |s| / (D + s) = q with the exit pupil R at D, slope = R / D.
        turn, spread = q * cone.vergence, 2.0 * cone.slope
        return -over(q, spread + turn), over(q, spread - turn)
    b, width = camera.microlenses_to_sensor, opening_width(array)
    if kind is CameraKind.PLENOPTIC_1:
        reach = neighbour_distance(array) * b / q
        return -reach, reach
    if width == 0:
        return None
    blur, w = q / (width * b), 0.0 if math.isinf(s) else 1.0 / s
    return over(1.0, w - blur), over(1.0, w + blur)
