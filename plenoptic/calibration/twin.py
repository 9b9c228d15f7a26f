"""Camera that renders, from the parameters of a calibration."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from plenoptic.calibration.fitting.geometry import Parameter, lenslets
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.core.values import Floats
from plenoptic.core.warn import warn
from plenoptic.optics.glass.media import ConstantMedium
from plenoptic.optics.lens.elements import Element
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.placement import Placement, rotation_about_axes
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.imperfections import MicrolensDeviations
from plenoptic.optics.microlens.lattice import Lattice, lattice_basis
from plenoptic.optics.sensor.sensor import Sensor
from plenoptic.optics.stops.circle import CircularStop
from plenoptic.optics.surfaces.surface import Surface

P = Parameter
_INDEX = 2.0
"""Refractive index of the substitute lens, plano-convex."""
_THICKNESS = 0.05
"""Its thickness over its focal length."""
_TOUCHING, _OTHER_F_NUMBER = 0.48, 0.15
"""Radius of micro images that touch over their distance, and logarithm of the ratio of f-numbers of which a warning
tells. Rendered white images give f-numbers within 3 %."""


class FixedParts(NamedTuple):
    """Parts of a camera that a calibration does not change."""

    sensor: Sensor
    lattice: Lattice
    f_number: float
    focal_lengths: tuple[float, ...]
    pivot: tuple[int, int]
    """Lattice indices of the microlens whose position is SHIFT_X, SHIFT_Y."""
    first: tuple[int, int]
    """Smallest lattice indices of micro images."""
    last: tuple[int, int]
    lens: LensStack | None = None
    """Prescription of the main lens, to be scaled to the focal length; None: a substitute."""

    @property
    def basis(self) -> Floats:
        """(2, 2) lattice vectors in pitches."""
        return lattice_basis(self.lattice, (1.0, 1.0))


def twin_camera(parameters: Floats, layout: FixedParts) -> PlenopticCamera:
    """Camera with the parameters of a calibration, which projects points as the calibration does.

    Without a prescription its lens is THIN if the exit pupil lies in the rear principal plane, otherwise PARAXIAL;
    distortion is left out.
    """
    focal_length = float(parameters[P.FOCAL_LENGTH])
    if layout.lens is None:
        lens = substitute_lens(focal_length, layout.f_number, float(parameters[P.EXIT_PUPIL]))
    else:
        lens = layout.lens.scaled(focal_length=focal_length)
    to_array, to_sensor = float(parameters[P.LENS_TO_ARRAY]), float(parameters[P.ARRAY_TO_SENSOR])
    pivot = np.asarray(layout.pivot, dtype=np.float64) @ layout.basis
    centre = lenslets(parameters, -pivot[None]).centre[0]
    tilts = float(parameters[P.TILT_X]), float(parameters[P.TILT_Y]), 0.0
    rotation = rotation_about_axes(tilts) @ rotation_about_axes((0.0, 0.0, float(parameters[P.TURN])))
    rows, columns = layout.sensor.shape
    off_axis = np.array([parameters[P.AXIS_COLUMN] - 0.5 * (columns - 1), 0.5 * (rows - 1) - parameters[P.AXIS_ROW]])
    pitch = float(parameters[P.PITCH])
    return PlenopticCamera(
        lens=lens,
        sensor=layout.sensor,
        stop_to_microlenses=cardinal_points(lens, 587.6).rear_principal + to_array,
        microlenses=MicrolensArray(
            pitch=pitch, focal_lengths=layout.focal_lengths, lattice=layout.lattice,
            imperfections=_stretch_deviations(pitch * float(parameters[P.STRETCH]), layout),
        ),
        microlenses_to_sensor=to_sensor,
        microlenses_placement=Placement(centre - [0.0, 0.0, to_array], rotation),
        sensor_placement=Placement(np.append(layout.sensor.pixel_pitch * off_axis, 0.0)),
    )  # fmt: skip


def measured_f_number(parameters: Floats, radius: float, pixel_pitch: float, nominal: float) -> float:
    """F-number of the lens by the radius of micro images in pixels; the nominal one where these touch.

    A warning tells if it is far from the nominal one.
    """
    image = radius * pixel_pitch
    ratio = float(parameters[P.LENS_TO_ARRAY] + parameters[P.EXIT_PUPIL]) / float(parameters[P.ARRAY_TO_SENSOR])
    if image > _TOUCHING * float(parameters[P.PITCH]) * (1.0 + 1.0 / ratio):
        return nominal
    f_number = float(parameters[P.FOCAL_LENGTH] + parameters[P.EXIT_PUPIL]) / (2.0 * image * ratio)
    if abs(math.log(f_number / nominal)) > _OTHER_F_NUMBER:
        warn(
            f"the nominal f-number is {nominal:g}, and micro images of the radius {radius:.3g} pixels ask for "
            f"{f_number:.3g} behind a thin lens, which the camera has; a telephoto or Petzval lens, whose exit pupil "
            "is elsewhere, has another"
        )
    return f_number


def object_origin(camera: PlenopticCamera) -> float:
    """Position z of the plane from which object distances count: the front principal plane, of THIN lenses the rear."""
    points = cardinal_points(camera.lens, camera.wavelength)
    return points.rear_principal if camera.lens.model is LensModel.THIN else points.front_principal


def substitute_lens(focal_length: float, f_number: float, exit_pupil: float) -> LensStack:
    """Plano-convex lens of a focal length, with the exit pupil in front of the rear principal plane by mm.

    A stop s in front of the convex side has its image s f / (f - s) in front of the rear principal plane. A stop behind
    the convex side, which has the rear principal plane in it, is the exit pupil itself.
    """
    radius, thickness = focal_length * (_INDEX - 1.0), _THICKNESS * focal_length
    semi_diameter = 0.5 * focal_length / f_number
    rim, glass = 0.4 * focal_length, ConstantMedium(_INDEX)
    if exit_pupil >= 0:
        distance = exit_pupil * focal_length / (focal_length + exit_pupil)
        # The pupil seen from the scene is the stop itself.
        elements: tuple[Element, ...] = (
            CircularStop(semi_diameter, thickness=distance),
            Surface(radius, thickness=thickness, medium=glass, semi_diameter=rim),
            Surface(math.inf, semi_diameter=rim),
        )
    else:
        scaled = semi_diameter * (focal_length + exit_pupil) / focal_length
        elements = (
            Surface(math.inf, thickness=thickness, medium=glass, semi_diameter=rim),
            Surface(-radius, thickness=-exit_pupil, semi_diameter=rim),
            CircularStop(scaled),
        )
    model = LensModel.THIN if exit_pupil == 0 else LensModel.PARAXIAL
    return LensStack(elements, name=f"{model.name.lower()} lens of {focal_length:.2f} mm", model=model)


def _stretch_deviations(shift: float, layout: FixedParts) -> MicrolensDeviations | None:
    """Displacements along the array's y axis by a length in mm for each pitch from the pivot; None for none."""
    if shift == 0:
        return None
    rows, columns = (np.arange(low - 4, high + 5) for low, high in zip(layout.first, layout.last, strict=True))
    index = np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1).reshape(-1, 2)
    # Relative to the lens (0, 0), which the placement puts where it is.
    y = index @ layout.basis[:, 1]
    return MicrolensDeviations(index=index, shift=np.column_stack([np.zeros(len(y)), shift * y]))
