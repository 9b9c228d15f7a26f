"""The lens model THIN with a round stop, as other renderers describe it."""

from typing import NamedTuple

import numpy as np

import plenoptic as pl


class ThinCamera(NamedTuple):
    """One plane at z, all in mm."""

    z: float
    aperture_radius: float
    image_distance: float
    object_distance: float


def thin_camera(camera):
    """Where the plane of the lens stands, and what is in focus: 1 / object distance + 1 / image distance = 1 / f."""
    assert camera.microlenses is None and camera.lens.model is pl.LensModel.THIN
    points = pl.paraxial.cardinal_points(camera.lens, camera.wavelength)
    image_distance = camera.z_sensor - points.rear_principal
    return ThinCamera(
        points.rear_principal,
        points.entrance_pupil_semi_diameter,
        image_distance,
        1.0 / (1.0 / points.efl - 1.0 / image_distance),
    )


def projected_solid_angles(camera):
    """(H, W, 1), sr: what the aperture is to the centres of pixels, and so the white image.

    The closed form for a disc and a parallel element off its axis: J. R. Howell, A Catalog of Radiation Heat Transfer
    Configuration Factors, B-13.
    """
    thin, (rows, columns), pitch = thin_camera(camera), camera.sensor.shape, camera.sensor.pixel_pitch
    row, column = np.indices((rows, columns))
    off_axis = pitch * np.hypot(row + 0.5 - rows / 2, column + 0.5 - columns / 2)
    h, r = off_axis / thin.image_distance, thin.aperture_radius / thin.image_distance
    z = 1 + h**2 + r**2
    return (np.pi / 2 * (1 - (z - 2 * r**2) / np.sqrt(z**2 - 4 * h**2 * r**2)))[..., None]
