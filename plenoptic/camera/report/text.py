"""A report on a camera as a table of lines."""

from __future__ import annotations

import math
import textwrap
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from plenoptic.camera.report.focus import MicrolensFocus
    from plenoptic.camera.report.report import CameraReport

_LABEL = 44
_WIDTH = 110
_NAMES = ("conventional camera", "plenoptic camera 1.0", "focused plenoptic camera, Keplerian",
          "focused plenoptic camera, Galilean", "camera array without main lens")  # fmt: skip


def report_text(report: CameraReport) -> str:
    """All numbers with their units, a line each, and the findings."""
    lines = [f"CameraReport: {_NAMES[report.kind]}, at {report.wavelength:g} nm", "main lens"]
    place = "sensor" if report.microlenses is None else "array"
    lines += [
        _line("focal length", report.efl, "mm"),
        _line("f-number for infinity", report.f_number),
        _line(f"exit pupil to {place}", report.exit_pupil_distance, "mm"),
        _line(f"working f-number at the {place}, paraxial", report.working_f_number_paraxial),
        _line(f"working f-number at the {place}, traced", report.working_f_number),
        _line(f"clearance from lens to {place}", report.clearance, "mm"),
        _line("part of the iris seen from the corner", report.corner_pupil_fraction, "%"),
        _line("angle of the chief ray in the corner", math.degrees(report.corner_chief_angle), "deg"),
    ]
    if report.microlenses is not None:
        lines += _image_lines(report)
    for focus in report.focus:
        lines += _focus_lines(report, focus)
    lines.append("warnings" if report.warnings else "no warnings")
    for finding in report.warnings:
        lines += textwrap.wrap(f"{finding.kind.name}: {finding}", _WIDTH, initial_indent="  ", subsequent_indent="    ")
    return "\n".join(line for line in lines if line)


def _image_lines(report: CameraReport) -> list[str]:
    return [
        "microlens images",
        _line("microlens f-number", report.microlens_f_number),
        _line("f-number match (microlens / main lens)", report.f_number_match),
        _line("diameter", report.image_diameter_pixels, "pixels", report.image_diameter),
        _line("distance of neighbours", report.image_pitch_pixels, "pixels", report.image_pitch),
        _line("diameter over distance", report.image_fill),
        _line("border that fades out", report.image_border_pixels, "pixels"),
        _line("dark part of the sensor", report.dark_fraction, "%"),
        _line("part lit by several microlenses", report.overlap_fraction, "%"),
        _line("microlenses with their image on the sensor", report.microlenses),
        _line("plane imaged onto the array (v = 0): z", report.array_plane, "mm"),
    ]


def _focus_lines(report: CameraReport, focus: MicrolensFocus) -> list[str]:
    title = "focus"
    if focus.focal_length is not None:
        of_type = f"type {focus.type}, " if len(report.focus) > 1 else ""
        title = f"focus of microlenses ({of_type}f = {focus.focal_length:g} mm, {focus.kind.name})"
    views = "microlenses per view" if focus.kind == 1 else "pixels per microlens"
    return [
        title,
        _line("plane in focus, paraxial: z", focus.z, "mm"),
        _line("plane in focus, traced: z", focus.z_traced, "mm"),
        _line("depth of field, far: z", focus.z_far, "mm"),
        _line("depth of field, near: z", focus.z_near, "mm"),
        _line("magnification of the main lens", focus.magnification),
        _line("sampling distance in that plane", focus.object_sampling, "mm"),
        "" if focus.focal_length is None else _line("image behind the array", focus.image_distance, "mm"),
        _line("virtual depth", focus.virtual_depth),
        "" if focus.focal_length is None else _line("microlenses across that see a point", focus.lenses_across),
        "" if focus.focal_length is None else _line("microlenses that see a point", focus.lenses_seeing),
        _line("disparity", focus.disparity, views),
        _line("disparity at the far limit", focus.disparity_far, views),
        _line("disparity at the near limit", focus.disparity_near, views),
        _line("effective resolution along an axis", focus.effective_resolution, "%"),
    ]


def _line(label: str, number: float | None, unit: str = "", millimetres: float | None = None) -> str:
    """One line; none for what the camera lacks."""
    if number is None:
        return ""
    shown = "none" if math.isnan(number) else f"{100.0 * number if unit == '%' else number:.6g}"
    also = "" if millimetres is None else f" ({millimetres:.6g} mm)"
    return f"  {label:<{_LABEL}} {shown:>12} {unit}".rstrip() + also
