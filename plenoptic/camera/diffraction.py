"""Diffraction at the openings of a camera: the user's option, and the records that kernels read."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from plenoptic.camera.gaussian import paraxial_cone
from plenoptic.camera.sampling.sampling_records import MAX_NEAR, NEAR
from plenoptic.core.values import Floats, checked_field, flag, value
from plenoptic.errors import InvalidValueError
from plenoptic.optics.diffraction.far_field import FarField, far_field
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.microlens.aperture import Opening, Walls, has_clear_gaps
from plenoptic.optics.microlens.lattice import Lattice, polygon_area
from plenoptic.optics.stops.stop_registry import is_circle, stop_kind

if TYPE_CHECKING:
    from plenoptic.camera.assembly import Assembly
    from plenoptic.camera.camera import PlenopticCamera

_RINGS, _MAX_BORDER = 16, 1024
"""Rings of microlenses around the sensor whose deflected light is followed, and most rows and columns of them."""
_OUTLINE = 64
"""Least number of points along the edge of an iris."""


@value
class Diffraction:
    """Diffraction of each path at the opening of its microlens and, optionally, at the iris: an option of a camera.

    Deflections are drawn from the far-field pattern of the opening, uniformly and incoherently illuminated, at the
    path's wavelength, wherever in the opening the path passes. `docs/how_to/diffraction.md` states the limits.

    Parameters
    ----------
    iris : bool
        True: paths are also deflected at the iris, seen as the entrance pupil; circles, polygons and stars.

    Raises
    ------
    InvalidValueError
        Raised by the camera: if it has no diffracting opening, or the pattern of an opening is not known.

    Examples
    --------
    >>> import dataclasses, plenoptic as pl
    >>> camera = dataclasses.replace(pl.camera.example_camera(shape=(64, 64)), diffraction=pl.Diffraction())
    >>> pl.plan(None, camera).runs(pl.rendering.Stage.DIFFRACTION)
    True
    """

    iris: bool = checked_field(flag, default=False)


class DeflectionRecord(NamedTuple):
    """Diffraction deflection between array and sensor, in local axes."""

    field: FarField
    wavelengths: Floats
    """(n + 1,): the camera's wavelength, then those drawn by paths, in mm, in the medium behind the lens."""
    shift: Floats
    """(2,): centre of the sensor, mm."""
    back: Floats
    """(2, 2): from mm about that centre to columns, from right to left, and rows."""
    area: float
    """Area in mm^2 of an opening and, if gaps are clear, its gap: the largest area of an aperture region."""
    border: int
    """Rows and columns around the sensor from which light is deflected into it."""
    near: int
    """Rows and columns up to which the pixels around a tile are computed with it: those of a gap between micro images,
    from `NEAR` to `MAX_NEAR`."""


class IrisRecord(NamedTuple):
    """Diffraction deflection at the entrance pupil, in the lens's axes."""

    field: FarField
    wavelengths: Floats
    """See `DeflectionRecord`; in the medium in front of the lens."""
    z: float
    """Position of the pupil in mm."""


def check_diffraction(camera: PlenopticCamera) -> None:
    """Raise an InvalidValueError unless every diffracting opening has one known pattern."""
    array = camera.microlenses
    if camera.diffraction is None:
        return
    if camera.diffraction.iris:
        _ = _entrance_pupil(camera)
    if array is None:
        if not camera.diffraction.iris:
            raise InvalidValueError(
                "diffraction is given for a camera without microlenses, which would diffract light; leave it out, or "
                "take Diffraction(iris=True)"
            )
        return
    if array.lattice is Lattice.FREE and array.aperture is None:
        raise InvalidValueError(
            "diffraction is given, and FREE microlenses that fill their cells have openings of many shapes; give the "
            "array an aperture"
        )
    if not array.model.focuses:
        raise InvalidValueError(
            "diffraction is given, and PINHOLE microlenses are holes without extent, from which light would go "
            "everywhere; take THIN ones"
        )
    if array.walls is Walls.OPAQUE:
        raise InvalidValueError("diffraction is given, and diffraction at opaque walls is not modelled; leave one out")


def _entrance_pupil(camera: PlenopticCamera) -> tuple[float, float]:
    """Position z of the entrance pupil in the lens's axes in mm, and its magnification, by the lens's model."""
    lens = camera.lens
    if not stop_kind(lens.stop).fills_outline:
        raise InvalidValueError(
            f"diffraction at the iris is asked for, and the pattern of a {type(lens.stop).__name__} is not known; take "
            "a circle, a polygon or a star, or Diffraction()"
        )
    if lens.model is LensModel.NONE:
        return float(lens.vertices[lens.iris_index]), 1.0
    points = cardinal_points(lens, camera.wavelength)
    if not math.isfinite(points.entrance_pupil):
        raise InvalidValueError("diffraction at the iris is asked for, and the lens shows it at infinity; leave it out")
    z = points.rear_principal if lens.model is LensModel.THIN else points.entrance_pupil
    return z, abs(points.entrance_pupil_semi_diameter) / lens.stop.semi_diameter


def iris_record(camera: PlenopticCamera, wavelengths: tuple[float, ...]) -> IrisRecord | None:
    """Compile diffraction at the iris for wavelengths in nm; None without."""
    if camera.diffraction is None or not camera.diffraction.iris:
        return None
    stop, (z, size) = camera.lens.stop, _entrance_pupil(camera)
    front_index = np.array([camera.lens.indices(w)[0] for w in wavelengths])
    opening = Opening(stop.outline(_OUTLINE), stop.semi_diameter if is_circle(stop) else math.inf)
    return IrisRecord(far_field(opening, None, np.eye(2) / size), np.array(wavelengths) * 1e-6 / front_index, z)


def deflection_border(camera: PlenopticCamera) -> int:
    """Rows and columns around the sensor from which deflected light is followed into it; 0 without diffraction."""
    if camera.diffraction is None or camera.microlenses is None:
        return 0
    ring = max(camera.microlenses.pitches) / camera.sensor.pixel_pitch
    return math.ceil(min(max(_RINGS * ring, NEAR), _MAX_BORDER))


def deflection_record(
    camera: PlenopticCamera, parts: Assembly, wavelengths: tuple[float, ...]
) -> DeflectionRecord | None:
    """Compile diffraction at the microlenses for wavelengths in nm; None without."""
    array = camera.microlenses
    if camera.diffraction is None or array is None:
        return None
    gaps = array.aperture is not None and has_clear_gaps(array.aperture) and array.aperture.fill_factor < 1
    cell, border = array.cell_corners if gaps else None, deflection_border(camera)
    cone, height = paraxial_cone(camera.lens, parts.z_plane, camera.wavelength), parts.distance
    gap = max(array.pitches) * (1.0 + cone.vergence * height) - 2.0 * cone.slope * height
    turn, shift = parts.sensor_to_local.turn[:2, :2], parts.sensor_to_local.shift[:2]
    rear_index = np.array([camera.lens.indices(w)[-1] for w in wavelengths])
    return DeflectionRecord(
        far_field(array.opening, cell, parts.array_turn),
        np.array(wavelengths) * 1e-6 / rear_index,
        shift.copy(),
        np.asarray(np.linalg.inv(turn), dtype=np.float64) / camera.sensor.pixel_pitch,
        polygon_area(array.opening.corners if cell is None else cell),
        border,
        math.ceil(min(max(gap / camera.sensor.pixel_pitch, NEAR), MAX_NEAR)),
    )
