"""Views of a focused camera, rendered from its raw image."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.camera.assembly import array_axes
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.points.micro_image_grid import MicroImageGrid
from plenoptic.core.parallel import thread_count
from plenoptic.core.progress.bar import CallProgress
from plenoptic.core.values import Floats, finite, length_in_mm, numbers, positive
from plenoptic.core.warn import warn
from plenoptic.errors import InvalidValueError
from plenoptic.lightfield.decode import field_of, odd_count, without_distances
from plenoptic.lightfield.depth_map import DepthMap
from plenoptic.lightfield.focused.edges import correct_edges, edge_weights
from plenoptic.lightfield.focused.filling import fill_disparities
from plenoptic.lightfield.focused.pixel_rays import PixelRays, pixel_rays
from plenoptic.lightfield.focused.splats import (
    OVERSHOOT,
    Grid,
    Splats,
    footprints,
    grid_of,
    sort_splats,
    splat_picture,
    surface_depth,
)
from plenoptic.lightfield.focused.view import View
from plenoptic.lightfield.matching.consensus import CONFIDENCE_AT_EDGES
from plenoptic.lightfield.pinhole_model import image_distance_behind_array
from plenoptic.lightfield.raw_arrays import checked_viewpoint
from plenoptic.lightfield.views import LightField
from plenoptic.rendering.exposure import Exposure

_LEAST_LIGHT = 0.1
_HALF_SIDE = 0.6
"""Half the side of the grid of viewpoints, in semi-diameters of the iris; its corners lie at 0.85."""
_FINEST = 0.01
"""Minimum pixel width of a picture, as a fraction of the pitch."""
_SMALL_ERROR = 0.01
"""Relative standard error up to which disparities count by their confidence alone."""
_PIXELS_PER_PITCH = 6
"""Pixels of a view per pitch."""
_QUADRATIC, _LINEAR = 6, 3
"""Terms of the fitted functions."""


class ViewSamples(NamedTuple):
    """Samples of pictures from any viewpoint."""

    rays: PixelRays
    splats: Splats
    """In the order of the rays; `first`, `offset` and `area` are not set yet."""
    grid: Grid
    terms: int


def render_view(  # noqa: PLR0913
    shot: Exposure,
    white: Exposure | MicroImageGrid,
    disparity: ArrayLike | DepthMap | None = None,
    *,
    z: float | None = None,
    fill: bool = False,
    viewpoint: tuple[float, float] = (0.0, 0.0),
    aperture: float | None = None,
    spacing: float | None = None,
    least_light: float = _LEAST_LIGHT,
    camera: PlenopticCamera | MicroImageGrid | None = None,
    threads: int | None = None,
    progress: bool = True,
) -> View:
    """Render a view from the raw image of a focused plenoptic camera (2.0), in focus everywhere or on one plane.

    Parameters
    ----------
    shot, white : Exposure, or MicroImageGrid for white
        As in `decode`.
    disparity : DepthMap, (H, W) array_like or float, optional
        Disparity of each pixel of the shot, as `GroundTruth.chord_disparity` or a `DepthMap`, nan if unknown: the
        picture is in focus everywhere (total focus), with occlusion. A number: the picture is refocused at this
        disparity.
    z : float, optional
        In place of a disparity, z in mm of the plane of refocusing in the camera's frame, by Gaussian optics.
    fill : bool, optional
        Whether to interpolate unknown disparities of pixels, so that the picture has no holes: from those around them,
        of a `DepthMap` from those with confidence and small standard errors most, and across edges of the radiance
        least. See `View.filled`; other pixels of the view do not change, and its border may stay nan.
    viewpoint : (float, float), optional
        Point of the pupil from which the scene is seen, to the right and up, in semi-diameters of the iris.
    aperture : float, optional
        Largest distance from the viewpoint at which the rays of used pixels pass the pupil, in semi-diameters of the
        iris. None: all pixels. Refocused pictures have the depth of field of this aperture; pictures in total focus
        change only at glossy surfaces, and in noise.
    spacing : float, optional
        Distance of the picture's pixels on the array, in mm. None: a sixth of the pitch.
    least_light : float, optional
        Pixels are used where the white image has at least this fraction of its 99th percentile.
    camera : PlenopticCamera or MicroImageGrid, optional
        As in `decode`; with a grid, `spacing` is in pixels of the raw image, and `z` is refused.
    threads : int, optional
        None: one for each processor, at most NUMBA_NUM_THREADS. The result does not depend on it.
    progress : bool, optional
        Whether to show the progress, or that something is being compiled, after one second.

    Returns
    -------
    View
        Upright, also if the array is rotated. A pixel is the mean over its area. Pixels lie at whole multiples of the
        spacing from the centre of the array, so that the view of a region is part of that of the whole.

    Raises
    ------
    InvalidValueError
        If there are no microlenses on a lattice, if they are focused at infinity, if the white image does not fit the
        camera, as in `decode`, unless exactly one of disparity and z is given, if a refocused picture is to be filled,
        or if a number is out of range.

    Notes
    -----
    A pixel's ray passes the optical centre of its microlens at c and the pupil, D before the array, at p. With the
    image of its point a = b pitch / (disparity pixel pitch) behind the array, light of the point that passes the
    viewpoint P meets the array at c + (P - p) a / (D + a).

    At these points the pixels are samples of the picture. Around each picture pixel a quadratic function (a linear one
    for refocusing) is fitted to the samples. The function is averaged over each sample's footprint: the raw pixel, and
    the aperture of a defocused microlens. Sharper and brighter samples weigh more. Samples whose positions differ by a
    pixel at the rim of the pupil belong to different surfaces; the nearest surface is visible where its samples are
    dense enough. Pixels near depth edges weigh a twentieth.

    A refocused picture averages the aperture of the main lens at as many points as microlenses see an object point.
    Out of focus, their separate images remain visible.

    References
    ----------
    T. Georgiev and A. Lumsdaine, Computer Graphics Forum 29 (2010), doi:10.1111/j.1467-8659.2009.01569.x, for patches;
    H. Takeda, S. Farsiu and P. Milanfar, IEEE Trans. Image Process. 16 (2007), doi:10.1109/TIP.2006.888330, for
    regression.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> camera = pl.camera.example_camera(shape=(96, 96))
    >>> shot = pl.render(pl.check_scene(), camera, samples=64, progress=False, truth=pl.Truth.CHORD_DISPARITY)
    >>> white = pl.render_white(camera, samples=16, progress=False)
    >>> view = pl.lightfield.render_view(shot, white, shot.truth.chord_disparity)
    >>> view, bool(abs(np.nanmedian(view.disparity) - 3.26) < 0.05)
    (View(31 x 31 x 1 from (0.0, 0.0)), True)
    """
    rays = pixel_rays(shot, white, camera, least_light, disparity)
    radius = math.inf if aperture is None else positive(aperture, "aperture")
    pupil_point = checked_viewpoint(viewpoint)
    with CallProgress("rendering the view", kind="camera", show=progress):
        samples = _sample_sets(rays, disparity, z, fill, spacing)
        return _render_and_fill(samples, pupil_point, radius, thread_count(threads))


def render_views(
    shot: Exposure,
    white: Exposure | MicroImageGrid,
    disparity: ArrayLike | DepthMap,
    *,
    views: int = 5,
    fill: bool = False,
    spacing: float | None = None,
    camera: PlenopticCamera | MicroImageGrid | None = None,
    threads: int | None = None,
) -> LightField:
    """Render views of a focused plenoptic camera (2.0) from a grid of points of the pupil, as a light field.

    Parameters
    ----------
    shot, white, disparity, fill, spacing, camera, threads
        As in `render_view`; the disparity of each pixel.
    views : int, optional
        Odd number of views along u and along v. The outermost lie at 0.6 of the iris's semi-diameter on each side.

    Returns
    -------
    LightField
        Its `u` and `v` are offsets from the chief rays on the sensor, as in `decode`, so that
        `LightField.disparity_at`, `LightField.truth`, `refocus` and exports apply. Views are in focus everywhere.

    Raises
    ------
    InvalidValueError
        As `render_view` does, and for an even number of views.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.camera.example_camera(shape=(96, 96))
    >>> shot = pl.render(pl.check_scene(), camera, samples=16, progress=False, truth=pl.Truth.CHORD_DISPARITY)
    >>> white = pl.render_white(camera, samples=16, progress=False)
    >>> field = pl.lightfield.render_views(shot, white, shot.truth.chord_disparity, views=3)
    >>> field, field.pupil[2, 2].round(6).tolist()
    (LightField(3 x 3 views of 31 x 31 x 1), [0.6, -0.6])
    """
    count = odd_count(views)
    rays = pixel_rays(shot, white, camera, _LEAST_LIGHT, disparity)
    camera, pupil = rays.camera, rays.pupil
    samples = _sample_sets(rays, disparity, None, fill, spacing)
    positions = np.linspace(-_HALF_SIDE, _HALF_SIDE, count) if count > 1 else np.zeros(1)
    # Offsets increase to the right in the image, and in an upright pupil.
    scale, grid = pupil.slope * camera.microlenses_to_sensor / camera.sensor.pixel_pitch, samples[0].grid
    sign, workers = math.copysign(1.0, scale), thread_count(threads)
    rendered = [
        [_render_and_fill(samples, (sign * x, -sign * y), math.inf, workers) for y in positions] for x in positions
    ]
    axes, local = array_axes(camera), grid.positions()
    chief = axes.on_sensor(local.reshape(-1, 2), local.reshape(-1, 2) * pupil.vergence)
    pixel = camera.sensor.pixel_of(chief).reshape(local.shape)
    errors = [[view.standard_error for view in column] for column in rendered]
    field = field_of(
        camera,
        np.array([[view.picture for view in column] for column in rendered]),
        None if rays.raw.variance is None else np.array(errors),
        np.tile(abs(scale) * positions, (2, 1)),
        local[0, 0],
        (grid.spacing, grid.spacing),
        np.concatenate([pixel, rendered[0][0].on_array], axis=-1),
    )
    return field if rays.has_distances else without_distances(field)


def _sample_sets(
    rays: PixelRays, disparity: ArrayLike | DepthMap | None, z: float | None, fill: bool, spacing: float | None
) -> list[ViewSamples]:
    """Samples of pixels with measured disparities; to fill a view, also those of reliable ones, and of all pixels."""
    depth_map = disparity if isinstance(disparity, DepthMap) else None
    measured = disparity.disparity if isinstance(disparity, DepthMap) else disparity
    in_pitches, everywhere = _picture_focus(rays, measured, z)
    disparities, width = [in_pitches], _picture_spacing(rays, spacing)
    if fill:
        if not everywhere:
            raise InvalidValueError("fill= needs the disparity of each pixel; a refocused picture has no holes to fill")
        is_known, trust = np.isfinite(in_pitches), np.ones(len(in_pitches))
        if depth_map is not None:
            error = rays.at(depth_map.standard_error) * rays.camera.sensor.pixel_pitch / min(rays.array.pitches)
            # The error moves a sample by more than a pixel: its disparity tells no place.
            uncertainty = rays.nearness(in_pitches - error) - rays.nearness(in_pitches + error)
            confidence = np.nan_to_num(rays.at(depth_map.confidence))
            placed = is_known & (confidence >= CONFIDENCE_AT_EDGES)
            placed &= np.abs(uncertainty) <= 2.0 * surface_depth(rays.pupil, width)
            is_known = placed if placed.any() else is_known
            trust = confidence / np.maximum(error / in_pitches / _SMALL_ERROR, 1.0) ** 2
        trust = np.where(is_known & np.isfinite(trust), trust, 0.0)
        if not np.array_equal(is_known, np.isfinite(in_pitches)):
            disparities.append(np.where(is_known, in_pitches, np.nan))
        disparities.append(fill_disparities(rays, in_pitches, is_known, trust))
    return [_picture_samples(rays, d, everywhere, width) for d in disparities]


def _render_and_fill(samples: list[ViewSamples], viewpoint: tuple[float, float], aperture: float, threads: int) -> View:
    """The view of the first samples; where it or that of reliable ones shows another surface or none, the last one."""
    view, *others = (_render_from_viewpoint(part, viewpoint, aperture, threads) for part in samples)
    if others:
        whole = others[-1]
        *measured, near_whole = (_nearness_of_view(samples[0].rays, part.disparity) for part in (view, *others))
        depth = surface_depth(samples[0].rays.pupil, view.spacing)
        filled = np.isfinite(near_whole) & ~np.all(np.abs(near_whole - measured) <= depth, axis=0)
        planes = {"disparity": filled, "coverage": filled, "picture": filled[..., None]}
        if view.standard_error is not None:
            planes["standard_error"] = filled[..., None]
        mixed = {name: np.where(hole, getattr(whole, name), getattr(view, name)) for name, hole in planes.items()}
        view = dataclasses.replace(view, **mixed, filled=filled)
    return view


def _nearness_of_view(rays: PixelRays, disparity: Floats) -> Floats:
    in_pitches = disparity * rays.camera.sensor.pixel_pitch / min(rays.array.pitches)
    b = rays.camera.microlenses_to_sensor
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(b / (in_pitches + b * rays.pupil.vergence))


def _render_from_viewpoint(samples: ViewSamples, viewpoint: tuple[float, float], aperture: float, threads: int) -> View:
    """The view from a point of the pupil, from pixels whose rays pass within an aperture around it."""
    rays, splats, grid, terms = samples
    camera, array, slope = rays.camera, rays.array, rays.pupil.slope
    viewpoint_slope = np.array(viewpoint) * slope
    in_aperture = np.hypot(*(rays.at_pupil - viewpoint_slope).T) <= aperture * abs(slope)
    samples_per_lens = np.bincount(rays.lens, in_aperture)[rays.lens]
    splats = splats._replace(
        nearness=np.where(in_aperture, splats.nearness, np.nan),
        area=array.cell_area / np.maximum(samples_per_lens, 1) / grid.spacing**2,
    )
    on_array = rays.through + (viewpoint_slope - rays.at_pupil) * splats.nearness[:, None]
    # Area of the array per pixel of a micro image, from the number of pixels that the pupil lights.
    pixel = camera.sensor.pixel_pitch
    pixels = math.pi * (min(aperture, 1.0) * slope * camera.microlenses_to_sensor / pixel) ** 2
    area = array.cell_area / min(max(pixels, 1.0), array.cell_area / pixel**2) / grid.spacing**2
    splats, depth = sort_splats(grid, on_array, splats), surface_depth(rays.pupil, grid.spacing)
    canvas = splat_picture(splats, grid, depth, area, terms, threads)
    if not np.isfinite(canvas.picture).any():
        warn(
            f"the picture from viewpoint {viewpoint} is empty: no pixel's light passes there, or the samples are too "
            "sparse; take a point of the iris, -1 to 1, and no smaller aperture than a pixel sees"
        )
    # With all samples on one side of a pixel, the fitted function may diverge.
    finite = [channel[np.isfinite(channel)] for channel in splats.radiance.T]
    low, high = (np.array([bound(channel, initial=0.0) for channel in finite]) for bound in (np.min, np.max))
    return View(
        picture=np.clip(canvas.picture, low, high + OVERSHOOT * (high - low)).astype(np.float32),
        standard_error=None if canvas.variance is None else np.sqrt(canvas.variance).astype(np.float32),
        disparity=canvas.disparity,
        coverage=canvas.coverage,
        on_array=array_axes(camera).on_array(grid.positions().reshape(-1, 2)).reshape(*grid.shape, 2),
        spacing=grid.spacing,
        viewpoint=viewpoint,
        camera=camera if rays.has_distances else None,
    )


def _picture_focus(rays: PixelRays, disparity: ArrayLike | None, z: float | None = None) -> tuple[Floats, bool]:
    """Disparities (n,) of the rays at which a picture is in focus, in pitches; True if each pixel has its own.

    Raises InvalidValueError unless exactly one of disparity and plane is given.
    """
    if z is not None and disparity is None:
        return _disparities_of_plane(rays, finite(z, "z")), False
    if z is not None or disparity is None:
        raise InvalidValueError(
            "give either disparity, of each pixel or one, or z=, the plane in mm; a truth has chord_disparity after "
            "render(..., truth=pl.Truth.CHORD_DISPARITY)"
        )
    disparities, shape = numbers(disparity, "disparity"), rays.raw.shot.shape[:2]
    if disparities.shape not in ((), shape):
        raise InvalidValueError(
            f"disparity has shape {disparities.shape}; give that of the shot, {shape}, or one number to refocus"
        )
    known = np.isfinite(disparities) & (disparities != 0.0)
    if not known.any():
        raise InvalidValueError("disparity is nowhere finite; give that of the pixels, such as truth.chord_disparity")
    in_pitches, median = rays.camera.sensor.pixel_pitch / min(rays.array.pitches), abs(np.median(disparities[known]))
    if not 0.0 < median * in_pitches < 1.0:
        raise InvalidValueError(
            f"disparity is {median:.3g} pixels in the median, and must lie between 0 and the pitch of "
            f"{1.0 / in_pitches:.3g}; give the disparity of a DepthMap, or a plane in mm as z="
        )
    return rays.at(np.broadcast_to(np.where(known, disparities, np.nan), shape)) * in_pitches, disparities.ndim > 0


def _disparities_of_plane(rays: PixelRays, z: float) -> Floats:
    behind = image_distance_behind_array(rays.camera, z)
    if behind == 0:
        raise InvalidValueError(
            f"z is {z:g} mm, which the lens images onto the microlenses, which do not show it; take another plane"
        )
    return rays.to_sensor / behind


def _picture_spacing(rays: PixelRays, spacing: float | None) -> float:
    """Distance of a picture's pixels in mm."""
    pitch = min(rays.array.pitches)
    width = pitch / _PIXELS_PER_PITCH if spacing is None else length_in_mm(spacing, "spacing")
    if not _FINEST * pitch <= width <= pitch:
        raise InvalidValueError(
            f"spacing is {width:g} mm; it must lie between {_FINEST * pitch:.3g} and the pitch of the microlenses, "
            f"{pitch:g}"
        )
    return width


def _picture_samples(rays: PixelRays, disparity: Floats, everywhere: bool, spacing: float) -> ViewSamples:
    """Rays as samples of pictures, see `_picture_focus`; their positions and density depend on the viewpoint."""
    pupil, raw, pitch = rays.pupil, rays.raw, min(rays.array.pitches)
    depth, light = surface_depth(pupil, spacing), rays.at(raw.white)
    radiance, weight = rays.at(raw.shot) / light, light.mean(axis=1) / raw.least
    variance = raw.variance_of(radiance, light, rays.at)
    nearness = rays.nearness(disparity)
    with np.errstate(divide="ignore", invalid="ignore"):
        if everywhere:
            nearness = correct_edges(rays, nearness, radiance, variance, spacing, depth)
            disparity = rays.to_sensor * (1.0 / nearness - pupil.vergence)
    of_pixel, of_lens = footprints(rays, nearness)
    if everywhere:
        # The radius of a point's image in pixels, from the variances of a disc and of a square.
        blur = np.sqrt(of_lens / (3.0 * of_pixel))
        weight = (weight * of_pixel / (of_pixel + of_lens)) ** 2 * edge_weights(rays, nearness, blur, depth)
    splats = Splats(
        first=np.empty(0, dtype=np.int64),
        offset=np.empty((0, 2)),
        nearness=nearness,
        disparity=disparity * pitch / rays.camera.sensor.pixel_pitch,
        weight=weight,
        area=np.empty(0),
        pixel=of_pixel / spacing**2,
        spread=(of_pixel + of_lens) / spacing**2,
        radiance=radiance,
        variance=variance,
    )
    return ViewSamples(rays, splats, grid_of(rays, spacing), _QUADRATIC if everywhere else _LINEAR)
