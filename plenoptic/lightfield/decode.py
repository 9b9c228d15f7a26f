"""Decoding of the raw image of a plenoptic 1.0 camera into sub-aperture views."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.camera.assembly import array_axes
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.gaussian import kind_of, lateral_magnification, model_pupil
from plenoptic.camera.points.centres import CentreMethod, microlens_centres
from plenoptic.camera.points.micro_image_grid import MicroImageGrid
from plenoptic.core.values import Floats, choice, length_in_mm, numbers, positive, whole
from plenoptic.core.warn import warn
from plenoptic.errors import InvalidValueError
from plenoptic.lightfield.grid_camera import camera_and_white
from plenoptic.lightfield.merged_samples import LensReadings, MergedView, view_renderer
from plenoptic.lightfield.pinhole_model import image_distance_behind_array
from plenoptic.lightfield.raw_arrays import RawArrays, checked_viewpoint, raw_arrays
from plenoptic.lightfield.resample import Resampling, resampling
from plenoptic.lightfield.view_model import ViewModel, view_model
from plenoptic.lightfield.views import LightField
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lattice import Lattice
from plenoptic.rendering.exposure import Exposure

_MAX_VIEWS = 4095
"""Largest number of views along u: more than the pixels of any micro image."""
_FOCUS_TOLERANCE = 0.05
"""Relative distance of the sensor from the image of infinity or of the pupil, up to which the camera counts as
plenoptic 1.0. Another wavelength changes the distance by about 2 %.
"""


def decode(  # noqa: PLR0913
    shot: Exposure,
    white: Exposure | MicroImageGrid,
    *,
    views: int | None = None,
    step: float = 1.0,
    viewpoint: tuple[float, float] = (0.0, 0.0),
    spacing: float | None = None,
    disparity: ArrayLike | None = None,
    least_light: float = 0.05,
    method: CentreMethod = CentreMethod.CHIEF_RAY,
    camera: PlenopticCamera | MicroImageGrid | None = None,
) -> LightField:
    """Decode the raw image of a plenoptic 1.0 camera into sub-aperture views, devignetted by a white image.

    Raw and white image are interpolated (bilinearly) at the same offset (u, v) from the centre of every micro image;
    their quotient is the radiance. Square and rectangular lattices along the sensor give views directly. For other
    lattices, the pixels of a view are interpolated between the actual positions of the microlenses.

    Parameters
    ----------
    shot : Exposure
        Raw image of a camera whose microlenses are focused at infinity: b = f to within 5 %, or with a blur below one
        pixel. For raw images of focused cameras, see `render_view`.
    white : Exposure or MicroImageGrid
        White image of the same camera, of the whole sensor or of a region that contains the shot's. With a grid, views
        are not devignetted.
    views : int, optional
        Number of views along u and along v; odd, and at most across four micro images. None: as many as fit into one.
    step : float, optional
        Pixels of the raw image between neighbouring views.
    viewpoint : (float, float), optional
        Point of the pupil through which the central view's light passes: x to the right and y up, in semi-diameters of
        the iris. With `views=1`, one view from any point, also between pixels.
    spacing : float, optional
        Pixel spacing of a view on the array, in mm. None: the pitch of square and rectangular lattices along the
        sensor; otherwise the root of the area of a cell, so that there are as many pixels as microlenses.
    disparity : (rows, columns) array_like, optional
        Disparity of the central view's pixels in pixels of a view for each pixel of u, nan if unknown, as
        `DepthMap.disparity` of `depth(decode(shot, white))`. Each view is then rendered from the samples of all views.
    least_light : float, optional
        Minimum of the white image, as a fraction of its 99th percentile; views are nan below it. Views at offsets that
        belong to the image of a neighbouring microlens are nan everywhere.
    method : CentreMethod, optional
        Definition of the centres from which the offsets are measured.
    camera : PlenopticCamera or MicroImageGrid, optional
        The camera, if the shot does not store it; or the micro images of an unknown one.

    Returns
    -------
    LightField
        Views are upright, also if the array is rotated. Microlens positions include `imperfections` and placements.
        Points of the pupil are those of the design; disparities and the plane in focus are traced. With a grid, lengths
        on the array are in pixels of the raw image, and there is no camera.

    Raises
    ------
    InvalidValueError
        If there is no camera, no microlenses or no lattice (FREE ones have no neighbours to interpolate between); for a
        focused camera (2.0), a number out of range, a white image that does not cover the shot or whose micro images
        lie more than half a pitch from the camera's (a warning above 0.1 pixels), or a region without micro images; for
        a grid of another sensor or camera, by the micro images of the white image or else of the shot.

    Notes
    -----
    The lattice of the micro images of the white image is compared with the camera's; see `PlenopticCamera.fitted_to`.

    Errors are propagated for independent pixels: with the interpolated shot S and white image W, the variance of
    r = S / W is (var S + r^2 var W) / W^2. A white image without standard error counts as exact. Render the two with
    different seeds: with the same paths (if `plan(None, camera)` leaves the unvignetted core out), their errors are
    correlated, and the stated error is too large.

    Between microlenses, 24 neighbours are interpolated by cubic radial basis functions and a linear function. For
    detail that the lattice resolves, the error is below a tenth of that of linear interpolation. At borders, where
    neighbours are missing, interpolation is linear. Unresolved detail is estimated from the error of predicting each
    microlens from its neighbours at one and two distances, and is part of the standard error; so is the blur by the
    pixels of the raw image that a view reads, estimated from neighbouring views. Smaller details, such as highlights
    that fall between microlenses, are not.

    With a disparity, microlenses of other views sample the scene between those of a view, off the plane in focus. The
    samples are displaced as traced through the real lens, the nearest surface is seen where its samples are dense
    enough, and a quadratic function is fitted around each pixel, as in `render_view`. At every microlens this is
    compared with the view's own sample, which it does not contain. A pixel is that of the merged view where this
    predicts its neighbours better than interpolation does: not at the plane in focus, nor near edges and highlights
    that the disparity does not explain.

    Sub-aperture views after R. Ng et al., Stanford Tech Report CTSR 2005-02, section 3.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.camera.example_camera(pl.CameraKind.PLENOPTIC_1, shape=(110, 154), lattice=pl.Lattice.SQUARE)
    >>> white = pl.render_white(camera, samples=16, progress=False)
    >>> field = pl.lightfield.decode(white, white, views=9)
    >>> field
    LightField(9 x 9 views of 5 x 7 x 1)
    >>> float(field.centre.min()), float(field.centre.max())
    (1.0, 1.0)
    >>> field.pupil[8, 4, 0].round(2).item(), [round(d, 2) for d in field.disparity_at(-300.0)]
    (0.42, [0.33, 0.33])
    """
    geometry = camera_and_white(shot, white, camera)
    raw, camera = raw_arrays(shot, geometry.white, least_light), geometry.camera
    array, axes, pupil_point = _unfocused_array(camera), array_axes(camera), checked_viewpoint(viewpoint)
    pixel_spacing = None if spacing is None else length_in_mm(spacing, "spacing")
    offsets = _offsets(camera, array, views, positive(step, "step", "pixels"), pupil_point)
    max_offset = float(np.abs(offsets).max())
    centres = microlens_centres(
        camera, choice(method, CentreMethod, "method"), margin=max_offset * camera.sensor.pixel_pitch
    )
    is_chief = centres.method is CentreMethod.CHIEF_RAY
    geometry.check(shot, centres if is_chief else None)
    near = raw.near(centres.pixel, max_offset)
    if not near.any():
        raise InvalidValueError("the image contains no centre of a micro image; take a larger region")
    on_array, pixel = centres.on_array[near], centres.pixel[near]
    turn, origin = axes.parts.array_turn, axes.parts.array_origin
    positions, basis = axes.local(on_array) - origin, array.basis @ turn.T
    has_errors = raw.variance is not None
    grid = resampling(
        array,
        centres.index[near],
        pixel_spacing,
        positions=positions,
        basis=basis,
        errors=has_errors or disparity is not None,
    )
    inside = _in_own_image(camera, array, offsets)
    samples = grid.interpolate(np.column_stack([pixel, on_array]))
    readings, merged = _read_views(raw, pixel, offsets, inside), None
    if disparity is not None:
        disparities, shape = numbers(disparity, "disparity"), (grid.rows, grid.columns)
        if disparities.shape != shape:
            raise InvalidValueError(
                f"disparity has shape {disparities.shape}; give that of the views, {shape}, as depth(decode(shot, "
                "white)).disparity has it"
            )
        model = view_model(camera, (offsets[0], offsets[1]), samples, grid.origin + origin, grid.spacing)
        opening = array.opening.radius**2 / 4.0 if math.isfinite(array.opening.radius) else array.cell_area / 12.0
        in_view = ((positions - grid.origin) / grid.spacing)[:, ::-1] * (1.0, -1.0)
        opening /= grid.spacing[0] * grid.spacing[1]
        merged = view_renderer(camera, model, readings, in_view, disparities, opening)
    radiance, error, noise = _resample_views(readings, grid, inside, merged)
    if any(pupil_point) and not np.isfinite(radiance[len(inside) // 2, len(inside) // 2]).any():
        warn(f"the view from viewpoint {pupil_point} is empty: no light passes; take a point of the iris, -1 to 1")
    elif views is not None and not (inside[0].any() or inside[-1].any() or inside[:, 0].any() or inside[:, -1].any()):
        fitting = max(inside.any(axis=0).sum(), inside.any(axis=1).sum())
        warn(f"views is {views}, and micro images hold {fitting} at this step: the other views are empty; take fewer")
    stated = error if has_errors else None
    field = field_of(camera, radiance, stated, offsets, grid.origin + origin, grid.spacing, samples)
    field = dataclasses.replace(field, noise=noise if has_errors else None)
    return field if geometry.grid is None else without_distances(field)


def _unfocused_array(camera: PlenopticCamera) -> MicrolensArray:
    """The microlenses of a plenoptic 1.0 camera; raise InvalidValueError for another camera.

    Of focused microlenses, light from one point of the pupil would fall on pixels of several views.
    """
    array = camera.microlenses
    if array is None:
        raise InvalidValueError("the camera has no microlenses, and its image is a single view; use shot.image")
    if array.lattice is Lattice.FREE:
        raise InvalidValueError(
            "the microlenses lie on no lattice, and views are interpolated between neighbours on one; read the raw "
            "image at microlens_centres(camera).pixel"
        )
    b, pixel = camera.microlenses_to_sensor, camera.sensor.pixel_pitch
    gap = camera.stop_to_microlenses - model_pupil(camera)[0]
    for f in array.focal_lengths_at(camera.wavelength) if array.model.focuses else ():
        # Views are sharp between the image of infinity and the image of the pupil.
        low, high = sorted((b / f - 1.0, b / f - (b / gap if gap else math.inf) - 1.0))
        defocus = max(low, -high, 0.0)
        if defocus > _FOCUS_TOLERANCE and defocus * max(array.pitches) > pixel:
            raise InvalidValueError(
                f"the sensor is {b:g} mm behind microlenses of focal length {f:.4g} mm: a focused camera (2.0, "
                f"{kind_of(camera, f).name}), whose micro images show the scene and not the pupil; use "
                f"pl.lightfield.render_view(shot, white, disparity), or a camera with microlenses_to_sensor={f:.4g}"
            )
    return array


def odd_count(views: int) -> int:
    """Return a number of views that is odd; raise InvalidValueError otherwise."""
    if whole(views, "views", at_least=1, at_most=_MAX_VIEWS) % 2 == 0:
        raise InvalidValueError(f"views is {views}; it must be odd, so that one is central: take {views + 1}")
    return int(views)


def _offsets(
    camera: PlenopticCamera, array: MicrolensArray, views: int | None, step: float, viewpoint: tuple[float, float]
) -> Floats:
    """Offsets (2, views) of the views along u and v in pixels, `step` apart, around that of a viewpoint."""
    z, size = model_pupil(camera)
    gap, iris = camera.stop_to_microlenses - z, size * camera.lens.stop.semi_diameter
    pitch, b = camera.sensor.pixel_pitch, camera.microlenses_to_sensor
    if views is not None:
        half, most = odd_count(views) // 2, 1 + int(2.0 * max(array.pitches) / (pitch * step))
        if half > 0 and step > 2.0 * (reach := 2.0 * max(array.pitches) / pitch):
            raise InvalidValueError(f"step is {step:g} pixels, and four micro images span {2.0 * reach:.4g}: take less")
        if half > most:
            raise InvalidValueError(
                f"views is {views}, and at this step {2 * most + 1} views span four micro images already: take fewer"
            )
    else:
        # Half of the pupil's image, or half of the distance between overlapping images.
        image = abs(iris) * b / abs(gap) if math.isfinite(gap) else math.inf
        half = int(min(image, 0.5 * max(array.pitches)) / (pitch * step))
    central = np.zeros(2)
    if any(viewpoint):
        if not math.isfinite(gap):
            raise InvalidValueError(
                "viewpoint is a point of the exit pupil, which this lens has at infinity; leave it out"
            )
        central = np.array([viewpoint[0], -viewpoint[1]]) * iris * b / (gap * pitch)
        if np.abs(central).max() * pitch > max(array.pitches):
            raise InvalidValueError(
                f"viewpoint is {viewpoint}, {np.abs(central).max():.3g} pixels from the centres of micro images, which "
                f"are {max(array.pitches) / pitch:.3g} pixels apart; give a point of the pupil, within -1 to 1"
            )
    return central[:, None] + step * np.arange(-half, half + 1, dtype=np.float64)


def _in_own_image(camera: PlenopticCamera, array: MicrolensArray, offsets: Floats) -> NDArray[np.bool_]:
    """True for offsets (U, V) within the image of a microlens's own cell, not a neighbour's."""
    axes = array_axes(camera)
    z, _ = model_pupil(camera)
    projection = 1.0 + camera.microlenses_to_sensor / (camera.stop_to_microlenses - z)
    u, v = np.meshgrid(*offsets, indexing="ij")
    # Columns of the image run towards -x of the sensor.
    turn = axes.parts.sensor_to_local.turn[:2, :2].T @ axes.parts.array_turn
    offset = np.stack([-u, v], axis=-1) * camera.sensor.pixel_pitch @ turn / projection
    return np.asarray((offset @ array.cell_edges[:, :2].T <= array.cell_edges[:, 2]).all(axis=-1))


def _read_views(raw: RawArrays, centres: Floats, offsets: Floats, in_own_image: NDArray[np.bool_]) -> LensReadings:
    """Readings of the raw image at the offsets (2, views) from n centres; nan where there are none."""
    radiance, variance = np.full((2, *in_own_image.shape, len(centres), raw.shot.shape[2]), np.nan)
    for i, j in np.argwhere(in_own_image):
        radiance[i, j], errors = raw.read(centres + np.array([offsets[1, j], offsets[0, i]]))
        variance[i, j] = 0.0 * radiance[i, j] if errors is None else errors
    return LensReadings(radiance, variance, centres, offsets)


def _resample_views(
    readings: LensReadings,
    grid: Resampling,
    in_own_image: NDArray[np.bool_],
    merged: Callable[[tuple[int, int]], MergedView] | None,
) -> tuple[NDArray[np.float32], NDArray[np.float32], Floats]:
    """Views and their standard errors (U, V, rows, columns, C), interpolated or merged, and their noise (U, V)."""
    channels = readings.radiance.shape[3]
    shape = (*in_own_image.shape, grid.rows, grid.columns, channels)
    views, errors = np.full((2, *shape), np.nan, dtype=np.float32)
    noise_variance = np.full(in_own_image.shape, np.nan)

    def columns(planes: Floats) -> Floats:
        """Planes (views, n, C) as values (n, views C), for all views of a u at once."""
        return np.moveaxis(planes, 0, 1).reshape(planes.shape[1], -1)

    def images(resampled: Floats) -> Floats:
        return np.moveaxis(resampled.reshape(grid.rows, grid.columns, -1, channels), 2, 0)

    for u in np.flatnonzero(in_own_image.any(axis=1)).tolist():
        v = np.flatnonzero(in_own_image[u]).tolist()
        radiance, variance = readings.radiance[u, v], readings.variance[u, v]
        blur, blur_variance = np.stack([readings.aperture_blur(u, k) for k in v], axis=1)
        picture, mean_blur, noise, blur_noise = (
            images(grid.interpolate(columns(planes), power))
            for planes, power in ((radiance, 1), (blur, 1), (variance, 2), (blur_variance, 2))
        )
        # Interpolation undershoots at bright edges; radiance is not negative.
        minimum = np.nanmin(radiance, axis=(1, 2), keepdims=True, initial=0.0)[..., None]
        picture, squared_blur = np.maximum(picture, minimum), np.maximum(mean_blur**2 - blur_noise, 0.0)
        error = noise + images(grid.interpolation_variance(columns(radiance), columns(variance))) + squared_blur
        for k, index in enumerate(v):
            if merged is None:
                break
            view = merged((u, index))
            misfit = (radiance[k] - blur[k] - view.at_lenses) ** 2 - variance[k] - view.lens_variance
            expected = view.variance + np.maximum(grid.local_mean(misfit), 0.0)
            better = expected < np.where(np.isnan(picture[k]), np.inf, error[k])
            noise[k] = np.where(better, view.variance, noise[k])
            picture[k] = np.where(better, view.picture, picture[k])
            error[k] = np.where(better, expected, error[k])
        views[u, v], errors[u, v] = picture, np.sqrt(error)
        is_finite = np.isfinite(noise)
        noise_variance[u, v] = np.where(is_finite, noise, 0.0).sum((1, 2, 3)) / np.maximum(is_finite.sum((1, 2, 3)), 1)
    return views, errors, np.sqrt(noise_variance)


def field_of(
    camera: PlenopticCamera,
    views: NDArray[np.float32],
    error: NDArray[np.float32] | None,
    offsets: Floats,
    origin: Floats,
    spacing: tuple[float, float],
    positions: Floats,
) -> LightField:
    """Light field of views and their errors, whose pixels have positions (rows, columns, 4): `pixel`, `on_array`."""
    z, size = model_pupil(camera)
    gap = camera.stop_to_microlenses - z
    with np.errstate(invalid="ignore"):
        # Columns of the image run towards -x on the sensor, and light from there passes the pupil at +x.
        right, down = offsets * camera.sensor.pixel_pitch * gap / camera.microlenses_to_sensor
        at_pupil = np.stack(np.broadcast_arrays(right[:, None], -down[None, :]), axis=-1)
        pupil = at_pupil / (size * camera.lens.stop.semi_diameter)
    model = view_model(camera, (offsets[0], offsets[1]), positions, origin, spacing)
    focus, object_scale = _plane_in_focus(camera, model)
    return LightField(
        views=views,
        standard_error=error,
        u=offsets[0],
        v=offsets[1],
        pixel=positions[..., :2],
        on_array=positions[..., 2:],
        exit_pupil=at_pupil,
        pupil=pupil if math.isfinite(gap) else np.full(at_pupil.shape, np.nan),
        origin=origin,
        spacing=spacing,
        object_spacing=(spacing[0] * object_scale, spacing[1] * object_scale),
        z_focus=focus,
        camera=camera,
    )


def without_distances(field: LightField) -> LightField:
    """The light field of a `MicroImageGrid`, which tells nothing of the scene in mm, nor of the lens."""
    nowhere = np.full_like(field.exit_pupil, math.nan)
    nan = math.nan, math.nan
    return dataclasses.replace(field, camera=None, exit_pupil=nowhere, object_spacing=nan, z_focus=math.nan)


def _plane_in_focus(camera: PlenopticCamera, model: ViewModel) -> tuple[float, float]:
    """Plane of traced disparity 0 near the axis, mm, and the ratio of its height to that of its image on the array.

    nan without one in front of the lens.
    """
    z = float(model.object_z(model.traced_disparity(1).inverse(0.0)[model.axis]))
    if camera.lens.model is LensModel.NONE or not z < float(camera.lens.vertices[0]):
        return math.nan, math.nan
    magnification = lateral_magnification(camera.lens, z, camera.wavelength)
    behind = image_distance_behind_array(camera, z)
    return z, abs((1.0 + behind * model.vergence) / magnification) if magnification != 0 else math.inf
