"""Decoding: the raw image of a plenoptic 1.0 camera becomes sub-aperture views."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import array_axes
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.model_pupil import model_pupil
from plenoptic.camera.points.centres import CentreMethod, microlens_centres
from plenoptic.camera.report.focus import kind_of
from plenoptic.camera.report.optics import lateral_magnification, object_plane
from plenoptic.core.values import Floats, choice, length_in_mm, positive, whole
from plenoptic.core.warn import warn
from plenoptic.errors import InvalidValueError
from plenoptic.lightfield.raw_arrays import (
    RawArrays,
    camera_of,
    checked_viewpoint,
    crop_in_white_image,
    raw_arrays,
    relative_light,
)
from plenoptic.lightfield.resample import Resampling, resampling
from plenoptic.lightfield.views import LightField
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lattice import Lattice
from plenoptic.rendering.exposure import Exposure

_MOST_VIEWS = 4095
"""Along u: more pixels than any microlens image has."""

_FOCUSED = 0.05
"""Relative distance of the sensor from where infinity or the pupil is sharp, up to which microlenses are meant to show
the pupil: another wavelength makes some 2 % of it."""


def decode(  # noqa: PLR0913
    shot: Exposure,
    white: Exposure,
    *,
    views: int | None = None,
    step: float = 1.0,
    viewpoint: tuple[float, float] = (0.0, 0.0),
    spacing: float | None = None,
    least_light: float = 0.05,
    method: CentreMethod = CentreMethod.CHIEF_RAY,
    camera: PlenopticCamera | None = None,
) -> LightField:
    """Take the raw image of a plenoptic 1.0 camera apart into sub-aperture views, devignetted by a white image.

    At the same offset (u, v) from the centre of every microlens image, raw and white image are read between pixels
    (bilinear), and their quotient is the radiance there. Square and rectangular lattices along the sensor give views
    directly; elsewhere, pixels of a view are interpolated between microlenses where they are built.

    Parameters
    ----------
    shot : Exposure
        Of a camera whose microlenses are focused on infinity: b = f to within 5 %, or what that blurs is less than a
        pixel. Raw images of others are put together by `render_view`.
    white : Exposure
        The white image of the same camera, of the whole sensor or of a region that holds that of the shot.
    views : int, optional
        Views along u, and along v; odd. None: as many as fit into a microlens image.
    step : float, optional
        Pixels of the raw image between neighbouring views.
    viewpoint : (float, float), optional
        Where the central view's light passes the pupil: x to the right and y up, in semi-diameters of the iris. With
        `views=1`, one view from any place, also between pixels.
    spacing : float, optional
        Between the pixels of a view on the array, in mm. None: that of square and rectangular lattices along the
        sensor; otherwise the root of the area of a cell, so that there are as many pixels as microlenses.
    least_light : float, optional
        A view is nan where the white image is below this part of its 99th percentile: there, too little light arrives.
        Views at offsets that belong to the image of a neighbouring microlens are nan everywhere.
    method : CentreMethod, optional
        What the offsets are measured from.
    camera : PlenopticCamera, optional
        Where the shot names none.

    Returns
    -------
    LightField
        Its views lie as the scene stands, also where the array is turned. Microlenses count where they are built
        (`imperfections`, placements). Places in the pupil, disparities and the plane in focus are those of the design.

    Raises
    ------
    InvalidValueError
        Without a camera, microlenses, or a lattice (FREE ones have no neighbours to interpolate between); for a focused
        camera (2.0), a number out of range, a white image that does not cover the shot, or a region without microlens
        images.

    Notes
    -----
    Errors are propagated as those of independent pixels: with a shot S and a white image W between pixels, the variance
    of r = S / W is (var S + r^2 var W) / W^2. A white image without standard error counts as exact. Render them
    with different seeds: where both have the same paths (`plan(None, camera)` says that no light is certain), errors
    are correlated with the same one, and what is stated is too large.

    Between microlenses, 24 neighbours are interpolated by cubic radial functions and a linear one, which leaves less
    than a tenth of the error of linear interpolation in what the lattice resolves. Where neighbours are missing, at
    borders, it is linear. What the lattice does not resolve is estimated from how well each microlens is foretold by
    its neighbours, and is part of the standard error.

    Sub-aperture views after R. Ng et al., Stanford Tech Report CTSR 2005-02, section 3.

    Examples
    --------
    >>> import plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=4.25))
    >>> camera = pl.PlenopticCamera(lens=lens,
    ...     microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,), lattice=pl.Lattice.SQUARE),
    ...     sensor=pl.Sensor(shape=(110, 154), pixel_pitch=0.01),
    ...     stop_to_microlenses=123.3, microlenses_to_sensor=2.0).focused_at(z=-404.0)
    >>> white = pl.render_white(camera, samples=16, progress=False)
    >>> field = pl.lightfield.decode(white, white, views=9)
    >>> field
    LightField(9 x 9 views of 5 x 7 x 1)
    >>> float(field.centre.min()), float(field.centre.max())
    (1.0, 1.0)
    >>> field.pupil[8, 4, 0].round(2).item(), [round(d, 2) for d in field.disparity_at(-300.0)]
    (0.42, [0.33, 0.33])
    """
    camera, array = _checked_camera(shot, white, camera)
    _check_unfocused(camera, array)
    step, least = positive(step, "step", "pixels"), relative_light(least_light)
    apart = None if spacing is None else length_in_mm(spacing, "spacing")
    place = checked_viewpoint(viewpoint)
    offsets = _offsets(camera, array, views, step, place)
    planes, largest = raw_arrays(shot, white, least), float(np.abs(offsets).max())
    index, on_array, pixel = _centres_in(camera, choice(method, CentreMethod, "method"), planes, largest)
    axes = array_axes(camera)
    turn, origin = axes.parts.array_turn, axes.parts.array_origin
    errors = planes.variance is not None
    grid = resampling(array, index, apart, places=axes.local(on_array), turn=turn, origin=origin, errors=errors)
    own = _in_own_image(camera, array, offsets)
    seen, error = _sampled(planes, pixel, offsets, grid, own)
    if any(place) and not np.isfinite(seen[len(own) // 2, len(own) // 2]).any():
        warn(f"the view from viewpoint {place} is empty: no light passes there; take a place within the iris, -1 to 1")
    elif views is not None and not (own[0].any() or own[-1].any() or own[:, 0].any() or own[:, -1].any()):
        held = max(own.any(axis=0).sum(), own.any(axis=1).sum())
        warn(f"views is {views}, and microlens images hold {held} at this step: the others are empty; take fewer")
    places = grid.mixed(np.column_stack([pixel, on_array]))
    return field_of(camera, seen, error, offsets, grid.origin, grid.spacing, places)


def _checked_camera(
    shot: Exposure, white: Exposure, camera: PlenopticCamera | None
) -> tuple[PlenopticCamera, MicrolensArray]:
    crop_in_white_image(shot, white)
    found = camera_of(shot, camera)
    array = found.microlenses
    if array is None:
        raise InvalidValueError("the camera has no microlenses, and its image is a single view; use shot.image")
    if array.lattice is Lattice.FREE:
        raise InvalidValueError(
            "the microlenses lie on no lattice, and views are interpolated between neighbours on one; read the raw "
            "image at microlens_centres(camera).pixel"
        )
    return found, array


def _check_unfocused(camera: PlenopticCamera, array: MicrolensArray) -> None:
    """Refuse microlenses that show pictures: light of one place of the pupil would fall on pixels of several views."""
    b, pixel = camera.microlenses_to_sensor, camera.sensor.pixel_pitch
    if not array.model.focuses:
        return
    gap = camera.stop_to_microlenses - model_pupil(camera)[0]
    for f in array.focal_lengths_at(camera.wavelength):
        # Between the sharp image of what is far and that of the pupil, which views are pictures of.
        low, high = sorted((b / f - 1.0, b / f - (b / gap if gap else math.inf) - 1.0))
        off = max(low, -high, 0.0)
        if off > _FOCUSED and off * max(array.pitches) > pixel:
            raise InvalidValueError(
                f"the sensor is {b:g} mm behind microlenses of focal length {f:.4g} mm: a focused camera (2.0, "
                f"{kind_of(camera, f).name}), whose microlens images are pictures and no views; use "
                f"pl.lightfield.render_view(shot, white, disparity), or a camera with microlenses_to_sensor={f:.4g}"
            )


def odd_count(views: int) -> int:
    """`views`, or an error."""
    if whole(views, "views", at_least=1, at_most=_MOST_VIEWS) % 2 == 0:
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
        half = odd_count(views) // 2
    else:
        # Half an image of the pupil, or half the distance between images where they overlap.
        image = abs(iris) * b / abs(gap) if math.isfinite(gap) else math.inf
        half = int(min(image, 0.5 * max(array.pitches)) / (pitch * step))
    middle = np.zeros(2)
    if any(viewpoint):
        if not math.isfinite(gap):
            raise InvalidValueError(
                "viewpoint is a place in the exit pupil, which this lens has at infinity; leave it out"
            )
        middle = np.array([viewpoint[0], -viewpoint[1]]) * iris * b / (gap * pitch)
        if np.abs(middle).max() * pitch > max(array.pitches):
            raise InvalidValueError(
                f"viewpoint is {viewpoint}, {np.abs(middle).max():.3g} pixels beside the centres of microlens images, "
                f"which are {max(array.pitches) / pitch:.3g} pixels apart; give a place in the pupil, within -1 to 1"
            )
    return middle[:, None] + step * np.arange(-half, half + 1, dtype=np.float64)


def _centres_in(
    camera: PlenopticCamera, method: CentreMethod, planes: RawArrays, largest: float
) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Lattice indices (n, 2) of the microlenses of whose images the raw image may hold a view, places and pixels."""
    centres = microlens_centres(camera, method, margin=largest * camera.sensor.pixel_pitch)
    first, end = np.array(planes.first), np.array(planes.first) + planes.shot.shape[:2]
    near = ((centres.pixel >= first - largest) & (centres.pixel <= end - 1 + largest)).all(axis=1)
    if not near.any():
        raise InvalidValueError("the image holds no centre of a microlens image; take a larger region")
    return centres.index[near], centres.on_array[near], centres.pixel[near]


def _in_own_image(camera: PlenopticCamera, array: MicrolensArray, offsets: Floats) -> NDArray[np.bool_]:
    """Which offsets (U, V) lie in the image of a microlens's own cell, and not in that of a neighbour."""
    axes = array_axes(camera)
    z, _ = model_pupil(camera)
    apart = 1.0 + camera.microlenses_to_sensor / (camera.stop_to_microlenses - z)
    u, v = np.meshgrid(*offsets, indexing="ij")
    # Columns of the image run towards -x of the sensor.
    turn = axes.parts.sensor_to_local.turn[:2, :2].T @ axes.parts.array_turn
    offset = np.stack([-u, v], axis=-1) * camera.sensor.pixel_pitch @ turn / apart
    return np.asarray((offset @ array.cell_edges[:, :2].T <= array.cell_edges[:, 2]).all(axis=-1))


def _sampled(
    planes: RawArrays, centres: Floats, offsets: Floats, grid: Resampling, own: NDArray[np.bool_]
) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """Views and their standard errors (U, V, rows, columns, C), one view after the other."""
    shape = (*own.shape, grid.rows, grid.columns, planes.shot.shape[2])
    seen = np.full(shape, np.nan, dtype=np.float32)
    error = None if planes.variance is None else np.full(shape, np.nan, dtype=np.float32)
    for i, j in np.argwhere(own):
        radiance, variance = planes.read(centres + np.array([offsets[1, j], offsets[0, i]]))
        # Beside bright edges interpolation swings below 0, where no light can be.
        lowest = min(0.0, np.nanmin(radiance, initial=0.0))
        seen[i, j] = np.maximum(grid.mixed(radiance), lowest)
        if error is not None and variance is not None:
            error[i, j] = np.sqrt(grid.mixed(variance, power=2) + grid.doubt(radiance, variance))
    return seen, error


def field_of(
    camera: PlenopticCamera,
    seen: NDArray[np.float32],
    error: NDArray[np.float32] | None,
    offsets: Floats,
    origin: Floats,
    spacing: tuple[float, float],
    places: Floats,
) -> LightField:
    """The light field of views and their errors, of pixels at places (rows, columns, 4): `pixel`, `on_array`."""
    z, size = model_pupil(camera)
    gap = camera.stop_to_microlenses - z
    with np.errstate(invalid="ignore"):
        # To the right in the image is towards -x on the sensor, and light from there passes the pupil at +x.
        right, down = offsets * camera.sensor.pixel_pitch * gap / camera.microlenses_to_sensor
        at_pupil = np.stack(np.broadcast_arrays(right[:, None], -down[None, :]), axis=-1)
        pupil = at_pupil / (size * camera.lens.stop.semi_diameter)
    focus, larger = plane_in_focus(camera)
    return LightField(
        views=seen,
        standard_error=error,
        u=offsets[0],
        v=offsets[1],
        pixel=places[..., :2],
        on_array=places[..., 2:],
        exit_pupil=at_pupil,
        pupil=pupil if math.isfinite(gap) else np.full(at_pupil.shape, np.nan),
        origin=origin,
        spacing=spacing,
        object_spacing=(spacing[0] * larger, spacing[1] * larger),
        z_focus=focus,
        camera=camera,
    )


def plane_in_focus(camera: PlenopticCamera) -> tuple[float, float]:
    """The plane in focus, and how much larger it is than its image; nan without one in front of the lens."""
    z = object_plane(camera.lens, camera.stop_to_microlenses, camera.wavelength)
    if camera.lens.model is LensModel.NONE or not z < float(camera.lens.vertices[0]):
        return math.nan, math.nan
    scale = lateral_magnification(camera.lens, z, camera.wavelength)
    return z, 1.0 / abs(scale) if scale != 0 else math.inf
