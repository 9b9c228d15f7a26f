"""Depth from the raw image of a focused plenoptic camera, sub-aperture views, or the pair of dual pixels."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.points.micro_image_grid import MicroImageGrid
from plenoptic.core.display import picture_of
from plenoptic.core.parallel import thread_count
from plenoptic.core.progress.bar import CallProgress
from plenoptic.core.values import Floats, check_kind, numbers, result, whole
from plenoptic.core.warn import warn
from plenoptic.errors import InvalidValueError
from plenoptic.lightfield.epipolar import default_range, depth_of_matches, match_views
from plenoptic.lightfield.grid_camera import CameraAndWhite, camera_and_white, grid_argument
from plenoptic.lightfield.matching.consensus import consensus
from plenoptic.lightfield.matching.image_stack import Matches
from plenoptic.lightfield.matching.match import Matcher, match_images, match_stack
from plenoptic.lightfield.matching.micro_images import MicroImages, image_side, micro_images
from plenoptic.lightfield.matching.pair import DEFAULT_RADIUS, DEFAULT_RANGE, match_pair
from plenoptic.lightfield.pinhole_model import PinholeModel, chord_disparity, object_depths, pinhole_model
from plenoptic.lightfield.raw_arrays import RawArrays, raw_arrays
from plenoptic.lightfield.views import LightField
from plenoptic.readout.well_images import WellImages
from plenoptic.rendering.exposure import Exposure

_VIRTUAL_DEPTHS = (1.8, 25.0)
_LARGEST = 1000.0
_LOW_CONFIDENCE = 0.35
"""Median confidence below which a warning says that the search range may be wrong."""
_LARGEST_RADIUS = 64
"""Largest window radius for pairs of dual pixels."""
_BEYOND, _MANY = 1.03, 0.2
"""Ratio of a disparity to the last one of the search range from which on it lies beyond, and the fraction of such
pixels from which on a warning says so. Refinement reaches beyond by 1.06.
"""


@result
class DepthMap:
    """Depth of each pixel. See `depth`, which returns it.

    Attributes
    ----------
    disparity : (H, W) array
        For a raw image: shift of a point's image between neighbouring microlenses in pixels, as
        `GroundTruth.chord_disparity`. For views: shift along columns in pixels for each pixel of u, as
        `LightField.disparity_at`; for a single column of views without camera, shift along rows for each pixel of v.
        For a pair of dual pixels: `PairGeometry.disparity`. nan where no disparity was found.
    standard_error : (H, W) array
        Standard error of the disparity in pixels, from the residuals of the match and from interpolation, and for a
        raw image from scatter within a window; large where there is no texture.
    confidence : (H, W) array
        Fraction of the compared microlenses or views whose windows resemble that of the pixel, 0 to 1. For a raw
        image, the mean of this over the microlenses that see the point and agree on its depth, times the fraction that
        agree; at most 0.5 if a single one sees it. At most 0.7 within `window_radius` + 1 pixels of a farther surface.
    virtual_depth : (H, W) array
        Pitch / (disparity pixel pitch), negative for images in front of the array; nan for views. With a
        `MicroImageGrid`, the pitch of its micro images counts.
    depth : (H, W) array
        -z in the camera's frame, mm; nan where it is unknown or not in front of the lens, and without a camera.
    """

    disparity: Floats
    standard_error: Floats
    confidence: Floats
    virtual_depth: Floats
    depth: Floats

    def __repr__(self) -> str:
        rows, columns = self.disparity.shape
        return f"DepthMap({rows} x {columns})"

    _repr_html_ = picture_of


def depth(  # noqa: PLR0913
    image: Exposure | LightField | WellImages,
    white: Exposure | MicroImageGrid | None = None,
    *,
    virtual_depth_range: tuple[float, float] | None = None,
    disparity_range: tuple[float, float] | None = None,
    window_radius: int | None = None,
    min_relative_light: float = 0.1,
    matcher: Matcher = match_images,
    camera: PlenopticCamera | MicroImageGrid | None = None,
    threads: int | None = None,
    progress: bool = True,
) -> DepthMap:
    """Estimate depth by matching: micro images of a focused camera (2.0), views (1.0), or pairs of dual pixels.

    Parameters
    ----------
    image : Exposure, LightField or WellImages
        The raw image of a camera with focused microlenses of one or several focal lengths; sub-aperture views, for
        depth of the central one; or the pair of a camera with dual pixels.
    white : Exposure or MicroImageGrid, optional
        The white image or grid, as in `decode`; none for views.
    virtual_depth_range : (float, float), optional
        Virtual depths that are searched in a raw image: from 1 to 1000, or from -1000 to -1 for images in front of the
        array. None: 1.8 to 25 if microlenses of any type are focused behind the array, else -25 to -1.8; with a grid,
        whichever of both finds more.
    disparity_range : (float, float), optional
        Disparities that are searched in views, in pixels. None: -2 to 2, or less if views would move by half of their
        size; -10 to 10 in pairs of dual pixels.
    window_radius : int, optional
        Radius r of the compared windows in pixels: 2 r + 1 on a side. None: 2, and 8 for pairs of dual pixels.
    min_relative_light : float, optional
        Pixels of a raw image are used where the white image has at least this fraction of its 99th percentile.
    matcher : callable, optional
        Another algorithm: called with an `ImageStack` and the numbers of its first and end image, it returns the
        `Matches` (end - first, rows, columns) of these images. It may use the steps `plane_sweep`, `semi_global` and
        `refine`. Threads call it for several blocks of images at a time.
    camera : PlenopticCamera or MicroImageGrid, optional
        The camera, if the raw image does not store it; or the micro images of an unknown one.
    threads : int, optional
        None: one for each processor, at most NUMBA_NUM_THREADS. The result does not depend on it. Views use one.
    progress : bool, optional
        Whether to show the progress, or that something is being compiled, after one second.

    Returns
    -------
    DepthMap
        Depth of the pixels of the raw image, or of the central view. A warning tells if the median confidence of a raw
        image is as low as without the depth of the scene in the range that is searched, or if a fifth of the depths
        lie beyond its end.

    Raises
    ------
    InvalidValueError
        If there are no microlenses on a lattice, if the microlenses of a raw image's camera are focused at infinity,
        if its white image does not fit the camera, as in `decode`, or if a number is out of range.

    Notes
    -----
    Raw images are matched in four steps. The plane sweep (`plane_sweep`) compares planes of constant depth, 6 % of
    virtual depth apart. On each plane, a micro image is compared by normalised correlation with those of up to 18
    microlenses within three pitches, of any focal length. The better half of the correlations counts, since the other
    microlenses may see another surface behind an edge. Each pixel takes the best of all windows that contain it. Of two
    micro images the sharper one is blurred by the difference of their defocus on that plane. Semi-global matching along
    four directions (`semi_global`) makes neighbouring pixels agree (H. Hirschmueller, IEEE Trans. PAMI 30 (2008),
    doi:10.1109/TPAMI.2007.1166). Least squares over the pixels of one depth refine the disparity between the planes
    (`refine`). By consensus, a pixel then takes the depth on which most microlenses that see the point agree.

    No calibration is needed: rays traced through the microlens apertures and the real lens give the displacement of
    each pixel by aberrations and vignetting, also in views, where the slopes of epipolar lines are matched in the same
    way. Interpolation smooths noise, most of all halfway between pixels, and would attract disparities to such places;
    the refinement takes that off.

    A pair of dual pixels is matched with the half discs that are the images of points out of focus, traced at places
    over the sensor: the left image is blurred by those of the right one, and the other way round, for disparities 0.25
    pixels or 5 % apart. Both are then equal at the true one, however strong the blur. Only waves longer than 3.3 pixels
    are compared, since pixels alias finer detail. There is no depth where images blur across the border.

    With a grid, disparity is relative to the centres of micro images: it exceeds that of the camera by the difference
    of their distance and that of microlenses, in pixels. Aberrations of the main lens stay in it, and depth is nan.

    The page docs/depth.md has figures and limits.

    References
    ----------
    C. Perwass and L. Wietzke, Proc. SPIE 8291, 829108 (2012), doi:10.1117/12.909882. S. Wanner and B. Goldluecke, IEEE
    Trans. PAMI 36 (2014), doi:10.1109/TPAMI.2013.147, on views.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> camera = pl.camera.example_camera(shape=(96, 96))
    >>> shot = pl.render(pl.check_scene(), camera, samples=64, progress=False)
    >>> depth_map = pl.lightfield.depth(shot, pl.render_white(camera, samples=16, progress=False))
    >>> depth_map, bool(abs(np.nanmedian(depth_map.depth) - 404) < 2)
    (DepthMap(96 x 96), True)
    """
    is_pair = isinstance(image, WellImages)
    default, largest = (DEFAULT_RADIUS, _LARGEST_RADIUS) if is_pair else (2, 8)
    radius = whole(default if window_radius is None else window_radius, "window_radius", at_least=1, at_most=largest)
    if isinstance(image, WellImages):
        if white is not None or camera is not None or virtual_depth_range is not None or matcher is not match_images:
            raise InvalidValueError("a pair of dual pixels takes disparity_range and window_radius alone")
        disparities = DEFAULT_RANGE if disparity_range is None else _range(disparity_range, "disparity_range")
        matches, depths = match_pair(image, disparities, radius)
        return DepthMap(*matches, np.full(depths.shape, np.nan), depths)
    if isinstance(image, LightField):
        if white is not None or camera is not None:
            raise InvalidValueError("a light field needs neither white nor camera; leave them out")
        if virtual_depth_range is not None:
            raise InvalidValueError("views have no virtual depth; give disparity_range= in pixels")
        disparities = default_range(image) if disparity_range is None else _range(disparity_range, "disparity_range")
        with CallProgress("matching", kind="light field", show=progress):
            matches, depths = depth_of_matches(image, match_views(image, disparities, radius, matcher))
            return DepthMap(*matches, np.full(depths.shape, np.nan), depths)
    check_kind(image, "image", Exposure, "pl.render(scene, camera), a LightField or WellImages")
    if white is None:
        raise InvalidValueError("a raw image needs its white image; give white=pl.render_white(camera)")
    if disparity_range is not None:
        raise InvalidValueError("a raw image is searched by virtual depth; give virtual_depth_range=")
    searches = _searches(image, white, camera, virtual_depth_range)
    geometry, workers = searches[0][0], thread_count(threads)
    raw = raw_arrays(image, geometry.white, min_relative_light, "min_relative_light")
    geometry.check(image)
    with CallProgress("matching", kind="camera", show=progress):
        trials = [_match(each.camera, raw, bounds, radius, matcher, workers) for each, bounds in searches]
        best = max(trials, key=lambda trial: float(np.nan_to_num(trial.matches.confidence).mean()))
        depth_map = _depth_of_raw_image(best, raw)
    if geometry.grid is not None:
        depth_map = dataclasses.replace(depth_map, depth=np.full_like(depth_map.depth, math.nan))
    return depth_map


class _Trial(NamedTuple):
    """Raw image matched within a range of virtual depths."""

    model: PinholeModel
    micro: MicroImages
    matches: Matches


def _match(
    camera: PlenopticCamera,
    raw: RawArrays,
    virtual_depths: tuple[float, float],
    radius: int,
    matcher: Matcher,
    threads: int,
) -> _Trial:
    model = pinhole_model(camera, virtual_depths, threads)
    micro = micro_images(model, raw, virtual_depths, radius)
    matches = match_stack(micro.stack, matcher, threads)
    return _Trial(model, micro, consensus(matches, micro, raw.shot.shape, threads))


def _depth_of_raw_image(trial: _Trial, raw: RawArrays) -> DepthMap:
    """Depth of a raw image: disparities of the pinhole model, converted to chord disparity and to depth."""
    model, micro, matches = trial
    disparity, error, confidence = matches
    _check_range(matches, micro.stack.disparities)
    measured, pitch = np.isfinite(disparity[micro.row, micro.column]), micro.stack.pitch
    lit, lens = (micro.row[measured], micro.column[measured]), micro.lit[0][measured]
    pixel, per_pitch = np.column_stack(lit) + np.array(raw.first), disparity[lit] / pitch
    depths = np.full_like(disparity, np.nan)
    depths[lit] = object_depths(model, pixel, micro.on_array[lens], per_pitch)
    disparity[lit] = pitch * chord_disparity(model, pixel, lens, micro.index, micro.steps, per_pitch)
    with np.errstate(divide="ignore"):
        return DepthMap(disparity, error, confidence, pitch / disparity, depths)


def _check_range(matches: Matches, searched: Floats) -> None:
    """Warn if depth seems to lie outside of the range that is searched, whose planes have disparities (n,)."""
    measured = np.isfinite(matches.disparity)
    disparity, confidence = matches.disparity[measured], matches.confidence[measured]
    if not measured.any():
        return
    beyond = np.mean((disparity < searched.min() / _BEYOND) | (disparity > searched.max() * _BEYOND))
    if np.median(confidence) < _LOW_CONFIDENCE:
        warn(
            f"median confidence {np.median(confidence):.2g}: widen virtual_depth_range, which may not hold the scene, "
            "unless it has little texture, or the image much noise"
        )
    elif beyond > _MANY:
        warn(f"{100 * beyond:.0f} % of the depths lie beyond the end of virtual_depth_range: widen it")


def _searches(
    image: Exposure,
    white: Exposure | MicroImageGrid,
    camera: PlenopticCamera | MicroImageGrid | None,
    bounds: tuple[float, float] | None,
) -> list[tuple[CameraAndWhite, tuple[float, float]]]:
    """Cameras and virtual depths with which a raw image is matched: of a grid, those on either side of the array."""
    low, high = _VIRTUAL_DEPTHS
    ranges = [(low, high), (-high, -low)] if bounds is None else [_virtual_depths(bounds)]
    if grid_argument(white, camera) is not None:
        return [(camera_and_white(image, white, camera, math.copysign(1.0, each[0])), each) for each in ranges]
    geometry = camera_and_white(image, white, camera)
    side = image_side(geometry.camera)
    return [(geometry, ranges[0 if side > 0 else -1])]


def _virtual_depths(bounds: tuple[float, float]) -> tuple[float, float]:
    """Virtual depths that are searched in a raw image, of one sign."""
    low, high = _range(bounds, "virtual_depth_range")
    if not (1.0 < low < high <= _LARGEST or -_LARGEST <= low < high < -1.0):
        raise InvalidValueError(
            f"virtual_depth_range is {bounds!r}; give virtual depths from 1 to {_LARGEST:g}, or from {-_LARGEST:g} to "
            "-1 for images in front of the array"
        )
    return low, high


def _range(bounds: tuple[float, float], name: str) -> tuple[float, float]:
    ends = numbers(bounds, name)
    low, high = ends.tolist() if ends.shape == (2,) else (0.0, 0.0)
    if not -math.inf < low < high < math.inf:
        raise InvalidValueError(f"{name} is {bounds!r}; give two numbers, the smaller one first")
    return low, high
