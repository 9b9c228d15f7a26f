"""Views of a focused camera: its raw image is put together to one picture."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.camera.assembly import array_axes
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.core.parallel import thread_count
from plenoptic.core.values import Floats, finite, length_in_mm, numbers, positive
from plenoptic.core.waiting.bar import Waiting
from plenoptic.core.warn import warn
from plenoptic.errors import InvalidValueError
from plenoptic.lightfield.focused.edges import correct_edges, edge_weights, light_of
from plenoptic.lightfield.focused.pixel_rays import PixelRays, Pupil, exit_pupil_seen, pixel_rays
from plenoptic.lightfield.focused.splats import (
    Grid,
    Splats,
    Surfaces,
    footprints,
    grid_of,
    sorted_splats,
    splat_picture,
    surface_depth,
)
from plenoptic.lightfield.focused.view import View
from plenoptic.lightfield.micro_image_matching import focused_array
from plenoptic.lightfield.object_planes import image_distance_behind_array
from plenoptic.lightfield.raw_arrays import RawArrays, camera_of, checked_viewpoint, raw_arrays, relative_light
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.rendering.exposure import Exposure

LEAST_LIGHT = 0.1
_FINEST = 0.01
"""Parts of a pitch that pixels of a picture are wide at least."""
_OVERSHOOT = 0.25
"""By which part of their range a picture exceeds its samples at most: what takes blur back may, and noise does."""
_PARTS = 6
"""Pixels of a view to a pitch."""
_QUADRATIC, _LINEAR = 6, 3
"""Terms of the functions that are fitted."""


class RawRays(NamedTuple):
    """A raw image, and the rays of its pixels."""

    camera: PlenopticCamera
    array: MicrolensArray
    pupil: Pupil
    planes: RawArrays
    rays: PixelRays


class Focus(NamedTuple):
    """What pictures are sharp at."""

    disparity: Floats
    """(n,): of rays, in pitches."""
    everywhere: bool
    """Whether each pixel has its own."""


class Samples(NamedTuple):
    """Samples of pictures from all viewpoints."""

    seen: RawRays
    splats: Splats
    """In the order of rays; `first`, `place` and `area` are not yet known."""
    grid: Grid
    terms: int


def render_view(  # noqa: PLR0913
    shot: Exposure,
    white: Exposure,
    disparity: ArrayLike | None = None,
    *,
    z: float | None = None,
    viewpoint: tuple[float, float] = (0.0, 0.0),
    aperture: float | None = None,
    spacing: float | None = None,
    least_light: float = LEAST_LIGHT,
    camera: PlenopticCamera | None = None,
    threads: int | None = None,
    progress: bool = True,
) -> View:
    """Put the raw image of a focused plenoptic camera (2.0) together to a picture, sharp everywhere or on one plane.

    Parameters
    ----------
    shot, white : Exposure
        As in `decode`.
    disparity : (H, W) array_like or float, optional
        Of each pixel of the shot, as `GroundTruth.chord_disparity` and `DepthMap.disparity` have it, nan where it is
        not known: the picture is sharp everywhere (total focus), and what is nearer hides what is behind it. A number:
        the picture is refocused, sharp where points have this disparity.
    z : float, optional
        In place of it, the plane in the camera's frame in mm that the picture is refocused on, by Gaussian optics.
    viewpoint : (float, float), optional
        The place of the pupil from which the scene is seen, to the right and up, in semi-diameters of the iris.
    aperture : float, optional
        Pixels count whose rays pass the pupil within this distance of the viewpoint, in semi-diameters of the iris.
        None: all. Refocused pictures are those of a camera with this aperture; others differ where surfaces are glossy,
        and by noise.
    spacing : float, optional
        Distance of the picture's pixels on the array, in mm. None: a sixth of the pitch.
    least_light : float, optional
        Pixels count where the white image has this part of its 99th percentile.
    camera : PlenopticCamera, optional
        Where the shot names none.
    threads : int, optional
        None: one for each processor, at most NUMBA_NUM_THREADS. The result does not depend on it.
    progress : bool, optional
        Whether to show, from the second second on, how far it is or that something is compiled.

    Returns
    -------
    View
        Upright, also where the array is turned. A pixel is the mean of its area. Pixels lie at whole multiples of the
        spacing from the middle of the array, so that the view of a region is part of that of the whole.

    Raises
    ------
    InvalidValueError
        Without microlenses on a lattice, for a camera whose microlenses are focused at infinity, where not one of
        disparity and z is given, or for a number out of range.

    Notes
    -----
    A pixel's ray passes the optical centre of its microlens at c and the pupil, D before the array, at p. With the
    image of its point a = b pitch / (disparity pixel pitch) behind the array, light of the point that passes the
    viewpoint P meets the array at c + (P - p) a / (D + a).

    There pixels are samples of the picture. Around each of its pixels a quadratic function is fitted to them (a linear
    one, where it is refocused), whose means over the samples' footprints are compared: over pixels, and the openings
    of microlenses that are out of focus. The sharper a sample is, and the more light its pixel has, the more it counts.
    Samples whose places differ by a pixel at the rim of the pupil belong to different surfaces; the nearest is seen
    where its samples lie dense enough. Pixels beside edges of depth count a twentieth.

    A refocused picture has the aperture of the main lens and averages it with as many places as microlenses see a
    point: where it is not sharp, their images show beside each other.

    References
    ----------
    T. Georgiev and A. Lumsdaine, Computer Graphics Forum 29 (2010), doi:10.1111/j.1467-8659.2009.01569.x, for patches;
    H. Takeda, S. Farsiu and P. Milanfar, IEEE Trans. Image Process. 16 (2007), doi:10.1109/TIP.2006.888330, for
    regression.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> camera = pl.PlenopticCamera(
    ...     lens=pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=5.0)),
    ...     microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)),
    ...     sensor=pl.Sensor(shape=(96, 96), pixel_pitch=0.01), stop_to_microlenses=123.3, microlenses_to_sensor=1.7)
    >>> shot = pl.render(pl.check_scene(), camera, samples=64, progress=False, truth=pl.Truth.CHORD_DISPARITY)
    >>> white = pl.render_white(camera, samples=16, progress=False)
    >>> view = pl.lightfield.render_view(shot, white, shot.truth.chord_disparity)
    >>> view, bool(abs(np.nanmedian(view.disparity) - 3.26) < 0.05)
    (View(31 x 31 x 1 from (0.0, 0.0)), True)
    """
    seen = raw_rays(shot, white, camera, relative_light(least_light))
    wide = math.inf if aperture is None else positive(aperture, "aperture")
    place = checked_viewpoint(viewpoint)
    with Waiting("rendering the view", kind="camera", show=progress):
        samples = picture_samples(seen, picture_focus(seen, disparity, z), spacing)
        return render_from_viewpoint(samples, place, wide, thread_count(threads))


def render_from_viewpoint(samples: Samples, viewpoint: tuple[float, float], aperture: float, threads: int) -> View:
    """The view from a place of the pupil, of the pixels whose rays pass within an aperture around it."""
    (camera, array, pupil, _, rays), splats, grid, terms = samples
    towards = np.array(viewpoint) * pupil.slope
    chosen = np.hypot(*(rays.pupil - towards).T) <= aperture * abs(pupil.slope)
    lit = np.bincount(rays.lens, chosen)[rays.lens]
    splats = splats._replace(
        nearness=np.where(chosen, splats.nearness, np.nan), area=array.cell_area / np.maximum(lit, 1) / grid.spacing**2
    )
    on_array = rays.through + (towards - rays.pupil) * splats.nearness[:, None]
    area = _area(samples.seen, aperture) / grid.spacing**2
    surfaces = Surfaces(surface_depth(pupil, grid.spacing), area, terms)
    canvas = splat_picture(sorted_splats(grid, on_array, splats), grid, surfaces, threads)
    if not np.isfinite(canvas.picture).any():
        warn(
            f"the picture from viewpoint {viewpoint} is empty: no pixel's light passes there, or nowhere do they lie "
            "dense enough; take a place within the iris, -1 to 1, and no smaller aperture than a pixel sees"
        )
    # Where all samples lie on one side of a pixel, what is fitted to them may run away.
    low, high = (
        edge(splats.radiance, axis=0, where=np.isfinite(splats.radiance), initial=0.0) for edge in (np.min, np.max)
    )
    return View(
        picture=np.clip(canvas.picture, low, high + _OVERSHOOT * (high - low)).astype(np.float32),
        standard_error=None if canvas.variance is None else np.sqrt(canvas.variance).astype(np.float32),
        disparity=canvas.disparity,
        coverage=canvas.coverage,
        on_array=array_axes(camera).on_array(grid.places().reshape(-1, 2)).reshape(*grid.shape, 2),
        spacing=grid.spacing,
        viewpoint=viewpoint,
        camera=camera,
    )


def raw_rays(
    shot: Exposure, white: Exposure, camera: PlenopticCamera | None, least_light: float = LEAST_LIGHT
) -> RawRays:
    """The rays of a raw image."""
    planes, found = raw_arrays(shot, white, least_light), camera_of(shot, camera)
    array, pupil = focused_array(found), exit_pupil_seen(found)
    return RawRays(found, array, pupil, planes, pixel_rays(array_axes(found), array, planes, pupil))


def picture_focus(seen: RawRays, disparity: ArrayLike | None, z: float | None = None) -> Focus:
    """What pictures are sharp at, or an error."""
    if z is not None and disparity is None:
        return Focus(_of_plane(seen, finite(z, "z")), False)
    if z is not None or disparity is None:
        raise InvalidValueError(
            "give either disparity, of each pixel or one, or z=, the plane in mm; a truth has chord_disparity where "
            "render got truth=pl.Truth.CHORD_DISPARITY"
        )
    given, shape = numbers(disparity, "disparity"), seen.rays.shape
    if given.shape not in ((), shape):
        raise InvalidValueError(
            f"disparity has shape {given.shape}; give that of the shot, {shape}, or one number to refocus"
        )
    if not np.isfinite(given).any():
        raise InvalidValueError("disparity is nowhere finite; give that of the pixels, such as truth.chord_disparity")
    in_pitches = seen.camera.sensor.pixel_pitch / min(seen.array.pitches)
    usual = abs(float(np.median(given[np.isfinite(given)])))
    if not 0.0 < usual * in_pitches < 1.0:
        raise InvalidValueError(
            f"disparity is {usual:.3g} pixels in the median, and must lie between 0 and the pitch of "
            f"{1.0 / in_pitches:.3g}; give found.disparity of what depth found, or a plane in mm as z="
        )
    return Focus(seen.rays.at(np.broadcast_to(given, shape)) * in_pitches, given.ndim > 0)


def _of_plane(seen: RawRays, z: float) -> Floats:
    behind = image_distance_behind_array(seen.camera, z)
    if behind == 0:
        raise InvalidValueError(
            f"z is {z:g} mm, which the lens images onto the microlenses: they do not show it; take another plane"
        )
    return seen.rays.to_sensor / behind


def picture_samples(seen: RawRays, focus: Focus, given_spacing: float | None) -> Samples:
    """Rays as samples of pictures; where they fall, and how dense, depends on the viewpoint."""
    camera, array, pupil, planes, rays = seen
    disparity, everywhere = focus
    spacing = min(array.pitches) / _PARTS if given_spacing is None else length_in_mm(given_spacing, "spacing")
    if not _FINEST * min(array.pitches) <= spacing <= min(array.pitches):
        raise InvalidValueError(
            f"spacing is {spacing:g} mm; it must lie between {_FINEST * min(array.pitches):.3g} and the pitch of the "
            f"microlenses, {min(array.pitches):g}"
        )
    pixel, depth = camera.sensor.pixel_pitch, surface_depth(pupil, spacing)
    light = rays.at(planes.white)
    radiance, weight = rays.at(planes.shot) / light, light.mean(axis=1) / planes.least
    variance = planes.variance_of(radiance, light, rays.at)
    # a / (1 + a V) of the image a behind the array, as the Notes of `render_view` have it.
    with np.errstate(divide="ignore", invalid="ignore"):
        nearness = rays.to_sensor / (disparity + rays.to_sensor * pupil.vergence)
        if everywhere:
            nearness = correct_edges(rays, nearness, light_of(radiance, variance), spacing, depth)
            disparity = rays.to_sensor * (1.0 / nearness - pupil.vergence)
    foot = footprints(array, rays, pupil, nearness, pixel, camera.wavelength)
    if everywhere:
        weight = (weight * foot.pixel / (foot.pixel + foot.lens)) ** 2 * edge_weights(
            rays, nearness, foot.blur(), depth
        )
    splats = Splats(
        first=np.empty(0, dtype=np.int64),
        place=np.empty((0, 2)),
        nearness=nearness,
        disparity=disparity * min(array.pitches) / pixel,
        weight=weight,
        area=np.empty(0),
        pixel=foot.pixel / spacing**2,
        spread=(foot.pixel + foot.lens) / spacing**2,
        radiance=radiance,
        variance=variance,
    )
    return Samples(seen, splats, grid_of(rays, spacing), _QUADRATIC if everywhere else _LINEAR)


def _area(seen: RawRays, aperture: float) -> float:
    """Of the array for each pixel of a microlens image, with as many of them as the pupil lights, in mm^2."""
    camera, array, pupil, _, _ = seen
    pixels = (
        math.pi * (min(aperture, 1.0) * pupil.slope * camera.microlenses_to_sensor / camera.sensor.pixel_pitch) ** 2
    )
    return array.cell_area / min(max(pixels, 1.0), array.cell_area / camera.sensor.pixel_pitch**2)
