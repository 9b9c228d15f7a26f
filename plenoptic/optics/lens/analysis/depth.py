"""Depth distortion: which object distances are sharp on a flat sensor, against the height on it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.values import Floats, result
from plenoptic.optics.lens.analysis.astigmatic import foci
from plenoptic.optics.lens.analysis.fields import checked_fields
from plenoptic.optics.lens.gaussian.paraxial import object_position
from plenoptic.optics.lens.pupil.ray_aiming import aimed_rays_reverse
from plenoptic.optics.lens.stack import LensStack


@result
class DepthDistortion:
    """Which distances are sharp on a flat sensor. See `depth_distortion`, which makes it.

    Attributes
    ----------
    heights : (n,) array
        y of points of the sensor, mm.
    z_image : (m,) array
        Planes of the sensor, mm.
    z_object : (m,) array
        Their paraxial conjugates, mm.
    sagittal, tangential : (m, n) array
        z in mm of the object points on the chief rays that are sharp; above 0 where the lens is focused beyond
        infinity.
    """

    heights: Floats
    z_image: Floats
    z_object: Floats
    sagittal: Floats
    tangential: Floats

    @property
    def medial(self) -> Floats:
        """Harmonic mean of the sagittal and tangential z, (m, n), mm: the mean of their reciprocals."""
        with np.errstate(divide="ignore"):
            return np.asarray(2.0 / (1.0 / self.sagittal + 1.0 / self.tangential))


def depth_distortion(
    lens: LensStack, heights: ArrayLike, *, z_image: ArrayLike, wavelength: float = 587.6
) -> DepthDistortion:
    """Which object points are sharp on flat sensors, against the height on them: field curvature in object space.

    A camera that takes depth from sharpness or disparity, and was calibrated on the axis, errs by the difference to
    `z_object`. Chief rays are followed backwards from the sensor.

    Parameters
    ----------
    lens : LensStack
        Centred, LensModel.EXACT.
    heights : (n,) array
        y on the sensor, mm.
    z_image : float or (m,) array
        Planes of the sensor behind the lens, mm. For a plenoptic camera, those of the virtual images.
    wavelength : float, optional
        nm.

    Raises
    ------
    InvalidValueError
        If the lens is not centred or not EXACT, or a plane does not lie behind it.

    References
    ----------
    O. Johannsen et al., On the calibration of focused plenoptic cameras, LNCS 8200, 2013 (the term).

    Examples
    --------
    >>> import plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2")
    >>> found = pl.aberrations.depth_distortion(lens, [0.0, 20.0], z_image=134.624)
    >>> found.z_object.round(2).tolist(), found.medial.round(2).tolist()
    ([-404.0], [[-404.0, -399.29]])
    """
    radii = checked_fields(heights, 0.0, name="heights")
    planes = checked_fields(np.atleast_1d(z_image), 0.0, name="z_image")
    sagittal, tangential = np.empty((2, len(planes), len(radii)))
    for i, z in enumerate(planes.tolist()):
        for j, y in enumerate(radii.tolist()):
            ray = aimed_rays_reverse(lens, image_point=(0.0, y), z_image=z, pupil=[[0.0, 0.0]], wavelength=wavelength)
            found = foci(lens, ray, parallel=False, reverse=True)
            sagittal[i, j], tangential[i, j] = found.sagittal[0, 2], found.tangential[0, 2]
    conjugates = np.array([object_position(lens, z, wavelength) for z in planes.tolist()])
    return DepthDistortion(radii, planes, conjugates, sagittal, tangential)
