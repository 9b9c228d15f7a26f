"""A light field as sub-aperture views: pictures of the scene from many points of the pupil."""

from __future__ import annotations

import math
import os
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.model_pupil import model_pupil
from plenoptic.core.values import Floats, number, result
from plenoptic.errors import InvalidValueError
from plenoptic.lightfield.object_planes import image_distance_behind_array
from plenoptic.truth.channels import GroundTruth, Truth

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.lightfield.depth_map import DepthMap
    from plenoptic.scene.scene import Scene
    from plenoptic.viewer.page import Viewer


@result
class LightField:
    """Sub-aperture views of a plenoptic 1.0 camera. See `decode`, which makes them, and `read_hci` and its like.

    A view holds the light that passes one part of the main lens's pupil: what lies at the same offset from the centre
    of every microlens image. Views are upright; the view of u = 1 is seen from a place farther to the right than that
    of u = 0, the view of v = 1 from farther down.

    Parameters
    ----------
    views : (U, V, rows, columns, C) array of float32
        Radiance; nan where no light comes from, or where the raw image ends.
    standard_error : (U, V, rows, columns, C) array of float32, or None
        One standard deviation.
    u, v : (U,) and (V,) arrays
        Offsets from the centres of the microlens images along columns (to the right) and rows (down) of the raw image,
        in pixels.
    pixel : (rows, columns, 2) array
        Row and column of the raw image at which the central view looks, between whole ones; nan beyond its end.
    on_array : (rows, columns, 2) array
        x and y, in mm, where the light of the pixels passes the array.
    exit_pupil : (U, V, 2) array
        x and y, in mm, at which the light of a view passes the exit pupil, from its centre (paraxial).
    pupil : (U, V, 2) array
        The same as a point of the iris in units of its semi-diameter; nan where the lens has no exit pupil at a finite
        distance.
    origin : (2,) array
        x and y of the first pixel of a view on the array of microlenses, in mm.
    spacing : (float, float)
        Distance of the pixels of a view on the array along x and y, in mm; columns run towards -x, rows towards +y.
    object_spacing : (float, float)
        The same in the plane in focus, mm; nan where there is none in front of the lens.
    z_focus : float
        The plane in focus, which the lens images onto the array, in mm of the camera's frame (paraxial).
    camera : PlenopticCamera or None
        None for light fields of other origin, which have no raw image: `pixel`, `on_array`, `pupil`, `origin` and
        `spacing` are nan, `u` and `v` count views, and `exit_pupil` holds the places of the cameras, in whose frame z
        is measured, or nan.
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

    def view(self, u: int, v: int) -> NDArray[np.float32]:
        """The view that is `u` places to the right of the central one and `v` below it: (rows, columns, C).

        Parameters
        ----------
        u, v : int
            From -(U - 1) / 2 to (U - 1) / 2: numbers of views, where `LightField.u` and `v` are pixels.

        Raises
        ------
        InvalidValueError
            Where there is no such view.
        """
        place = (self._row_of(u, len(self.u), "u"), self._row_of(v, len(self.v), "v"))
        return np.asarray(self.views[place])

    def truth(self, scene: Scene, u: int = 0, v: int = 0, *, truth: Truth = Truth.ALL) -> GroundTruth:
        """What the pixels of a view show, traced along its own rays: nothing is resampled.

        A pixel's ray starts at its place in the raw image and passes its place on the array straight, as light through
        the optical centre of a microlens does.

        Parameters
        ----------
        scene : Scene
        u, v : int, optional
            Which view, by its number from the middle; see `view`.
        truth : Truth, optional
            What is wanted; rays between microlenses have no MICROLENS, OBJECT_SHARE and CHORD_DISPARITY.

        Returns
        -------
        GroundTruth
            Of (rows, columns) pixels. Where the view has no pixel, its state is UNKNOWN.

        Raises
        ------
        InvalidValueError
            Where there is no such view, or nothing of what is wanted can be had.

        Examples
        --------
        >>> import plenoptic as pl
        >>> lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=4.25))
        >>> camera = pl.PlenopticCamera(lens=lens,
        ...     microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)),
        ...     sensor=pl.Sensor(shape=(110, 154), pixel_pitch=0.01),
        ...     stop_to_microlenses=123.3, microlenses_to_sensor=2.0)
        >>> white = pl.render_white(camera, samples=16, progress=False)
        >>> field = pl.lightfield.decode(white, white, views=3)
        >>> field.truth(pl.shapes.white_plane(), 1, 0).depth[3, 3].round(9).item()
        404.0
        """
        from plenoptic.truth.view_truth import truth_along

        if self.camera is None:
            raise InvalidValueError("the light field names no camera, so that its rays are not known; decode one")
        across, down = self.u[self._row_of(u, len(self.u), "u")], self.v[self._row_of(v, len(self.v), "v")]
        on_sensor = self.camera.sensor.centre_of(self.pixel[..., 0] + down, self.pixel[..., 1] + across)
        return truth_along(scene, self.camera, on_sensor, self.on_array, truth=truth)

    @property
    def centre(self) -> NDArray[np.float32]:
        """The view through the middle of the pupil: (rows, columns, C)."""
        return self.view(0, 0)

    def viewer(self, *, depth: DepthMap | None = None) -> Viewer:
        """A page in which the viewpoint, the focus and the aperture are moved by hand, as notebooks show it.

        Parameters
        ----------
        depth : DepthMap, optional
            What `pl.lightfield.depth` finds: is shown, and says what a click focuses on. None: the page matches the
            views around the click itself, and shows no depth.

        Returns
        -------
        Viewer
            Notebooks show it, and `save(path)` writes it, as `save_html` does, which has an example.

        Raises
        ------
        InvalidValueError
            Where no view holds light, or the depth is of another size.

        Notes
        -----
        docs/viewer.md says what is stored: views in 8 bits, at most 24 million pixels of them.
        """
        from plenoptic.viewer.light_field import light_field_page  # knows this class

        return light_field_page(self, depth=depth)

    def save_html(self, path: str | os.PathLike[str], *, depth: DepthMap | None = None) -> None:
        """Write the page of `viewer`, which has the argument, to one file, which any browser opens from the disk.

        A FileError where it cannot be written.

        Examples
        --------
        >>> import pathlib, tempfile, plenoptic as pl
        >>> lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=4.25))
        >>> camera = pl.PlenopticCamera(lens=lens,
        ...     microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)),
        ...     sensor=pl.Sensor(shape=(80, 80), pixel_pitch=0.01),
        ...     stop_to_microlenses=134.6, microlenses_to_sensor=2.0)
        >>> white = pl.render_white(camera, samples=16, progress=False)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = pathlib.Path(folder) / "views.html"
        ...     pl.lightfield.decode(white, white, views=5).save_html(path)
        ...     path.stat().st_size < 1e5
        True
        """
        self.viewer(depth=depth).save(path)

    @staticmethod
    def _row_of(which: int, count: int, name: str) -> int:
        first, last = -(count // 2), (count - 1) // 2
        given = number(which, name)
        if not given.is_integer() or not first <= given <= last:
            raise InvalidValueError(
                f"{name} is {given:g}; it must be a whole number from {first} to {last}, the number of a view from the "
                "middle"
            )
        return int(given) - first

    def disparity_at(self, z: float) -> tuple[float, float]:
        """How far the image of a plane moves from one view to the next, by Gaussian optics.

        With the exit pupil a distance D before the array and the image of the plane e behind it, light that passes the
        pupil at P meets the array at P e / (D + e) beside where light through its middle does, and P grows by D / b
        times the pitch of a pixel for each pixel of u. Offsets count from the chief rays' places here;
        `GroundTruth.view_disparity` counts them from the microlenses' centres and so has e for D e / (D + e).

        Parameters
        ----------
        z : float
            The plane in the camera's frame, mm.

        Returns
        -------
        (float, float)
            Pixels of a view along columns for each pixel of u, and along rows for each pixel of v; 0 in focus, positive
            nearer than that, where points move against the step (to the left in views farther right), negative beyond.
        """
        place = number(z, "z")
        camera = self.camera
        if camera is None:
            return self._between_cameras(place)
        behind = image_distance_behind_array(camera, place)
        pupil, _ = model_pupil(camera)
        gap = camera.stop_to_microlenses - pupil
        # e / (D + e) times D, with both at any distance.
        share = 1.0 if math.isinf(behind) else behind / (gap + behind)
        lever = gap * share if math.isfinite(gap) else behind
        per_pixel = lever * camera.sensor.pixel_pitch / camera.microlenses_to_sensor
        return per_pixel / self.spacing[0], per_pixel / self.spacing[1]

    def _between_cameras(self, z: float) -> tuple[float, float]:
        """`disparity_at` of cameras side by side that look at one plane."""
        if not z < 0:
            raise InvalidValueError(f"z is {z:g} mm; the plane must lie in front of the cameras, at z below 0")
        steps = (
            self.exit_pupil[1:2, 0, 0] - self.exit_pupil[:1, 0, 0],
            self.exit_pupil[0, :1, 1] - self.exit_pupil[0, 1:2, 1],
        )
        apart = [float(step[0]) if len(step) else math.nan for step in steps]
        across, down = (
            step * (self.z_focus / z - 1.0) / pixel for step, pixel in zip(apart, self.object_spacing, strict=True)
        )
        if math.isnan(across) and math.isnan(down):
            raise InvalidValueError(
                "the light field does not say where its views were seen from; refocus it by disparity"
            )
        return across, down

    def __repr__(self) -> str:
        across, down, rows, columns, channels = self.views.shape
        return f"LightField({across} x {down} views of {rows} x {columns} x {channels})"

    def _repr_html_(self) -> str:
        from plenoptic.plots.notebook.pictures import light_field_html

        return light_field_html(self)
