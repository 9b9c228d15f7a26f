"""A light field as sub-aperture views: images of the scene from many points of the pupil."""

from __future__ import annotations

import math
import os
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.display import picture_of
from plenoptic.core.values import Floats, number, result
from plenoptic.errors import InvalidValueError
from plenoptic.lightfield.view_model import ViewModel, view_model
from plenoptic.truth.channels import GroundTruth, Truth

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.lightfield.depth_map import DepthMap
    from plenoptic.scene.scene import Scene
    from plenoptic.viewer.page import Viewer


@result
class LightField:
    """Sub-aperture views of a plenoptic 1.0 camera. See `decode`, which returns them, and `read_hci` and other readers.

    A view contains the light that passes one part of the main lens's pupil: the pixels at the same offset from the
    centre of every micro image. Views are upright. The viewpoint of u = 1 lies farther to the right than that of u = 0,
    that of v = 1 farther down.

    Parameters
    ----------
    views : (U, V, rows, columns, C) array of float32
        Radiance; nan without light, or outside the raw image.
    standard_error : (U, V, rows, columns, C) array of float32, or None
        One standard deviation.
    u, v : (U,) and (V,) arrays
        Offsets from the centres of the micro images along columns (to the right) and rows (down) of the raw image, in
        pixels.
    pixel : (rows, columns, 2) array
        Fractional row and column of the raw image that the central view samples; nan outside it.
    on_array : (rows, columns, 2) array
        x and y, in mm, at which the light of the pixels passes the array.
    exit_pupil : (U, V, 2) array
        x and y, in mm, at which the light of a view passes the exit pupil, from its centre (paraxial).
    pupil : (U, V, 2) array
        The same as a point of the iris in units of its semi-diameter; nan if the exit pupil is at infinity.
    origin : (2,) array
        x and y of the first pixel of a view on the array of microlenses, in mm.
    spacing : (float, float)
        Distance of the pixels of a view on the array along x and y, in mm; columns run towards -x, rows towards +y.
    object_spacing : (float, float)
        The same in the plane in focus, mm; nan without one in front of the lens.
    z_focus : float
        z of the plane in focus in the camera's frame, mm: traced points near the axis that all views see at the same
        pixels; nan without one in front of the lens.
    camera : PlenopticCamera or None
        None for a `MicroImageGrid`: `on_array`, `origin` and `spacing` are in pixels of the raw image, `pupil` in radii
        of micro images, and what is in mm is nan. None for imported light fields, too, which have no raw image:
        `pixel`, `on_array`, `pupil`, `origin` and `spacing` are nan, and `u` and `v` count views. Then `exit_pupil`
        contains the positions of the cameras, in whose frame z is measured, or nan.
    ground_truth : DepthMap or None
        True depth and disparity of the central view in the files of an imported light field, with standard error 0 and
        confidence 1; None without them. For light fields with a camera, see `truth`.
    noise : (U, V) array or None
        Root mean square of the part of a view's standard error that is noise; the rest is of interpolation and blur.
        None if it is not known apart.
    """

    views: NDArray[np.float32]
    standard_error: NDArray[np.float32] | None
    u: Floats
    v: Floats
    pixel: Floats
    on_array: Floats
    exit_pupil: Floats
    pupil: Floats
    origin: Floats
    spacing: tuple[float, float]
    object_spacing: tuple[float, float]
    z_focus: float
    camera: PlenopticCamera | None
    ground_truth: DepthMap | None = None
    noise: Floats | None = None

    def view(self, u: int, v: int) -> NDArray[np.float32]:
        """The view `u` steps to the right of the central one and `v` steps below it: (rows, columns, C).

        Parameters
        ----------
        u, v : int
            Index from -(U - 1) / 2 to (U - 1) / 2; `LightField.u` and `v` are in pixels.

        Raises
        ------
        InvalidValueError
            If there is no such view.
        """
        index = (self._row_of(u, len(self.u), "u"), self._row_of(v, len(self.v), "v"))
        return np.asarray(self.views[index])

    def truth(self, scene: Scene, u: int = 0, v: int = 0, *, truth: Truth = Truth.ALL) -> GroundTruth:
        """Ground truth of a view, traced along its own rays: nothing is resampled.

        A pixel's ray starts at its position in the raw image and passes its position on the array undeviated, as light
        through the optical centre of a microlens.

        Parameters
        ----------
        scene : Scene
        u, v : int, optional
            Index of the view from the central one; see `view`.
        truth : Truth, optional
            Requested channels; rays between microlenses have no MICROLENS, OBJECT_SHARE and CHORD_DISPARITY.

        Returns
        -------
        GroundTruth
            Truth of (rows, columns) pixels; the state is UNKNOWN where the view has no pixel.

        Raises
        ------
        InvalidValueError
            If there is no such view, or none of the requested channels is available.

        Examples
        --------
        >>> import plenoptic as pl
        >>> camera = pl.camera.example_camera(pl.CameraKind.PLENOPTIC_1, shape=(110, 154))
        >>> white = pl.render_white(camera, samples=16, progress=False)
        >>> field = pl.lightfield.decode(white, white, views=3)
        >>> field.truth(pl.shapes.white_plane(), 1, 0).depth[3, 3].round(9).item()
        404.0
        """
        from plenoptic.truth.ground_truth import truth_along

        if self.camera is None:
            raise InvalidValueError("the light field names no camera, so that its rays are unknown; decode a raw image")
        across, down = self.u[self._row_of(u, len(self.u), "u")], self.v[self._row_of(v, len(self.v), "v")]
        on_sensor = self.camera.sensor.centre_of(self.pixel[..., 0] + down, self.pixel[..., 1] + across)
        return truth_along(scene, self.camera, on_sensor, self.on_array, truth=truth)

    @property
    def centre(self) -> NDArray[np.float32]:
        """The view through the centre of the pupil: (rows, columns, C)."""
        return self.view(0, 0)

    def viewer(self, *, depth: DepthMap | None = None) -> Viewer:
        """Interactive page with controls for viewpoint, focus and aperture, displayed by notebooks.

        Parameters
        ----------
        depth : DepthMap, optional
            Depth map of `pl.lightfield.depth`, displayed, and used for focusing at a click. None: the page matches the
            views around the click, and shows no depth.

        Returns
        -------
        Viewer
            Notebooks display it; `save(path)` writes it. For an example, see `save_html`.

        Raises
        ------
        InvalidValueError
            If no view contains light, or the depth map has another size.

        Notes
        -----
        The page stores views in 8 bits, at most 24 million pixels; see docs/viewer.md.
        """
        from plenoptic.viewer.light_field import light_field_page  # knows this class

        return light_field_page(self, depth=depth)

    def save_html(self, path: str | os.PathLike[str], *, depth: DepthMap | None = None) -> None:
        """Write the page of `viewer` to one file, which any browser opens from the disk.

        Raises FileError if the file cannot be written.

        Examples
        --------
        >>> import pathlib, tempfile, plenoptic as pl
        >>> camera = pl.camera.example_camera(pl.CameraKind.PLENOPTIC_1, shape=(80, 80))
        >>> white = pl.render_white(camera, samples=16, progress=False)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = pathlib.Path(folder) / "views.html"
        ...     pl.lightfield.decode(white, white, views=5).save_html(path)
        ...     path.stat().st_size < 1e5
        True
        """
        self.viewer(depth=depth).save(path)

    @staticmethod
    def _row_of(offset: int, count: int, name: str) -> int:
        first, last = -(count // 2), (count - 1) // 2
        steps = number(offset, name)
        if not steps.is_integer() or not first <= steps <= last:
            raise InvalidValueError(
                f"{name} is {steps:g}; it must be a whole number from {first} to {last}, counted from the central view"
            )
        return int(steps) - first

    def disparity_at(self, z: float) -> tuple[float, float]:
        """Shift of a plane's image from one view to the next, traced through the real lens.

        By Gaussian optics: the exit pupil lies a distance D in front of the array, and the image of the plane e behind
        it. Light that passes the pupil at P meets the array at a distance P e / (D + e) from the light through the
        pupil's centre. P grows by D / b times the pixel pitch for each pixel of u. Here offsets are measured from the
        chief rays; `GroundTruth.view_disparity` measures them from the centres of the microlenses: e in place of
        D e / (D + e). Aberrations change the shift from view to view: this is the slope of the traced shifts over all
        views, by least squares, at the pixel nearest to the axis. `DepthMap.disparity` has it for each pixel.

        Parameters
        ----------
        z : float
            z of the plane in the camera's frame, mm.

        Returns
        -------
        (float, float)
            Shift in pixels of a view along columns for each pixel of u, and along rows for each pixel of v. It is 0 in
            focus, negative beyond it, and positive nearer, where points move against the step: to the left in views
            farther right.
        """
        z_plane = number(z, "z")
        camera = self.camera
        if camera is None:
            return self._between_cameras(z_plane)
        disparity = self.model.disparity(camera, z_plane)
        row, column = self.model.axis
        across, down = (float(self.model.traced_disparity(k).of(disparity)[row, column]) for k in (1, 0))
        return across, down

    @cached_property
    def model(self) -> ViewModel:
        """Traced displacement of the views from Gaussian optics, for `depth` and `refocus`."""
        assert self.camera is not None
        positions = np.concatenate([self.pixel, self.on_array], axis=-1)
        return view_model(self.camera, (self.u, self.v), positions, self.origin, self.spacing)

    def _between_cameras(self, z: float) -> tuple[float, float]:
        """Disparity between parallel cameras whose views coincide on one plane; see `disparity_at`."""
        if not z < 0:
            raise InvalidValueError(f"z is {z:g} mm; the plane must lie in front of the cameras, at z below 0")
        steps = (
            self.exit_pupil[1:2, 0, 0] - self.exit_pupil[:1, 0, 0],
            self.exit_pupil[0, :1, 1] - self.exit_pupil[0, 1:2, 1],
        )
        baselines = [float(step[0]) if len(step) else math.nan for step in steps]
        across, down = (
            step * (self.z_focus / z - 1.0) / pixel for step, pixel in zip(baselines, self.object_spacing, strict=True)
        )
        if math.isnan(across) and math.isnan(down):
            raise InvalidValueError("the light field has no camera positions; refocus it by disparity")
        return across, down

    def __repr__(self) -> str:
        across, down, rows, columns, channels = self.views.shape
        return f"LightField({across} x {down} views of {rows} x {columns} x {channels})"

    _repr_html_ = picture_of
