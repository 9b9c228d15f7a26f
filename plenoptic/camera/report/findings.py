"""Findings of a report on a camera: warnings with a sentence each."""

from __future__ import annotations

import enum
import math
import operator
from itertools import accumulate
from typing import TYPE_CHECKING

from plenoptic.camera.checks import implausible_values
from plenoptic.camera.gaussian import CameraKind, neighbour_distance, opening_width
from plenoptic.camera.report.illumination import clear_pupil, touching_fill, with_semi_diameter
from plenoptic.core.values import choice, set_field, value
from plenoptic.errors import InvalidValueError
from plenoptic.optics.microlens.aperture import Walls

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.camera.report.focus import MicrolensFocus
    from plenoptic.camera.report.report import CameraReport

FULL = 0.9
"""Micro images narrower than this with their border, in units of their distance, leave dark gaps worth a warning;
round images that touch leave 9 % of a hexagonal cell dark and 21 % of a square one."""
OVERLAPPING = 0.05
"""Fraction of the sensor illuminated by several microlenses that is worth a warning."""
MATCHED = 0.1
"""Relative difference of f-numbers, beyond that of images that touch with their border, that is worth a warning."""
FEW_PIXELS = 5.0
"""Below it, most pixels of a micro image lie on its border."""
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
    """Micro images do not touch."""
    OVERLAP = 1
    """Neighbouring micro images overlap: several microlenses illuminate one pixel."""
    F_NUMBER_MISMATCH = 2
    """The f-numbers of main lens and microlenses differ."""
    INSIDE_LENS = 3
    """Array or sensor stand inside the lens, rims included."""
    TOUCHES_LENS = 4
    """Array or sensor nearly touch the lens."""
    PERSPECTIVE = 5
    """Fewer micro images fit on the sensor than microlenses."""
    FOCUS_OUT_OF_REACH = 6
    """No plane in front of the camera is in focus."""
    FOCUSED_AT_INFINITY = 7
    """Microlenses of a focused camera are in focus at infinity to within a pixel: nearly a plenoptic 1.0."""
    FEW_VIEWS = 8
    """A point is imaged by fewer than two microlenses across: no depth from neighbours."""
    FEW_PIXELS = 9
    """A micro image has few pixels across."""
    CUT_OFF_IMAGES = 10
    """Rims cut off micro images at the corner of the sensor."""
    OUT_OF_PLACE = 12
    """Parts are displaced from the design, to which the report refers."""
    IMPLAUSIBLE = 13
    """A number that no real camera has, as from mistaken units."""
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
    >>> print(pl.camera.CameraFinding(pl.camera.CameraFindingKind.DARK_GAPS, "micro images do not touch"))
    micro images do not touch
    """

    kind: CameraFindingKind
    message: str

    def __post_init__(self) -> None:
        set_field(self, "kind", choice(self.kind, CameraFindingKind, "kind"))
        if not isinstance(self.message, str):
            raise InvalidValueError(f"message is {self.message!r}; it must be a text")

    def __str__(self) -> str:
        return self.message


Rows = dict[CameraFindingKind, tuple[bool, str]]
"""Condition and message of each finding."""


def camera_findings(camera: PlenopticCamera, report: CameraReport) -> tuple[CameraFinding, ...]:
    """Findings of a report, in the order of their kinds."""
    tables = [_lens_rows(camera, report), *(_focus_rows(camera, report, focus) for focus in report.focus)]
    if camera.microlenses is not None:
        tables += [_image_rows(camera, report), *_gap_rows(report)]
    rows = [(kind, message) for table in tables for kind, (applies, message) in table.items() if applies]
    return tuple(CameraFinding(kind, message) for kind, message in sorted(rows, key=operator.itemgetter(0)))


def _lens_rows(camera: PlenopticCamera, report: CameraReport) -> Rows:
    part, gap = "sensor" if camera.microlenses is None else "microlens array", report.clearance
    placements = (camera.lens_placement, camera.microlenses_placement, camera.sensor_placement)
    return {
        CameraFindingKind.OUT_OF_PLACE: (
            any(placement is not None for placement in placements),
            "parts are displaced from the design, to which this report refers; see pl.camera.as_built(camera)",
        ),
        CameraFindingKind.IMPLAUSIBLE: (bool(implausible := "; ".join(implausible_values(camera))), implausible),
        CameraFindingKind.INSIDE_LENS: (
            gap < 0,
            f"the {part} is {-gap:.3g} mm inside the rim of the last surface; increase stop_to_microlenses by more",
        ),
        CameraFindingKind.TOUCHES_LENS: (
            0 <= gap < min(CLOSE, CLOSE * camera.stop_to_microlenses),
            f"the {part} is {gap:.3g} mm behind the lens, where mounts need room; increase stop_to_microlenses",
        ),
        CameraFindingKind.CUT_OFF_IMAGES: (
            report.corner_pupil_fraction < 1.0 - CUT,
            f"at the corner of the sensor {100 * (1 - report.corner_pupil_fraction):.0f} % of the iris is cut off by "
            "rims and other stops; stop down, or use a smaller sensor",
        ),
    }


def _image_rows(camera: PlenopticCamera, report: CameraReport) -> Rows:
    array, fill, match, pixels = camera.microlenses, report.image_fill, report.f_number_match, report.image_pitch_pixels
    assert array is not None and fill is not None and match is not None and pixels is not None
    assert report.dark_fraction is not None and report.overlap_fraction is not None
    assert report.image_border_pixels is not None
    border, walls, q = report.image_border_pixels / pixels, array.walls is Walls.OPAQUE, camera.sensor.pixel_pitch
    is_narrow, is_faster = fill + border < FULL, match > 1.0 + MATCHED
    is_mismatched = not walls and (is_faster or match < 1.0 - MATCHED - border)
    advice = _iris_advice(camera, report) if is_narrow or is_mismatched else ""
    longer, p = max(camera.sensor.size), neighbour_distance(array)
    lost_images = longer / p - longer / (pixels * q)
    return {
        CameraFindingKind.DARK_GAPS: (
            is_narrow,
            f"micro images are {fill:.2f} as wide as their distance and leave {100 * report.dark_fraction:.0f} % "
            f"of the sensor dark; {advice}",
        ),
        CameraFindingKind.OVERLAP: (
            not walls and (fill > 1.0 + OVERLAPPING or report.overlap_fraction > OVERLAPPING),
            f"{100 * report.overlap_fraction:.0f} % of the sensor gets light through several microlenses (images are "
            f"{fill:.2f} as wide as their distance, with a border of {report.image_border_pixels:.1f} pixels); stop "
            "down to avoid it",
        ),
        CameraFindingKind.F_NUMBER_MISMATCH: (
            is_mismatched,
            f"at the array the main lens works at f/{report.working_f_number:.3g} and the microlenses at "
            f"f/{report.microlens_f_number:.3g}; {advice}",
        ),
        CameraFindingKind.PERSPECTIVE: (
            abs(lost_images) >= 1.0,
            f"micro images repeat every {pixels:.4g} pixels and microlenses every {p / q:.4g}, so that the longer "
            f"side of the sensor holds {abs(lost_images):.1f} {'fewer' if lost_images > 0 else 'more'} images than "
            "microlenses; take the distance of the images for decoding",
        ),
        CameraFindingKind.FEW_PIXELS: (
            pixels < FEW_PIXELS,
            f"a micro image has {pixels:.2g} pixels across; use smaller pixels or a larger pitch for at least "
            f"{FEW_PIXELS:g}",
        ),
    }


def _iris_advice(camera: PlenopticCamera, report: CameraReport) -> str:
    """Iris, by Gaussian optics, with which micro images touch with their border, and the limit by the lens's rims."""
    fill = touching_fill(camera, 1.0 / report.exit_pupil_distance)
    paraxial_fill = camera.microlenses_to_sensor / (report.working_f_number_paraxial * (report.image_pitch or math.nan))
    semi_diameter = camera.lens.stop.semi_diameter * fill / paraxial_fill
    wide = with_semi_diameter(camera.lens, semi_diameter)
    _, clear = clear_pupil(wide, camera.stop_to_microlenses, report.wavelength)
    touching = f"an iris of semi-diameter {semi_diameter:.4g} mm makes images touch with their border"
    if not clear < semi_diameter:
        return touching
    return (
        f"{touching}, but rims and other stops of the lens limit it to {clear:.4g} mm; take a larger "
        "microlenses_to_sensor or a smaller pitch"
    )


def _focus_rows(camera: PlenopticCamera, report: CameraReport, focus: MicrolensFocus) -> Rows:
    f, b, s = focus.focal_length, camera.microlenses_to_sensor, focus.image_distance
    through = f" through microlenses of type {focus.type}" if len(report.focus) > 1 else ""
    where = f"{abs(s):.4g} mm {'behind' if s >= 0 else 'before'} the array"
    if focus.kind is CameraKind.CAMERA_ARRAY:
        reason = f"they look at a plane {where}; bring microlenses_to_sensor nearer to, but above, {f:g}"
    elif focus.kind is CameraKind.CONVENTIONAL:
        reason = "no plane has its image on the sensor; move the back with focused_at"
    else:
        reason = f"the main lens would have to form its image {where}; move the back with focused_at"
    rows = {
        CameraFindingKind.FOCUS_OUT_OF_REACH: (
            math.isnan(focus.z_far) and math.isnan(focus.z_traced),
            f"nothing in front of the camera is in focus{through}: {reason}",
        )
    }
    if camera.microlenses is None or focus.kind not in (CameraKind.KEPLERIAN, CameraKind.GALILEAN):
        return rows
    blur = opening_width(camera.microlenses) * b / camera.sensor.pixel_pitch
    return {
        **rows,
        CameraFindingKind.FEW_VIEWS: (
            focus.lenses_across < 2.0,
            f"a point in focus{through} is seen by {focus.lenses_across:.2f} microlenses across (virtual depth "
            f"{focus.virtual_depth:.2f}), and depth needs two; bring microlenses_to_sensor nearer to their focal "
            "length or open the iris",
        ),
        CameraFindingKind.FOCUSED_AT_INFINITY: (
            blur < abs(s),
            f"microlenses of focal length {f:g} mm at {b:g} mm are sharp to a pixel at infinity too, so that the "
            f"camera is nearly a plenoptic 1.0; for that, set microlenses_to_sensor to {f:g}",
        ),
    }


def _gap_rows(report: CameraReport) -> list[Rows]:
    ranges = sorted((f.z_far, f.z_near) for f in report.focus if not math.isnan(f.z_far))
    nearest_limits = accumulate((near for _, near in ranges), max)
    message = (
        "from z = {:.5g} to {:.5g} mm no type of microlens is sharp; choose focal lengths nearer to each other or stop "
        "down the microlenses"
    )
    return [
        {CameraFindingKind.DEPTH_GAP: (limit < far < near, message.format(limit, far))}
        for limit, (far, near) in zip(nearest_limits, ranges[1:], strict=False)
    ]
