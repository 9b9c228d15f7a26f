"""Key numbers of a camera and HTML of its report, for notebooks."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from plenoptic.camera.gaussian import camera_cone, kind_of, plane_of_focus
from plenoptic.camera.report.report import KIND_NAMES, report_sections, report_title
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points
from plenoptic.optics.lens.models import LensModel
from plenoptic.plots.notebook.html import heading_html, list_html, table_html

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.camera.report.report import CameraReport

_Row = tuple[str, str]


def title_of(camera: PlenopticCamera) -> str:
    """Kind of a camera and the name of its lens."""
    kind = kind_of(camera, None if camera.microlenses is None else camera.microlenses.focal_length)
    return f"{KIND_NAMES[kind]}, {camera.lens.name or 'unnamed lens'}"


def key_numbers(camera: PlenopticCamera) -> Iterator[_Row]:
    """Labels and values of the rows of the table of a camera."""
    array, sensor, image_plane = camera.microlenses, camera.sensor, "sensor" if camera.microlenses is None else "array"
    if camera.lens.model is not LensModel.NONE:
        points = cardinal_points(camera.lens, camera.wavelength)
        yield "focal length", f"{points.efl:.5g} mm, f/{points.f_number:.3g} for infinity"
    yield (
        f"iris to {image_plane}",
        f"{camera.stop_to_microlenses:.6g} mm, f/{0.5 / camera_cone(camera).slope:.3g} there",
    )
    if array is not None:
        pitch = " x ".join(f"{p:g}" for p in dict.fromkeys(array.pitches))
        yield (
            "microlenses",
            f"{array.lattice.name.lower()}, pitch {pitch} mm, {array.model.name.lower().replace('_', ' ')}",
        )
        yield "their focal lengths", f"{', '.join(f'{f:g}' for f in array.focal_lengths)} mm"
        yield "array to sensor", f"{camera.microlenses_to_sensor:.5g} mm"
    height, width = sensor.size
    yield "sensor", f"{sensor.shape[0]} x {sensor.shape[1]} pixels, {height:.4g} x {width:.4g} mm"
    yield "pixel pitch", f"{1e3 * sensor.pixel_pitch:.4g} µm"
    yield "plane in focus", _focus(camera)
    sensitivity = camera.sensitivity
    yield "wavelength", f"{camera.wavelength:g} nm" + ("" if sensitivity is None else ", and those of its sensitivity")
    if camera.pose is not None:
        yield "position", f"({', '.join(f'{x + 0.0:.5g}' for x in camera.pose.position)}) mm in the world"
    displaced = [n for n in ("lens", "microlenses", "sensor") if getattr(camera, f"{n}_placement") is not None]
    if displaced:
        yield "out of place", ", ".join(displaced)


def _focus(camera: PlenopticCamera) -> str:
    """Plane in focus of each type of microlens."""
    array, planes = camera.microlenses, []
    for f in (None,) if array is None else dict.fromkeys(array.focal_lengths_at(camera.wavelength)):
        z = plane_of_focus(camera, f)
        planes.append("none" if math.isnan(z) else "at infinity" if math.isinf(z) else f"{-z:.5g} mm before the iris")
    return "; ".join(planes)


def report_html(report: CameraReport) -> str:
    """HTML of a report: findings, then all numbers."""
    parts = [heading_html(report_title(report))]
    parts.append(list_html((f"{finding.kind.name}: {finding}" for finding in report.warnings), title="warnings"))
    for title, rows in report_sections(report):
        cells = [(label, " ".join(part for part in values if part)) for label, *values in rows]
        parts.append(table_html((), cells, caption=title))
    return "".join(parts)
