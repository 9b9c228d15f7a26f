"""Depth from a raw image of a focused camera: the images of microlenses are matched against each other."""

from __future__ import annotations

import math

import numpy as np

from plenoptic.camera.assembly import array_axes
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.core.parallel import thread_count
from plenoptic.core.values import Floats, check_kind, numbers, result, whole
from plenoptic.errors import InvalidValueError
from plenoptic.lightfield.calibration import DepthCalibration
from plenoptic.lightfield.estimation import Estimate, agreed, estimated, focused_array
from plenoptic.lightfield.ideal import chords, object_depths
from plenoptic.lightfield.planes import RawPlanes, camera_of, raw_planes, share_of_light
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.rendering.exposure import Exposure


@result
class DepthMap:
    """Depth of each pixel of a raw image, found from it alone. See `depth`, which makes it.

    Attributes
    ----------
    disparity : (H, W) array
        Pixels by which the image of a point moves between neighbouring microlenses, as `GroundTruth.chord_disparity`;
        nan where no microlens image is.
    standard_error : (H, W) array
        Of the disparity, pixels, by the residuals of the match; inf where nothing was matched.
    confidence : (H, W) array
        Share of the neighbouring microlenses in sight of the point that see it at the same depth, 0 to 1.
    virtual_depth : (H, W) array
        Pitch / (disparity pixel pitch); negative for images in front of the array.
    depth : (H, W) array
        -z in the camera's frame, mm: where the rays of the matched pixels meet, traced through the lens; nan where they
        do not in front of it.
    """

    disparity: Floats
    standard_error: Floats
    confidence: Floats
    virtual_depth: Floats
    depth: Floats

    def __repr__(self) -> str:
        rows, columns = self.disparity.shape
        return f"DepthMap({rows} x {columns})"


def depth(
    shot: Exposure,
    white: Exposure,
    *,
    virtual_depths: tuple[float, float] = (1.8, 25.0),
    radius: int = 2,
    calibration: DepthCalibration | None = None,
    least_light: float = 0.1,
    camera: PlenopticCamera | None = None,
    threads: int | None = None,
) -> DepthMap:
    """Find depth in the raw image of a focused plenoptic camera (2.0), by matching the images of its microlenses.

    Parameters
    ----------
    shot, white : Exposure
        As in `decode`.
    virtual_depths : (float, float), optional
        The least and the greatest |v| that are looked for, above 1.
    radius : int, optional
        Of the windows that are compared, in pixels: 2 r + 1 on a side.
    calibration : DepthCalibration, optional
        From `calibrate_depth`, of the same camera and radius. None: what vignetting and defocus displace stays in the
        disparities, some percent where images of points are large.
    least_light : float, optional
        Pixels count where the white image has this part of its 99th percentile.
    camera : PlenopticCamera, optional
        Where the shot names none.
    threads : int, optional
        None: one for each processor, at most NUMBA_NUM_THREADS. The result does not depend on it.

    Returns
    -------
    DepthMap
        Of the pixels of the shot.

    Raises
    ------
    InvalidValueError
        Without microlenses on a lattice, for a camera whose microlenses are focused at infinity, or for a number out of
        range.

    Notes
    -----
    Some 45 planes of constant disparity, 6 % of virtual depth apart, are compared with up to 18 microlenses within
    three pitches, of any focal length: by normalised correlation, of which the better half counts, since the others may
    see something else behind an edge. Paths in four directions through each image make neighbouring pixels agree (H.
    Hirschmueller, IEEE Trans. PAMI 30 (2008), doi:10.1109/TPAMI.2007.1166); least squares find the disparity between
    the planes. Where most microlenses in sight agree on another depth than the pixel's own, it takes theirs.

    References
    ----------
    C. Perwass and L. Wietzke, Proc. SPIE 8291, 829108 (2012), doi:10.1117/12.909882.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> camera = pl.PlenopticCamera(
    ...     lens=pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=5.0)),
    ...     microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)),
    ...     sensor=pl.Sensor(shape=(96, 96), pixel_pitch=0.01), stop_to_microlenses=123.3, microlenses_to_sensor=1.7)
    >>> shot = pl.render(pl.check_scene(), camera, samples=64, progress=False)
    >>> found = pl.lightfield.depth(shot, pl.render_white(camera, samples=16, progress=False))
    >>> found, bool(abs(np.nanmedian(found.depth) - 404) < 4)
    (DepthMap(96 x 96), True)
    """
    planes = raw_planes(shot, white, share_of_light(least_light))
    seen_by = camera_of(shot, camera)
    array = focused_array(seen_by)
    low, high = _checked_range(virtual_depths)
    found = estimated(
        seen_by, planes, (low, high), whole(radius, "radius", at_least=1, at_most=8), thread_count(threads)
    )
    if calibration is not None:
        check_kind(calibration, "calibration", DepthCalibration, "pl.lightfield.calibrate_depth(camera)")
        factor = calibration.factor(found.disparity, found.lenses.type, found.lenses.radius())
        found = found._replace(disparity=found.disparity * factor, error=found.error * factor)
    return _depth_map(seen_by, array, found, planes, thread_count(threads))


def _depth_map(
    camera: PlenopticCamera, array: MicrolensArray, found: Estimate, planes: RawPlanes, threads: int
) -> DepthMap:
    """What was matched, on the raw image: the chord's disparity and depth for the ideal camera's disparity."""
    lenses, axes, ideal = found.lenses, array_axes(camera), found.ideal
    disparity, error, confidence = agreed(found, planes.shot.shape[:2])
    rows, columns = lenses.rows_and_columns()
    lens, y, x = np.nonzero(lenses.images.known)
    row, column = rows[lens, y, 0], columns[lens, 0, x]
    pixel = np.column_stack([row, column]) + np.array(planes.first)
    near = disparity[row, column] / lenses.pitch
    depths = np.full_like(disparity, np.nan)
    depths[row, column] = object_depths(axes, array, pixel, lenses.on_array[lens], near, ideal, threads)
    chord = chords(axes, array, pixel, lenses.index[lens], lenses.steps, near, ideal, threads)
    disparity[row, column] = chord * lenses.pitch
    with np.errstate(divide="ignore"):
        return DepthMap(disparity, error, confidence, lenses.pitch / disparity, depths)


def _checked_range(virtual_depths: tuple[float, float]) -> tuple[float, float]:
    low, high = numbers(virtual_depths, "virtual_depths").tolist() if np.shape(virtual_depths) == (2,) else (0.0, 0.0)
    if not 1.0 < low < high < math.inf:
        raise InvalidValueError(
            f"virtual_depths is {virtual_depths!r}; give two numbers above 1, the smaller one first"
        )
    return low, high
