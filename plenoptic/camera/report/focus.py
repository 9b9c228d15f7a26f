"""Focus of the microlenses of one type: planes, depth of field, virtual depth, disparity, resolution."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Any

from plenoptic.camera import gaussian
from plenoptic.camera.gaussian import CameraKind, Cone
from plenoptic.core.values import value
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.analysis.best_focus import best_focus
from plenoptic.optics.lens.gaussian.matrices import over
from plenoptic.optics.lens.models import FocusCriterion, LensModel

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera

_STEPS = 8
"""Most corrections of the traced focus; each reduces the error ten to a thousand times."""
_TOLERANCE = 1e-10
"""Relative error of the traced image position at which the search ends."""


def report_row(label: str, unit: str = "", section: str = "") -> Any:
    """Dataclass field that is a row of a section of the printed report.

    {plane} stands for the array, or the sensor without one; {views} for the unit of disparity.
    """
    return dataclasses.field(metadata={"section": section, "label": label, "unit": unit})


@value
class MicrolensFocus:
    """Focus of the microlenses of one type, as part of a report. See `camera_report`.

    With s the distance behind the array at which the main lens forms an image (negative in front of it), b the distance
    from array to sensor, f the focal length and d the opening of a microlens, p their pitch and q that of the pixels:

    - in focus: 1/s = 1/b - 1/f, and s = 0 for a plenoptic 1.0;
    - virtual depth v = ``|s| / b``;
    - depth of field: the blur on the sensor, ``d b |1/s - 1/b + 1/f|``, is at most q. In a plenoptic 1.0 a point moves
      between the views of neighbouring pixels by at most one microlens: ``|s| <= p b / q``. Without microlenses the
      blur by the exit pupil is at most q;
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
        Plane in focus by Gaussian optics in the camera's frame, mm; -inf at infinity, nan if there is none in front of
        the lens.
    z_traced : float
        Plane in focus by exact rays that fill the iris (least RMS spot in the main lens's image), mm.
    z_far, z_near : float
        Limits of the depth of field by Gaussian optics, mm; nan if there is none.
    magnification : float
        Magnification of the main lens for the plane in focus; nan without such a plane, 1 without a main lens.
    object_sampling : float
        Distance in the plane in focus between the images of neighbouring pixels (plenoptic 1.0: microlenses), mm.
    lenses_across, lenses_seeing : float
        Diameter on the array of the light of a point in focus over the pitch, and the mean number of microlenses that
        it covers, at least 1; nan without microlenses.
    disparity : float or None
        Disparity of the plane in focus.
    disparity_far, disparity_near : float or None
        Disparity at the limits of the depth of field.
    effective_resolution : float or None
        Resolution in focus as a fraction of the sensor's pixels along each axis; None for a camera array.

    References
    ----------
    C. Perwass and L. Wietzke, Single lens 3D-camera with extended depth-of-field, Proc. SPIE 8291, 2012
    (doi 10.1117/12.909882): virtual depth, effective resolution. T. Georgiev and A. Lumsdaine, Focused plenoptic camera
    and rendering, J. Electronic Imaging 19, 2010 (doi 10.1117/1.3442712). R. Ng et al., Light field photography with a
    hand-held plenoptic camera, Stanford CTSR 2005-02.
    """

    _: dataclasses.KW_ONLY
    type: int
    kind: CameraKind
    focal_length: float | None
    z: float = report_row("plane in focus, paraxial: z", "mm")
    z_traced: float = report_row("plane in focus, traced: z", "mm")
    z_far: float = report_row("depth of field, far: z", "mm")
    z_near: float = report_row("depth of field, near: z", "mm")
    magnification: float = report_row("magnification of the main lens")
    object_sampling: float = report_row("sampling distance in that plane", "mm")
    image_distance: float = report_row("image behind the array", "mm")
    virtual_depth: float | None = report_row("virtual depth")
    lenses_across: float = report_row("microlenses across that see a point")
    lenses_seeing: float = report_row("microlenses that see a point")
    disparity: float | None = report_row("disparity", "{views}")
    disparity_far: float | None = report_row("disparity at the far limit", "{views}")
    disparity_near: float | None = report_row("disparity at the near limit", "{views}")
    effective_resolution: float | None = report_row("effective resolution along an axis", "%")


def microlens_focus(camera: PlenopticCamera, type_: int, cone: Cone) -> MicrolensFocus:
    """Compute the focus of one type of microlens."""
    array, q = camera.microlenses, camera.sensor.pixel_pitch
    f = None if array is None else array.focal_lengths_at(camera.wavelength)[type_]
    kind, s = gaussian.kind_of(camera, f), gaussian.sharp_image(camera, f)
    z_image = camera.stop_to_microlenses + s
    z, (far, near) = gaussian.plane_in_front(camera, z_image), _depth_of_field(camera, kind, s, cone)
    m = gaussian.lateral_magnification(camera.lens, z, camera.wavelength) if not math.isnan(z) else math.nan
    relay_magnification, across, covered, resolution = 1.0, math.nan, math.nan, 1.0
    pixel, v = q, None
    disparities: list[float | None] = [None] * 3
    if array is not None:
        b, p = camera.microlenses_to_sensor, gaussian.neighbour_distance(array)
        width = footprint(cone, s)
        across, covered = width / p, max(1.0, math.pi / 4 * width**2 / gaussian.cell_area(array))
        images = [
            gaussian.image_plane(camera.lens, x, camera.wavelength) - camera.stop_to_microlenses for x in (far, near)
        ]
        v = abs(s) / b
        if kind is CameraKind.PLENOPTIC_1:
            resolution = min(1.0, q / math.sqrt(gaussian.cell_area(array)) / abs(1.0 + b * cone.vergence))
            pixel, disparities = p, [x * q / (b * p) for x in (s, *images)]
        else:
            disparities = [over(p * b / q, abs(x)) for x in (s, *images)]
            resolution, relay_magnification = 1.0 / max(v, 1.0), 1.0 / v
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
        object_sampling=over(pixel, abs(m) * relay_magnification),
        lenses_across=across,
        lenses_seeing=covered,
        disparity=disparities[0],
        disparity_far=disparities[1],
        disparity_near=disparities[2],
        effective_resolution=None if kind is CameraKind.CAMERA_ARRAY else resolution,
    )


def footprint(cone: Cone, s: float) -> float:
    """Diameter on the array, in mm, of the light through the whole exit pupil that converges at s behind the array."""
    if math.isinf(s):
        return over(2.0 * cone.slope, abs(cone.vergence))
    return over(2.0 * cone.slope * abs(s), abs(1.0 + s * cone.vergence))


def traced_plane(camera: PlenopticCamera, z_image: float) -> float:
    """Plane in front of the lens whose image by exact rays is sharpest at z_image; nan if there is none.

    Newton's method with the longitudinal magnification of Gaussian optics, which is exact for ideal lenses.
    """
    lens, wavelength = camera.lens, camera.wavelength
    if lens.model is not LensModel.EXACT:
        return gaussian.plane_in_front(camera, z_image)
    z_target, front = z_image, float(lens.vertices[0])
    for _ in range(_STEPS):
        z = gaussian.object_plane(lens, z_target, wavelength)
        is_beyond = not z < front
        if is_beyond:
            z = -math.inf
        try:
            z_best = best_focus(lens, z_object=z, wavelength=wavelength, criterion=FocusCriterion.RMS_SPOT)
        except InvalidValueError:
            return math.nan
        error = z_best - z_image
        if not abs(error) > _TOLERANCE * abs(z_image):
            break
        if is_beyond and error > gaussian.SAME_FOCUS * abs(z_image):
            return math.nan
        z_target = (gaussian.image_plane(lens, z, wavelength) if is_beyond else z_target) - error
    if not math.isfinite(error) or (is_beyond and abs(error) > gaussian.SAME_FOCUS * abs(z_image)):
        return math.nan
    return -math.inf if gaussian.is_at_horizon(camera, z) else z


def _depth_of_field(camera: PlenopticCamera, kind: CameraKind, s: float, cone: Cone) -> tuple[float, float]:
    """Depth of field (far, near) in mm, nan if there is none.

    As t = 1 / (distance before the lens) runs from 0 (infinity) to inf (the lens), image positions run through all
    numbers once, in one direction: a projective line, or circle. The depth of field is an arc of that circle around the
    plane in focus, with two limits.
    """
    lens, front = camera.lens, float(camera.lens.vertices[0])

    def inverse_distance(z_image: float) -> float:
        z = gaussian.object_plane(lens, z_image, camera.wavelength)
        return 0.0 if math.isinf(z) else over(1.0, front - z)

    limits = focus_limits(camera, kind, s, cone)
    in_focus = inverse_distance(camera.stop_to_microlenses + s)
    if limits is None:
        return -math.inf, front
    inverse_distances = [inverse_distance(camera.stop_to_microlenses + end) for end in limits]
    nearer = [t for t in inverse_distances if t > in_focus]
    far = max((t for t in inverse_distances if t < in_focus), default=-math.inf)
    near = min(nearer, default=math.inf)
    if near <= 0 or (in_focus < 0 and not nearer):
        return math.nan, math.nan
    return -math.inf if far <= 0 else front - 1.0 / far, front - 1.0 / near


def focus_limits(camera: PlenopticCamera, kind: CameraKind, s: float, cone: Cone) -> tuple[float, float] | None:
    """Image distances behind the array at the limits of the depth of field; None if everything is in focus."""
    array, q = camera.microlenses, camera.sensor.pixel_pitch
    if array is None:
        # 2 R |s| / (D + s) = q with the exit pupil R at D, slope = R / D.
        pupil_term, full_slope = q * cone.vergence, 2.0 * cone.slope
        return -over(q, full_slope + pupil_term), over(q, full_slope - pupil_term)
    b, width = camera.microlenses_to_sensor, gaussian.opening_width(array)
    if kind is CameraKind.PLENOPTIC_1:
        half_depth = gaussian.neighbour_distance(array) * b / q
        return -half_depth, half_depth
    if width == 0:
        return None
    blur, w = q / (width * b), 0.0 if math.isinf(s) else 1.0 / s
    return over(1.0, w - blur), over(1.0, w + blur)
