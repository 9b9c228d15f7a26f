"""Text of a report on a camera: a table of lines."""

from __future__ import annotations

import math
import textwrap
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from plenoptic.camera.report.focus import MicrolensFocus
    from plenoptic.camera.report.report import CameraReport

_LABEL = 44
_WIDTH = 110
KIND_NAMES = ("conventional camera", "plenoptic camera 1.0", "focused plenoptic camera, Keplerian",
          "focused plenoptic camera, Galilean", "camera array without main lens")  # fmt: skip


ReportRow = tuple[str, str, str, str]
"""Label, number and unit of a property, and the same in mm."""


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
    plane = "sensor" if report.microlenses is None else "array"
    lens = [
        _row("focal length", report.efl, "mm"),
        _row("f-number for infinity", report.f_number),
        _row(f"exit pupil to {plane}", report.exit_pupil_distance, "mm"),
        _row(f"working f-number at the {plane}, paraxial", report.working_f_number_paraxial),
        _row(f"working f-number at the {plane}, traced", report.working_f_number),
        _row(f"clearance from lens to {plane}", report.clearance, "mm"),
        _row("part of the iris seen from the corner", report.corner_pupil_fraction, "%"),
        _row("angle of the chief ray in the corner", math.degrees(report.corner_chief_angle), "deg"),
    ]
    sections = [("main lens", lens)]
    if report.microlenses is not None:
        sections.append(("microlens images", _image_rows(report)))
    sections += [_focus_section(report, focus) for focus in report.focus]
    return [(title, [row for row in rows if row is not None]) for title, rows in sections]


def _image_rows(report: CameraReport) -> list[ReportRow | None]:
    return [
        _row("microlens f-number", report.microlens_f_number),
        _row("f-number match (microlens / main lens)", report.f_number_match),
        _row("diameter", report.image_diameter_pixels, "pixels", report.image_diameter),
        _row("distance of neighbours", report.image_pitch_pixels, "pixels", report.image_pitch),
        _row("diameter over distance", report.image_fill),
        _row("border that fades out", report.image_border_pixels, "pixels"),
        _row("dark part of the sensor", report.dark_fraction, "%"),
        _row("part lit by several microlenses", report.overlap_fraction, "%"),
        _row("microlenses with their image on the sensor", report.microlenses),
        _row("plane imaged onto the array (v = 0): z", report.array_plane, "mm"),
    ]


def _focus_section(report: CameraReport, focus: MicrolensFocus) -> tuple[str, list[ReportRow | None]]:
    title = "focus"
    if focus.focal_length is not None:
        of_type = f"type {focus.type}, " if len(report.focus) > 1 else ""
        title = f"focus of microlenses ({of_type}f = {focus.focal_length:g} mm, {focus.kind.name})"
    views = "microlenses per view" if focus.kind == 1 else "pixels per microlens"
    return title, [
        _row("plane in focus, paraxial: z", focus.z, "mm"),
        _row("plane in focus, traced: z", focus.z_traced, "mm"),
        _row("depth of field, far: z", focus.z_far, "mm"),
        _row("depth of field, near: z", focus.z_near, "mm"),
        _row("magnification of the main lens", focus.magnification),
        _row("sampling distance in that plane", focus.object_sampling, "mm"),
        None if focus.focal_length is None else _row("image behind the array", focus.image_distance, "mm"),
        _row("virtual depth", focus.virtual_depth),
        None if focus.focal_length is None else _row("microlenses across that see a point", focus.lenses_across),
        None if focus.focal_length is None else _row("microlenses that see a point", focus.lenses_seeing),
        _row("disparity", focus.disparity, views),
        _row("disparity at the far limit", focus.disparity_far, views),
        _row("disparity at the near limit", focus.disparity_near, views),
        _row("effective resolution along an axis", focus.effective_resolution, "%"),
    ]


def _row(label: str, number: float | None, unit: str = "", millimetres: float | None = None) -> ReportRow | None:
    """Row of a report; None if the number does not apply to the camera."""
    if number is None:
        return None
    text = "none" if math.isnan(number) else f"{100.0 * number if unit == '%' else number:.6g}"
    return label, text, unit, ("" if millimetres is None else f"({millimetres:.6g} mm)")
