"""Depth from what a plenoptic camera took: from a raw image of a focused one, or from the views of any other."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.camera.assembly import array_axes
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.core.parallel import thread_count
from plenoptic.core.values import Floats, check_kind, numbers, result, whole
from plenoptic.core.waiting.bar import Waiting
from plenoptic.errors import InvalidValueError
from plenoptic.lightfield.epipolar import default_range, view_depths, view_disparities
from plenoptic.lightfield.micro_image_matching import consensus, image_side, match_micro_images
from plenoptic.lightfield.pinhole_model import chord_disparity, object_depths
from plenoptic.lightfield.raw_arrays import RawArrays, camera_of, raw_arrays, relative_light
from plenoptic.lightfield.views import LightField
from plenoptic.rendering.exposure import Exposure

_VIRTUAL_DEPTHS = (1.8, 25.0)
_FARTHEST = 1000.0


@result
class DepthMap:
    """Depth of each pixel. See `depth`, which makes it.

    Attributes
    ----------
    disparity : (H, W) array
        Of a raw image: pixels by which the image of a point moves between neighbouring microlenses, as
        `GroundTruth.chord_disparity`. Of views: pixels along columns by which it moves for each pixel of u, as
        `LightField.disparity_at`; of a single column of views without camera, along rows for each pixel of v. nan where
        nothing was found.
    standard_error : (H, W) array
        Of the disparity, pixels, by the residuals of the match; large where there is no texture.
    confidence : (H, W) array
        Share of the microlenses or views compared whose windows resemble that of the pixel, 0 to 1; of a raw image,
        times the share of the neighbouring microlenses that find the same depth where they see the point.
    virtual_depth : (H, W) array
        Pitch / (disparity pixel pitch), negative for images in front of the array; nan of views.
    depth : (H, W) array
        -z in the camera's frame, mm; nan where it does not lie in front of the lens, or is not known.
    """

    disparity: Floats
    standard_error: Floats
    confidence: Floats
    virtual_depth: Floats
    depth: Floats

    def __repr__(self) -> str:
        rows, columns = self.disparity.shape
        return f"DepthMap({rows} x {columns})"

    def _repr_html_(self) -> str:
        from plenoptic.plots.notebook.pictures import depth_map_html

        return depth_map_html(self)


def depth(  # noqa: PLR0913
    seen: Exposure | LightField,
    white: Exposure | None = None,
    *,
    between: tuple[float, float] | None = None,
    radius: int = 2,
    least_light: float = 0.1,
    camera: PlenopticCamera | None = None,
    threads: int | None = None,
    progress: bool = True,
) -> DepthMap:
    """Find depth by matching: images of microlenses of a focused camera (2.0), or views (1.0).

    Parameters
    ----------
    seen : Exposure or LightField
        The raw image of a camera with focused microlenses, of one or several focal lengths; or views, of which the
        central one gets depth.
    white : Exposure, optional
        The white image, as in `decode`; views have none.
    between : (float, float), optional
        What is looked for. Of a raw image, virtual depths from 1 to 1000, or from -1000 to -1 for images in front of
        the array: 1.8 to 25 by default where microlenses of any type are focused on what lies behind it, else -25 to
        -1.8. Of views, the least and the greatest disparity: -2 to 2 pixels, less where views would move by half of
        their size.
    radius : int, optional
        Of the windows that are compared, in pixels: 2 r + 1 on a side.
    least_light : float, optional
        Pixels of a raw image count where the white image has this part of its 99th percentile.
    camera : PlenopticCamera, optional
        Where the raw image names none.
    threads : int, optional
        None: one for each processor, at most NUMBA_NUM_THREADS. The result does not depend on it. Views take one.
    progress : bool, optional
        Whether to show, from the second second on, how far it is or that something is compiled.

    Returns
    -------
    DepthMap
        Of the pixels of the raw image, or of a view.

    Raises
    ------
    InvalidValueError
        Without microlenses on a lattice, for the raw image of a camera whose microlenses are focused at infinity, or
        for a number out of range.

    Notes
    -----
    A raw image: planes of constant depth, 6 % of virtual depth apart, are compared with up to 18 microlenses within
    three pitches, of any focal length, by normalised correlation, of which the better half counts, since the others may
    see something else behind an edge; of all windows that hold a pixel, the best one counts. Of two microlenses the
    sharper one is blurred by what the camera blurs a point of that plane more in the other. Paths in four directions
    through each image make neighbouring pixels agree (H. Hirschmueller, IEEE Trans. PAMI 30 (2008),
    doi:10.1109/TPAMI.2007.1166); least squares over the pixels of one depth find the disparity between the planes.
    Where most microlenses in sight agree on another depth than the pixel's own, it takes theirs.

    Nothing is calibrated: rays through the openings of the microlenses and the real lens tell how far aberrations and
    vignetting displace what each pixel shows of a plane. In views it is the slopes of epipolar lines that are matched,
    in the same way.

    The page docs/depth.md has figures and limits.

    References
    ----------
    C. Perwass and L. Wietzke, Proc. SPIE 8291, 829108 (2012), doi:10.1117/12.909882. S. Wanner and B. Goldluecke, IEEE
    Trans. PAMI 36 (2014), doi:10.1109/TPAMI.2013.147: views.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> camera = pl.PlenopticCamera(
    ...     lens=pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=5.0)),
    ...     microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)),
    ...     sensor=pl.Sensor(shape=(96, 96), pixel_pitch=0.01), stop_to_microlenses=123.3, microlenses_to_sensor=1.7)
    >>> shot = pl.render(pl.check_scene(), camera, samples=64, progress=False)
    >>> found = pl.lightfield.depth(shot, pl.render_white(camera, samples=16, progress=False))
    >>> found, bool(abs(np.nanmedian(found.depth) - 404) < 2)
    (DepthMap(96 x 96), True)
    """
    reach = whole(radius, "radius", at_least=1, at_most=8)
    if isinstance(seen, LightField):
        if white is not None or camera is not None:
            raise InvalidValueError("a light field needs neither white nor camera; leave them out")
        with Waiting("matching", kind="light field", show=progress):
            return _of_views(seen, default_range(seen) if between is None else _range(between), reach)
    check_kind(seen, "seen", Exposure, "pl.render(scene, camera), or a LightField")
    if white is None:
        raise InvalidValueError("a raw image needs its white image; give white=pl.render_white(camera)")
    planes, found = raw_arrays(seen, white, relative_light(least_light)), camera_of(seen, camera)
    with Waiting("matching", kind="camera", show=progress):
        return _of_raw(found, planes, _virtual_depths(found, between), reach, thread_count(threads))


def _of_views(field: LightField, between: tuple[float, float], radius: int) -> DepthMap:
    disparity, error, confidence = view_disparities(field, between, radius)
    return DepthMap(disparity, error, confidence, np.full(disparity.shape, np.nan), view_depths(field, disparity))


def _of_raw(
    camera: PlenopticCamera, planes: RawArrays, between: tuple[float, float], radius: int, threads: int
) -> DepthMap:
    """What is matched in the ideal camera, as the chord's disparity and as depth."""
    axes = array_axes(camera)
    found = match_micro_images(axes, planes, between, radius, threads)
    lenses, array, ideal = found.lenses, axes.camera.microlenses, found.ideal
    assert array is not None
    disparity, error, confidence = consensus(found, planes.shot.shape)
    rows, columns = lenses.rows_and_columns()
    lens, y, x = np.nonzero(lenses.images.known)
    row, column = rows[lens, y, 0], columns[lens, 0, x]
    pixel, near = np.column_stack([row, column]) + np.array(planes.first), disparity[row, column] / lenses.pitch
    depths = np.full_like(disparity, np.nan)
    depths[row, column] = object_depths(axes, array, pixel, lenses.on_array[lens], near, ideal, threads)
    chord = chord_disparity(axes, array, pixel, lenses.index[lens], lenses.steps, near, ideal, threads)
    disparity[row, column] = chord * lenses.pitch
    with np.errstate(divide="ignore"):
        return DepthMap(disparity, error, confidence, lenses.pitch / disparity, depths)


def _virtual_depths(camera: PlenopticCamera, given: tuple[float, float] | None) -> tuple[float, float]:
    """What is looked for in a raw image, of one sign."""
    low, high = _VIRTUAL_DEPTHS
    if given is None:
        return (low, high) if image_side(camera) > 0 else (-high, -low)
    low, high = _range(given)
    if not (1.0 < low < high <= _FARTHEST or -_FARTHEST <= low < high < -1.0):
        raise InvalidValueError(
            f"between is {given!r}; give virtual depths from 1 to {_FARTHEST:g}, or from {-_FARTHEST:g} to -1 for "
            "images in front of the array"
        )
    return low, high


def _range(given: tuple[float, float]) -> tuple[float, float]:
    low, high = numbers(given, "between").tolist() if np.shape(given) == (2,) else (0.0, 0.0)
    if not -math.inf < low < high < math.inf:
        raise InvalidValueError(f"between is {given!r}; give two numbers, the smaller one first")
    return low, high
