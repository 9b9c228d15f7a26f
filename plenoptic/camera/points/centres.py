"""Centres of the microlens images on the sensor."""

from __future__ import annotations

import dataclasses
import enum
import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.assembly import ArrayAxes, array_axes, sensor_corners
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.model_pupil import model_pupil
from plenoptic.camera.points.centroids import lit_centroids
from plenoptic.camera.points.chief_rays import chief_slopes
from plenoptic.camera.points.white_centroids import white_centroids
from plenoptic.core.progress.bar import CallProgress
from plenoptic.core.values import Floats, check_kind, choice, coordinate, result
from plenoptic.errors import InvalidValueError
from plenoptic.optics.microlens.aperture import Walls
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lenslets import Lenslets

if TYPE_CHECKING:
    from plenoptic.rendering.exposure import Exposure


_ROOM = 0.1
"""Lenses are looked for farther out by this part of the sensor's size, since pupils have aberrations."""
_LEAST_APART = 0.1
"""Where images lie nearer together than this part of the microlenses' distance, the outermost ones are not listed."""


class CentreMethod(enum.IntEnum):
    """Definition of the centre of a microlens image; without vignetting, CHIEF_RAY and CENTROID nearly agree.

    Examples
    --------
    >>> import plenoptic as pl
    >>> [method.name for method in pl.CentreMethod]
    ['ORTHOGONAL', 'CHIEF_RAY', 'CENTROID']
    """

    ORTHOGONAL = 0
    """The microlens's optical centre, projected onto the sensor along the array's normal."""
    CHIEF_RAY = 1
    """Where the ray through the centres of the real iris and of the microlens meets the sensor: the image of the middle
    of the exit pupil."""
    CENTROID = 2
    """The centroid of the light of a uniform white scene that passes the microlens's cell: what a white image shows."""


@result
class MicrolensCentres:
    """Centres of microlens images, one a row. See `microlens_centres`, which finds them.

    Parameters
    ----------
    index : (n, 2) array of int
        Lattice indices (i, j); in FREE lattices (number, 0).
    type : (n,) array of int
        Row of the array's `focal_lengths`.
    on_array : (n, 2) array
        The microlenses' optical centres on the array's plane, x and y in mm; of flat glass, the middle of its opening.
    position, pixel : (n, 2) array
        Centres of their images on the sensor: x and y in mm, and row and column, whole numbers at centres of pixels.
    method : CentreMethod
        Definition of the centres.
    """

    index: NDArray[np.int64]
    type: NDArray[np.int64]
    on_array: Floats
    position: Floats
    pixel: Floats
    method: CentreMethod

    def __len__(self) -> int:
        return len(self.index)

    def __repr__(self) -> str:
        return f"MicrolensCentres({len(self)} microlenses, {self.method.name})"

    def _repr_html_(self) -> str:
        from plenoptic.plots.notebook.pictures import centres_html

        return centres_html(self)


def microlens_centres(
    camera: PlenopticCamera,
    method: CentreMethod = CentreMethod.CHIEF_RAY,
    *,
    white: Exposure | None = None,
    margin: float = 0.0,
    progress: bool = True,
) -> MicrolensCentres:
    """Find the centres of the images of all microlenses that fall onto the sensor.

    Parameters
    ----------
    camera : PlenopticCamera
        With microlenses.
    method : CentreMethod, optional
        ORTHOGONAL, CHIEF_RAY or CENTROID. Under vignetting all three differ; without it, CHIEF_RAY and CENTROID agree
        but for aberrations of the pupil and the fall-off of light across an image.
    white : Exposure, optional
        For CENTROID: a white image of this camera, whose centroids are taken pixel by pixel in place of the geometry;
        microlens images that it does not hold wholly are left out. The light in the cell around each CHIEF_RAY counts:
        that of neighbouring images that overlap with it does, that of its own beyond, as of a missing lens, does not.
    margin : float, optional
        How far outside the sensor centres may lie, in mm; negative: how far inside they must.
    progress : bool, optional
        Whether to show, from the second second on, how far it is or that something is compiled.

    Returns
    -------
    MicrolensCentres
        In the order of their indices. Microlenses that the chief ray, or for CENTROID any light, does not reach are
        left out.

    Raises
    ------
    InvalidValueError
        Without microlenses; where a white image is given for another method than CENTROID or does not fit the camera;
        for CENTROID with walls.

    Notes
    -----
    The chief ray, of the camera's `wavelength`, runs in reverse from the microlens through the middle of the real iris;
    with a lens that is not LensModel.EXACT, through the middle of the pupil of that model. It is traced for some fifty
    fields, more where parts are tilted, and interpolated by a polynomial (to 1e-9 mm for the double Gauss and a fisheye
    up to 20 mm from the axis). In plates (SPHERICAL, FLAT_HIGH_INDEX) it is the ray through
    the vertex of the curved side, which leaves them parallel to itself.

    Centroids are sums over rays from four points of the opening to 32 lines across the pupil, with their ends found by
    bisection; above 1089 microlenses of a type the difference from the chief ray is interpolated between 33 x 33
    fields. Both are good to some 0.01 pixels of 10 micrometres, less well where light ends. Microlenses count there as
    ideal ones between their principal planes, and their aberrations do not. Of openings that differ, each has its own
    centroid, and all have the median of their second moments.

    Deviations of single microlenses (`imperfections`) move their centres, and parts stand as they are built: a lens
    that is displaced, or whose neighbours in a FREE lattice are uneven, is cut by its cell, which stays. Light beside
    the openings of an array with clear gaps counts to the centroid. The optical centre of a missing lens is the middle
    of its opening. Dust and the sensor's response to directions do not count, but in a white image.
    Microlenses between walls (`Walls.OPAQUE`) are cameras of their own: their chief rays run along the array's normal.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.camera.example_camera(pl.CameraKind.PLENOPTIC_1, shape=(64, 64), lattice=pl.Lattice.SQUARE)
    >>> centres = pl.microlens_centres(camera)
    >>> centres.pixel[4].tolist(), (centres.pixel[4] - centres.pixel[3]).round(3).tolist()
    ([31.5, 31.5], [22.01, 0.0])
    """
    check_kind(camera, "camera", PlenopticCamera, "pl.PlenopticCamera(...)")
    method, margin = choice(method, CentreMethod, "method"), coordinate(margin, "margin")
    array = camera.microlenses
    if array is None:
        raise InvalidValueError("the camera has no microlenses, so there are no centres; give it a MicrolensArray")
    if white is not None and method is not CentreMethod.CENTROID:
        raise InvalidValueError(
            f"a white image is given, but {method.name} does not look at it; use CentreMethod.CENTROID or leave it out"
        )
    if array.walls is Walls.OPAQUE and method is CentreMethod.CENTROID:
        raise InvalidValueError(
            "walls end the image of each microlens at its cell, and centroids are not defined for them; take "
            "CentreMethod.CHIEF_RAY"
        )
    with CallProgress("finding centres", kind="camera", show=progress):
        return _centres(camera, array, method, white, margin)


def _centres(
    camera: PlenopticCamera, array: MicrolensArray, method: CentreMethod, white: Exposure | None, margin: float
) -> MicrolensCentres:
    axes = array_axes(camera)
    lenses = _lenses_near_sensor(axes, array, margin)
    if array.model.focuses:
        # Flat glass has no optical axis.
        flat = (lenses.power == 0)[:, None]
        lenses = dataclasses.replace(lenses, axis=np.where(flat, lenses.centre, lenses.axis))
    centres = axes.local(lenses.axis)
    straight = array.walls is Walls.OPAQUE or method is CentreMethod.ORTHOGONAL
    slopes = np.zeros_like(centres) if straight else chief_slopes(axes, centres)
    position = axes.on_sensor(
        array.model.rules.shift_chief_rays(array, centres, slopes, camera.wavelength, True), slopes
    )
    if method is CentreMethod.CENTROID:
        if white is None:
            position = lit_centroids(axes, array, lenses, slopes)
        else:
            position = white_centroids(axes, array, white, lenses.design, position, _images_apart(axes))
    # Rounding must not decide about a centre on the edge.
    limit = 0.5 * np.array(camera.sensor.size[::-1]) + margin + 1e-9 * camera.sensor.pixel_pitch
    with np.errstate(invalid="ignore"):
        inside = (np.abs(position) <= limit).all(axis=1)
    places, pixels = position[inside], camera.sensor.pixel_of(position[inside])
    return MicrolensCentres(lenses.index[inside], lenses.type[inside], lenses.axis[inside], places, pixels, method)


def _images_apart(axes: ArrayAxes) -> float:
    """Distance between neighbouring microlens images over that of the microlenses, by the paraxial exit pupil."""
    array = axes.camera.microlenses
    if array is not None and array.walls is Walls.OPAQUE:
        return 1.0
    gap = axes.parts.z_plane - model_pupil(axes.camera)[0]
    return 1.0 + axes.parts.distance / gap if gap != 0 else math.inf


def _lenses_near_sensor(axes: ArrayAxes, array: MicrolensArray, margin: float) -> Lenslets:
    """Microlenses that can have their images on the sensor: images are farther apart than lenses, or nearer.

    They are nearer where the exit pupil lies behind the array.
    """
    across = axes.parts.local_to_lens.inverse().points(np.array([0.0, 0.0, axes.parts.z_plane]))[:2]
    corners = sensor_corners(axes.camera, axes.parts)[:, :2]
    shrunk = across + (corners - across) / max(_images_apart(axes), _LEAST_APART)
    reached = axes.on_array(np.concatenate([corners, shrunk]))
    low, high = reached.min(axis=0), reached.max(axis=0)
    room = _ROOM * (high - low) + max(array.pitches) + margin * (high - low).max() / (corners.max() - corners.min())
    return array.lenses(low - room, np.maximum(high + room, low - room))
