"""Report on a camera: f-numbers, micro images, focus, depth, disparity, and warnings.

The main lens is described by Gaussian optics and by traced rays, the microlenses by their focal lengths, all on the
axis and as designed.
"""

from __future__ import annotations

import dataclasses
import math
import textwrap
from typing import TYPE_CHECKING, Any

from plenoptic.camera.gaussian import CameraKind, Cone, camera_cone, neighbour_distance, plane_in_front
from plenoptic.camera.report import illumination
from plenoptic.camera.report.findings import CameraFinding, camera_findings
from plenoptic.camera.report.focus import MicrolensFocus, microlens_focus, report_row
from plenoptic.core.display import picture_of
from plenoptic.core.values import check_has, value
from plenoptic.optics.glass.media import AIR
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.microlens.aperture import Walls
from plenoptic.optics.microlens.plate_losses import axial_transmission

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera

_LABEL = 44
_WIDTH = 110
KIND_NAMES = ("conventional camera", "plenoptic camera 1.0", "focused plenoptic camera, Keplerian",
          "focused plenoptic camera, Galilean", "camera array without main lens")  # fmt: skip
_LENS, _IMAGES = "main lens", "micro images"
"""Sections of a report."""
ReportRow = tuple[str, str, str, str]
"""Label, number and unit of a property, and the same in mm."""


@value
class CameraReport:
    """First-order properties of a camera; printed as a table. See `camera_report`, which makes it.

    Properties of parts that a camera lacks are None. Pixels are the sensor's.

    Attributes
    ----------
    kind : CameraKind
        Kind of the camera through the microlens on the axis.
    efl : float or None
        Focal length of the main lens in mm.
    f_number : float or None
        f-number of the main lens for an object at infinity.
    exit_pupil_distance : float
        Distance from the exit pupil (camera array: the iris) to the array, or to the sensor without microlenses, in mm;
        inf for a telecentric lens.
    working_f_number_paraxial, working_f_number : float
        Working f-number of the main lens at the array: distance over diameter of the exit pupil, 1 / (2 tan u), by
        Gaussian optics and by rays traced from the centre of the array to the rim of the iris. Polygonal stops count as
        the circles around them.
    microlens_f_number : float or None
        Distance from array to sensor over that of neighbouring microlenses.
    f_number_match : float or None
        Microlens f-number over the working f-number: diameter of the micro images over the pitch.
    image_diameter, image_diameter_pixels : float or None
        Diameter of the image of the exit pupil through the centre of a microlens, traced, in mm and pixels.
    image_pitch, image_pitch_pixels : float or None
        Distance of neighbouring micro images: pitch (1 + b / D), with b from array to sensor and D from exit pupil
        to array.
    image_fill : float or None
        Diameter over pitch of the micro images: 1 for round images that touch.
    image_border_pixels : float or None
        Width of the blurred border of a micro image, since the exit pupil is not in focus on the sensor; of the
        type with the widest border.
    dark_fraction, overlap_fraction : float or None
        Fractions of the area around the axis that no microlens illuminates, and that several illuminate.
    microlenses : int or None
        Number of microlenses that have the centre of their image on the sensor.
    array_plane : float or None
        z in mm of the plane that the main lens images onto the array, by Gaussian optics; nan if none lies in front of
        the lens. Virtual depth is 0 in this plane, and the disparity of focused cameras unbounded.
    focus : tuple of MicrolensFocus
        Focus of each type of microlens.
    clearance : float
        Distance along z from the lens, rims included, to array or sensor, in mm; negative inside the lens.
    corner_pupil_fraction : float
        Fraction of the iris from which light reaches the corner of the sensor, traced.
    corner_chief_angle : float
        Angle between the chief ray of that corner and the axis, in radians.
    front_field : float or None
        Angle between the chief rays of opposite corners of the sensor in the front medium of a lens that is not in air,
        in radians; nan if they are vignetted.
    viewpoint_caustic : float or None
        Distance along the axis from the point where chief rays near the axis come together, in that medium, to that of
        the corners, in mm: a plane port has no single viewpoint.
    transmission : float or None
        Fraction of the unvignetted light to the centre of the array, or of the sensor, that a lens with coatings
        transmits; None without coatings.
    microlens_transmission : float or None
        Fraction of the light along the axis that both sides and the glass of microlenses with a coating transmit; None
        without one.
    wavelength : float
        nm.
    warnings : tuple of CameraFinding
        Warnings.
    """

    _: dataclasses.KW_ONLY
    kind: CameraKind
    efl: float | None = report_row("focal length", "mm", _LENS)
    f_number: float | None = report_row("f-number for infinity", "", _LENS)
    exit_pupil_distance: float = report_row("exit pupil to {plane}", "mm", _LENS)
    working_f_number_paraxial: float = report_row("working f-number at the {plane}, paraxial", "", _LENS)
    working_f_number: float = report_row("working f-number at the {plane}, traced", "", _LENS)
    microlens_f_number: float | None = report_row("microlens f-number", "", _IMAGES)
    f_number_match: float | None = report_row("f-number match (microlens / main lens)", "", _IMAGES)
    image_diameter: float | None
    image_diameter_pixels: float | None = report_row("diameter", "pixels", _IMAGES)
    image_pitch: float | None
    image_pitch_pixels: float | None = report_row("distance of neighbours", "pixels", _IMAGES)
    image_fill: float | None = report_row("diameter over distance", "", _IMAGES)
    image_border_pixels: float | None = report_row("border that fades out", "pixels", _IMAGES)
    dark_fraction: float | None = report_row("dark part of the sensor", "%", _IMAGES)
    overlap_fraction: float | None = report_row("part lit by several microlenses", "%", _IMAGES)
    microlenses: int | None = report_row("microlenses with their image on the sensor", "", _IMAGES)
    microlens_transmission: float | None = report_row("light that microlenses transmit, on axis", "%", _IMAGES)
    array_plane: float | None = report_row("plane imaged onto the array (v = 0): z", "mm", _IMAGES)
    focus: tuple[MicrolensFocus, ...]
    clearance: float = report_row("clearance from lens to {plane}", "mm", _LENS)
    corner_pupil_fraction: float = report_row("part of the iris seen from the corner", "%", _LENS)
    corner_chief_angle: float = report_row("angle of the chief ray in the corner", "deg", _LENS)
    front_field: float | None = report_row("field in the front medium, corner to corner", "deg", _LENS)
    viewpoint_caustic: float | None = report_row("viewpoints there, from axis to corner", "mm", _LENS)
    transmission: float | None = report_row("light that surfaces and glasses transmit", "%", _LENS)
    wavelength: float
    warnings: tuple[CameraFinding, ...] = ()

    def __repr__(self) -> str:
        return report_text(self)

    _repr_html_ = picture_of


def camera_report(camera: PlenopticCamera) -> CameraReport:
    """Compute the first-order properties of a camera, and warnings of common pitfalls.

    Parameters
    ----------
    camera : PlenopticCamera
        With any model of its lens and microlenses. Placements of its parts are ignored: the report refers to the
        design. Microlenses between walls are separate cameras; the working f-number is then that of the field limited
        by the walls.

    Returns
    -------
    CameraReport
        For definitions see `CameraReport` and `MicrolensFocus`.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.camera.example_camera()
    >>> report = pl.camera.camera_report(camera)
    >>> print(f"{report.kind.name}: images every {report.image_pitch_pixels:.3f} pixels, fill {report.image_fill:.2f}")
    GALILEAN: images every 21.987 pixels, fill 0.94
    >>> focus = report.focus[0]
    >>> print(f"z = {focus.z:.1f} mm, virtual depth {focus.virtual_depth:.2f}, disparity {focus.disparity:.3f} pixels")
    z = -403.9 mm, virtual depth 6.67, disparity 3.255 pixels
    >>> [finding.kind.name for finding in report.warnings]
    ['OVERLAP']
    """
    check_has(camera, "camera", "PlenopticCamera", "pl.PlenopticCamera(...)", "lens", "sensor")
    lens, array, wavelength = camera.lens, camera.microlenses, camera.wavelength
    z = camera.stop_to_microlenses
    cone, walls = camera_cone(camera), array is not None and array.walls is Walls.OPAQUE
    slope = cone.slope if walls else illumination.clear_pupil(lens, z, wavelength)[0]
    traced = cone if math.isnan(slope) else cone._replace(slope=slope)
    stretch = 1.0 if array is None else 1.0 + camera.microlenses_to_sensor * cone.vergence
    corner = (camera.sensor.size[1] / (2 * stretch), camera.sensor.size[0] / (2 * stretch))
    pupil_fraction, chief_angle = (1.0, 0.0) if walls else illumination.corner_light(lens, corner, z, wavelength)
    points = None if lens.model is LensModel.NONE else cardinal_points(lens, wavelength)
    immersed = points is not None and not walls and lens.front_medium != AIR
    field, caustic = illumination.front_view(lens, corner, z, wavelength) if immersed else (None, None)
    types = (0,) if array is None else range(len(array.focal_lengths))
    focus = tuple(microlens_focus(camera, type_, traced) for type_ in types)
    on_axis = 0 if array is None else array.focal_lengths.index(array.focal_length)
    report = CameraReport(
        kind=focus[on_axis].kind,
        efl=None if points is None else points.efl,
        f_number=None if points is None else points.f_number,
        exit_pupil_distance=math.inf if cone.vergence == 0 else 1.0 / cone.vergence,
        working_f_number_paraxial=0.5 / cone.slope,
        working_f_number=0.5 / slope,
        **_image_numbers(camera, traced, slope),
        array_plane=None if array is None or points is None else plane_in_front(camera, z),
        focus=focus,
        clearance=illumination.clearance(camera),
        corner_pupil_fraction=pupil_fraction,
        corner_chief_angle=chief_angle,
        front_field=field,
        viewpoint_caustic=caustic,
        transmission=illumination.transmission_on_axis(lens, z, wavelength),
        microlens_transmission=None if array is None else axial_transmission(array, wavelength, lens.rear_medium),
        wavelength=wavelength,
    )
    return dataclasses.replace(report, warnings=camera_findings(camera, report))


_IMAGE_NUMBERS = ("microlens_f_number", "f_number_match", "image_diameter", "image_diameter_pixels", "image_pitch",
           "image_pitch_pixels", "image_fill", "image_border_pixels", "dark_fraction", "overlap_fraction",
           "microlenses")  # fmt: skip


def _image_numbers(camera: PlenopticCamera, cone: Cone, slope: float) -> dict[str, Any]:
    array, b, q = camera.microlenses, camera.microlenses_to_sensor, camera.sensor.pixel_pitch
    if array is None:
        return dict.fromkeys(_IMAGE_NUMBERS)
    p, stretch = neighbour_distance(array), 1.0 + b * cone.vergence
    diameter, pitch = 2.0 * b * slope, p * abs(stretch)
    border = illumination.image_border(camera, cone.vergence)
    dark, overlap = illumination.coverage(camera, cone)
    if array.walls is Walls.OPAQUE:
        dark = overlap = 0.0
    numbers = (b / p, diameter / p, diameter, diameter / q, pitch, pitch / q, diameter / pitch, border / q)
    return dict(
        zip(
            _IMAGE_NUMBERS, (*numbers, dark, overlap, illumination.images_on_sensor(camera, cone.vergence)), strict=True
        )
    )


def report_text(report: CameraReport) -> str:
    """Text of a report: all numbers with their units, one per line, then the findings."""
    lines = [report_title(report)]
    for title, rows in report_sections(report):
        lines.append(title)
        lines += [
            f"  {label:<{_LABEL}} {number:>12} {unit}".rstrip() + (f" {also}" if also else "")
            for label, number, unit, also in rows
        ]
    lines.append("warnings" if report.warnings else "no warnings")
    for finding in report.warnings:
        lines += textwrap.wrap(f"{finding.kind.name}: {finding}", _WIDTH, initial_indent="  ", subsequent_indent="    ")
    return "\n".join(lines)


def report_title(report: CameraReport) -> str:
    """Title of a report: kind and wavelength of the camera."""
    return f"CameraReport: {KIND_NAMES[report.kind]}, at {report.wavelength:g} nm"


def report_sections(report: CameraReport) -> list[tuple[str, list[ReportRow]]]:
    """Titles and rows of the sections of a report, with all numbers that apply to the camera."""
    titles = (_LENS,) if report.microlenses is None else (_LENS, _IMAGES)
    sections = [(title, _rows(report, title, plane="sensor" if len(titles) == 1 else "array")) for title in titles]
    hidden = ("image_distance", "lenses_across", "lenses_seeing")
    for focus in report.focus:
        if focus.focal_length is None:
            sections.append(("focus", _rows(focus, hidden=hidden)))
        else:
            of_type = f"type {focus.type}, " if len(report.focus) > 1 else ""
            title = f"focus of microlenses ({of_type}f = {focus.focal_length:g} mm, {focus.kind.name})"
            if focus.kind is CameraKind.PLENOPTIC_1:  # images stand on the array: no neighbour sees the point
                rows = _rows(focus, hidden=("virtual_depth", *hidden), views="microlenses per view")
            else:
                rows = _rows(focus, views="pixels per microlens")
            sections.append((title, rows))
    return sections


def _rows(
    part: CameraReport | MicrolensFocus, section: str = "", *, hidden: tuple[str, ...] = (), **words: str
) -> list[ReportRow]:
    """Rows of a section, from fields made by `report_row` that are not None; `words` stand in labels and units."""
    rows = []
    for field in dataclasses.fields(part):
        number, unit = getattr(part, field.name), field.metadata.get("unit", "")
        if number is None or field.name in hidden or field.metadata.get("section") != section:
            continue
        converted = 100.0 * number if unit == "%" else math.degrees(number) if unit == "deg" else number
        text = "none" if math.isnan(number) else f"{converted:.6g}"
        length = getattr(part, field.name.removesuffix("_pixels"), None) if unit == "pixels" else None
        also = "" if length is None else f"({length:.6g} mm)"
        rows.append((field.metadata["label"].format(**words), text, unit.format(**words), also))
    return rows
