"""The exit pupil by Gaussian optics, as the model of the lens has it."""

from __future__ import annotations

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points
from plenoptic.optics.lens.models import LensModel


def model_pupil(camera: PlenopticCamera) -> tuple[float, float]:
    """Position of the exit pupil, z in the lens's axes in mm (inf if telecentric), and its magnification from the iris.

    As the lens's model has it; the size is negative where the pupil stands upside down.
    """
    lens = camera.lens
    if lens.model is LensModel.NONE:
        return 0.0, 1.0
    points = cardinal_points(lens, camera.wavelength)
    if lens.model is LensModel.THIN:
        return points.rear_principal, points.entrance_pupil_semi_diameter / lens.stop.semi_diameter
    return points.exit_pupil, points.pupil_magnification
