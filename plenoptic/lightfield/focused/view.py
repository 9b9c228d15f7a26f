"""A view of the scene from one point of a focused camera's pupil."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import array_axes
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.core.display import picture_of
from plenoptic.core.values import Floats, result
from plenoptic.errors import InvalidValueError
from plenoptic.lightfield.focused.pixel_rays import paraxial_pupil
from plenoptic.lightfield.grid_camera import NO_DISTANCES
from plenoptic.scene.scene import Scene
from plenoptic.truth.channels import GroundTruth, Truth


@result
class View:
    """View of the scene from one point of the pupil. See `render_view`, which returns it.

    Attributes
    ----------
    picture : (rows, columns, C) array of float32
        Radiance; nan where no surface is visible.
    standard_error : (rows, columns, C) array of float32, or None
        One standard deviation, propagated from the raw image; None if the shot has none.
    disparity : (rows, columns) array
        Disparity of the visible surface, in pixels of the raw image.
    coverage : (rows, columns) array
        Density of the raw pixels that show the surface: 1 if the whole pupil sees it, less near an occluder.
    on_array : (rows, columns, 2) array
        x and y, in mm, at which the light of the pixels passes the array.
    spacing : float
        Distance of the pixels on the array, in mm.
    viewpoint : (float, float)
        Point of the pupil through which all light passes, in semi-diameters of the iris.
    camera : PlenopticCamera or None
        None for a view of a `MicroImageGrid`, whose lengths are pixels of the raw image.
    filled : (rows, columns) array of bool, or None
        True for pixels replaced by `fill=True`, which without it are nan, show another surface, or are made from
        unreliable disparities; None without it.
    """

    picture: NDArray[np.float32]
    standard_error: NDArray[np.float32] | None
    disparity: Floats
    coverage: Floats
    on_array: Floats
    spacing: float
    viewpoint: tuple[float, float]
    camera: PlenopticCamera | None
    filled: NDArray[np.bool_] | None = None

    def truth(self, scene: Scene, *, truth: Truth = Truth.ALL) -> GroundTruth:
        """Ground truth of the pixels, traced along the rays through their positions on the array and the viewpoint.

        Parameters
        ----------
        scene : Scene
        truth : Truth, optional
            Requested channels; rays between microlenses have no MICROLENS, OBJECT_SHARE and CHORD_DISPARITY.

        Returns
        -------
        GroundTruth
            Truth of (rows, columns) pixels.

        Examples
        --------
        >>> import numpy as np, plenoptic as pl
        >>> camera = pl.camera.example_camera(shape=(96, 96))
        >>> white = pl.render_white(camera, samples=16, progress=False)
        >>> view = pl.lightfield.render_view(white, white, z=-404.0)
        >>> view.truth(pl.shapes.white_plane()).depth[9, 9].round(6).item()
        404.0
        """
        from plenoptic.truth.ground_truth import truth_along

        if self.camera is None:
            raise InvalidValueError(f"rays of the view are unknown: {NO_DISTANCES}")
        axes = array_axes(self.camera)
        pupil = paraxial_pupil(self.camera)
        local = axes.local(self.on_array.reshape(-1, 2))
        slopes = local * pupil.vergence - np.array(self.viewpoint) * pupil.slope
        on_sensor = axes.on_sensor(local, slopes).reshape(self.on_array.shape)
        return truth_along(scene, self.camera, on_sensor, self.on_array, truth=truth)

    def __repr__(self) -> str:
        rows, columns, channels = self.picture.shape
        return f"View({rows} x {columns} x {channels} from {self.viewpoint})"

    _repr_html_ = picture_of
