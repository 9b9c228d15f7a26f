"""Findings of a report on a camera: warnings with a sentence each."""

from __future__ import annotations

import enum
import math
from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING

from plenoptic.camera.gaussian import CameraKind, neighbour_distance, opening_width
from plenoptic.camera.report.focus import MicrolensFocus
from plenoptic.core.values import choice, set_field, value
from plenoptic.errors import InvalidValueError
from plenoptic.optics.microlens.aperture import Walls

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.camera.report.report import CameraReport

FULL = 0.9
"""Microlens images narrower than this, in units of their distance, leave dark gaps worth a warning; round images that
touch leave 9 % of a hexagonal cell dark and 21 % of a square one."""
OVERLAPPING = 0.05
"""Fraction of the sensor illuminated by several microlenses that is worth a warning."""
MATCHED = 0.1
"""Relative difference of f-numbers that is worth a warning."""
FEW_PIXELS = 5.0
"""Below it, most pixels of a microlens image lie on its border."""
CLOSE = 0.1
"""Clearance behind the lens in mm below which mounts are in the way, if the camera is larger than that."""
CUT = 0.01
"""Fraction of the iris whose vignetting at the corner of the sensor is worth a warning."""


class CameraFindingKind(enum.IntEnum):
    """Subject of a finding about a camera.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.camera.CameraFindingKind.DARK_GAPS.name
    'DARK_GAPS'
    """

    DARK_GAPS = 0
    """Microlens images do not touch."""
    OVERLAP = 1
    """Neighbouring microlens images overlap: several microlenses illuminate one pixel."""
    F_NUMBER_MISMATCH = 2
    """The f-numbers of main lens and microlenses differ."""
    INSIDE_LENS = 3
    """Array or sensor stand inside the lens, rims included."""
    TOUCHES_LENS = 4
    """Array or sensor nearly touch the lens."""
    PERSPECTIVE = 5
    """Fewer microlens images fit on the sensor than microlenses."""
    FOCUS_OUT_OF_REACH = 6
    """No plane in front of the camera is in focus."""
    FOCUSED_AT_INFINITY = 7
    """Microlenses of a focused camera are in focus at infinity to within a pixel: nearly a plenoptic 1.0."""
    FEW_VIEWS = 8
    """A point is imaged by fewer than two microlenses across: no depth from neighbours."""
    FEW_PIXELS = 9
    """A microlens image has few pixels across."""
    CUT_OFF_IMAGES = 10
    """Rims cut off microlens images at the corner of the sensor."""
    OUT_OF_PLACE = 12
    """Parts are displaced from the design, to which the report refers."""
    DEPTH_GAP = 11
    """Between the depths of field of the types of microlenses lies a range that is sharp for none."""


@value
class CameraFinding:
    """Warning about a property of a camera; made by `camera_report`. Printed as its message.

    Parameters
    ----------
    kind : CameraFindingKind
    message : str
        A sentence with the numbers and the remedy.

    Examples
    --------
    >>> import plenoptic as pl
    >>> print(pl.camera.CameraFinding(pl.camera.CameraFindingKind.DARK_GAPS, "microlens images do not touch"))
    microlens images do not touch
    """

    kind: CameraFindingKind
    message: str

    def __post_init__(self) -> None:
        set_field(self, "kind", choice(self.kind, CameraFindingKind, "kind"))
        if not isinstance(self.message, str):
            raise InvalidValueError(f"message is {self.message!r}; it must be a text")

    def __str__(self) -> str:
        return self.message


def camera_findings(camera: PlenopticCamera, report: CameraReport) -> tuple[CameraFinding, ...]:
    """Findings of a report, in the order of their kinds."""
    findings = [*_lens_findings(camera, report), *_focus_findings(report), *_placement_findings(camera)]
    if camera.microlenses is not None:
        findings += [*_image_findings(camera, report), *_type_findings(camera, report)]
    return tuple(sorted(findings, key=lambda finding: finding.kind))


def _placement_findings(camera: PlenopticCamera) -> Iterator[CameraFinding]:
    placements = (camera.lens_placement, camera.microlenses_placement, camera.sensor_placement)
    if any(placement is not None for placement in placements):
        yield CameraFinding(
            CameraFindingKind.OUT_OF_PLACE,
            "parts are displaced from the design, to which this report refers; see pl.camera.as_built(camera)",
        )


def _lens_findings(camera: PlenopticCamera, report: CameraReport) -> Iterator[CameraFinding]:
    part = "sensor" if camera.microlenses is None else "microlens array"
    gap = report.clearance
    if gap < 0:
        yield CameraFinding(
            CameraFindingKind.INSIDE_LENS,
            f"the {part} is {-gap:.3g} mm inside the rim of the last surface; increase stop_to_microlenses by more",
        )
    elif gap < min(CLOSE, CLOSE * camera.stop_to_microlenses):
        yield CameraFinding(
            CameraFindingKind.TOUCHES_LENS,
            f"the {part} is {gap:.3g} mm behind the lens, where mounts need room; increase stop_to_microlenses",
        )
    if report.corner_pupil_fraction < 1.0 - CUT:
        yield CameraFinding(
            CameraFindingKind.CUT_OFF_IMAGES,
            f"at the corner of the sensor {100 * (1 - report.corner_pupil_fraction):.0f} % of the iris is cut off by "
            "rims and other stops; stop down, or use a smaller sensor",
        )


def _image_findings(camera: PlenopticCamera, report: CameraReport) -> Iterator[CameraFinding]:
    fill, match, pixels = report.image_fill, report.f_number_match, report.image_pitch_pixels
    assert fill is not None and match is not None and pixels is not None
    assert report.dark_fraction is not None and report.overlap_fraction is not None
    matching = camera.lens.stop.semi_diameter / fill
    if fill < FULL:
        yield CameraFinding(
            CameraFindingKind.DARK_GAPS,
            f"microlens images are {fill:.2f} as wide as their distance and leave {100 * report.dark_fraction:.0f} % "
            f"of the sensor dark; open the iris to {matching:.4g} mm for images that touch",
        )
    walls = camera.microlenses is not None and camera.microlenses.walls is Walls.OPAQUE
    if not walls and (fill > 1.0 + OVERLAPPING or report.overlap_fraction > OVERLAPPING):
        yield CameraFinding(
            CameraFindingKind.OVERLAP,
            f"{100 * report.overlap_fraction:.0f} % of the sensor gets light through several microlenses (images are "
            f"{fill:.2f} as wide as their distance, with a border of {report.image_border_pixels:.1f} pixels); stop "
            "down to avoid it",
        )
    if not walls and abs(match - 1.0) > MATCHED:
        yield CameraFinding(
            CameraFindingKind.F_NUMBER_MISMATCH,
            f"at the array the main lens works at f/{report.working_f_number:.3g} and the microlenses at "
            f"f/{report.microlens_f_number:.3g}; an iris of semi-diameter {matching:.4g} mm matches them",
        )
    longer, p = max(camera.sensor.size), neighbour_distance(camera.microlenses)  # type: ignore[arg-type]
    lost_images = longer / p - longer / (pixels * camera.sensor.pixel_pitch)
    if abs(lost_images) >= 1.0:
        yield CameraFinding(
            CameraFindingKind.PERSPECTIVE,
            f"microlens images repeat every {pixels:.4g} pixels and microlenses every "
            f"{p / camera.sensor.pixel_pitch:.4g}, so that the longer side of the sensor holds {abs(lost_images):.1f} "
            f"{'fewer' if lost_images > 0 else 'more'} images than microlenses; take the distance of the images for "
            "decoding",
        )
    if pixels < FEW_PIXELS:
        yield CameraFinding(
            CameraFindingKind.FEW_PIXELS,
            f"a microlens image has {pixels:.2g} pixels across; use smaller pixels or a larger pitch for at least "
            f"{FEW_PIXELS:g}",
        )


def _of_type(report: CameraReport, focus: MicrolensFocus) -> str:
    return f" through microlenses of type {focus.type}" if len(report.focus) > 1 else ""


def _focus_findings(report: CameraReport) -> Iterator[CameraFinding]:
    for focus in report.focus:
        if math.isnan(focus.z_far) and math.isnan(focus.z_traced):
            yield CameraFinding(CameraFindingKind.FOCUS_OUT_OF_REACH, _out_of_reach(report, focus))
        if focus.kind in (CameraKind.KEPLERIAN, CameraKind.GALILEAN) and focus.lenses_across < 2.0:
            yield CameraFinding(
                CameraFindingKind.FEW_VIEWS,
                f"a point in focus{_of_type(report, focus)} is seen by {focus.lenses_across:.2f} microlenses across "
                f"(virtual depth {focus.virtual_depth:.2f}), and depth needs two; bring microlenses_to_sensor nearer "
                "to their focal length or open the iris",
            )


def _out_of_reach(report: CameraReport, focus: MicrolensFocus) -> str:
    where = f"{abs(focus.image_distance):.4g} mm {'behind' if focus.image_distance >= 0 else 'before'} the array"
    through = f"nothing in front of the camera is in focus{_of_type(report, focus)}: "
    if focus.kind is CameraKind.CAMERA_ARRAY:
        nearer = f"bring microlenses_to_sensor nearer to, but above, {focus.focal_length:g}"
        return f"{through}they look at a plane {where}; {nearer}"
    if focus.kind is CameraKind.CONVENTIONAL:
        return f"{through}no plane has its image on the sensor; move the back with focused_at"
    return f"{through}the main lens would have to form its image {where}; move the back with focused_at"


def _type_findings(camera: PlenopticCamera, report: CameraReport) -> Iterator[CameraFinding]:
    array = camera.microlenses
    assert array is not None
    blur = opening_width(array) * camera.microlenses_to_sensor / camera.sensor.pixel_pitch
    for focus in report.focus:
        focused = focus.kind in (CameraKind.KEPLERIAN, CameraKind.GALILEAN)
        if focused and blur < abs(focus.image_distance):
            yield CameraFinding(
                CameraFindingKind.FOCUSED_AT_INFINITY,
                f"microlenses of focal length {focus.focal_length:g} mm at {camera.microlenses_to_sensor:g} mm are "
                f"sharp to a pixel at infinity too, so that the camera is nearly a plenoptic 1.0; for that, set "
                f"microlenses_to_sensor to {focus.focal_length:g}",
            )
    ranges = sorted((f.z_far, f.z_near) for f in report.focus if not math.isnan(f.z_far))
    nearest_limit = -math.inf
    for (_, near), (far, later) in pairwise(ranges):
        nearest_limit = max(nearest_limit, near)
        if nearest_limit < far < later:
            yield CameraFinding(
                CameraFindingKind.DEPTH_GAP,
                f"from z = {nearest_limit:.5g} to {far:.5g} mm no type of microlens is sharp; choose focal lengths "
                "nearer to each other or stop down the microlenses",
            )
