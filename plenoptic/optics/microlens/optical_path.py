"""Optical path lengths of rays through microlenses."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.rays import RayBundle, RayStatus
from plenoptic.core.values import Floats, check_kind, positions
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.optical_path import IdealPlanes, check_from, paths_to_image
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.forward_record import differs_forward, forward_record
from plenoptic.optics.microlens.lattice import Lattice
from plenoptic.optics.microlens.listed import lenses_of
from plenoptic.optics.microlens.model_rules import FoundPaths
from plenoptic.optics.microlens.plano_convex import ConvexSide


def microlens_path(
    array: MicrolensArray, rays: RayBundle, *, reverse: bool = False, point: ArrayLike | None = None
) -> tuple[RayBundle, Floats]:
    """Trace a bundle through microlenses, and tell how long the way of each ray is, times the refractive index.

    Parameters
    ----------
    array : MicrolensArray
        Rays pass the lens in whose cell, or opening, they meet it; walls behind it and dust are left out.
    rays : RayBundle
        In the axes of the array, in mm: x and y as of `array.lenses`, z from its first vertex towards the sensor. In
        front of the array, or with `reverse` behind it.
    reverse : bool, optional
        Towards the scene.
    point : (3,) array, optional
        For THIN lenses, which have no surfaces: the point through which all rays come, in the same axes. All paths
        from there to its image by one microlens are equal.

    Returns
    -------
    rays : RayBundle
        They stand on the side by which they leave. Those that meet no microlens are lost, and the transmission of a
        dark one multiplies their weight.
    path : (n,) array
        From the origins given to there, mm; negative where an origin lies behind the array; nan for lost rays.

    Raises
    ------
    InvalidValueError
        THIN lenses without a point, rays that do not come from it, or a PINHOLE, which lets one ray of a point pass.

    Notes
    -----
    FLAT_HIGH_INDEX: a plane with the normals of a sphere shifts the phase as the height s of the sphere would, by
    s (n cos i - n' cos t) with the angles to the axis. Where that bracket is the same for all rays, as in parallel
    light, wavefronts are perpendicular to rays; otherwise they are off by s times its change.

    Examples
    --------
    >>> import plenoptic as pl
    >>> array = pl.MicrolensArray(pitch=0.2, focal_lengths=(2.0,), model=pl.optics.MicrolensModel["SPHERICAL"])
    >>> behind, path = pl.aberrations.microlens_path(array, pl.RayBundle([[0, 0, -1.0]], [[0, 0, 1.0]]))
    >>> bool(abs(path[0] - (1.0 + 1.5 * 0.1)) < 1e-15)
    True
    """
    check_kind(array, "array", MicrolensArray, "pl.MicrolensArray(pitch=0.2, focal_lengths=(2.0,))")
    check_kind(rays, "rays", RayBundle, "pl.RayBundle([[0, 0, -1]], [[0, 0, 1]])")
    source = _checked_source(array, point)
    if not reverse:
        return _through(array, rays, source)
    # Light that goes back sees the array in a mirror.
    end = array.thickness if array.is_plate else 0.0
    other = ConvexSide.SENSOR if array.convex_side is ConvexSide.SCENE else ConvexSide.SCENE
    turned = dataclasses.replace(array, convex_side=other)
    behind, path = _through(
        turned, _mirrored(rays, end), None if source is None else source * [1.0, 1.0, -1.0] + [0.0, 0.0, end]
    )
    return _mirrored(behind, end), path


def _checked_source(array: MicrolensArray, point: ArrayLike | None) -> Floats | None:
    model = array.model
    if model.rules.passed is None:
        raise InvalidValueError(
            f"a {model.name} lets one ray of a point pass, through its centre, straight on; there are no paths to tell "
            "apart: use the model THIN, or a plate"
        )
    if model.is_plate:
        if point is not None:
            raise InvalidValueError("point is for ideal microlenses, whose paths follow from it; leave it out")
        return None
    if point is None:
        raise InvalidValueError(
            f"an ideal microlens ({model.name}) makes all paths from a point to its image equal, and says nothing of a "
            "ray by itself; give the point from which the rays come, or use the model SPHERICAL"
        )
    return positions(point, name="point", shape=(3,))


def _mirrored(rays: RayBundle, end: float) -> RayBundle:
    """With z from the other side."""
    flip = np.array([1.0, 1.0, -1.0])
    where = {name: getattr(rays, name) for name in ("weight", "status", "lost_at")}
    return RayBundle([0.0, 0.0, end] + flip * rays.origin, flip * rays.direction, rays.wavelength, **where)


def _through(array: MicrolensArray, rays: RayBundle, source: Floats | None) -> tuple[RayBundle, Floats]:
    """Rays towards +z."""
    turned_back = (rays.status == 0) & ~(rays.direction[:, 2] > 0.0)
    status = np.where(turned_back, np.uint8(RayStatus.MISSED), rays.status)
    given = RayBundle(rays.origin, rays.direction, rays.wavelength, weight=rays.weight, status=status)
    record = forward_record(
        array, turn=np.eye(2), origin=np.zeros(2), reach=_reach(array, given), wavelength=rays.wavelength
    )
    found = FoundPaths(np.full(len(rays), np.nan), np.empty((len(rays), 5)))
    passed = array.model.rules.passed
    assert passed is not None
    behind = passed(given, found, record, differs_forward(record), array.index_at(rays.wavelength))
    lost = behind.status != 0
    weight = np.where(lost, 0.0, rays.weight)
    if array.imperfections is not None:
        index = np.where(lost[:, None], 0, found.lenses[:, 2:4]).astype(np.int64)
        weight = weight * lenses_of(array, index).transmission
    behind = RayBundle(
        behind.origin, behind.direction, rays.wavelength, weight=weight, status=behind.status, lost_at=rays.lost_at
    )
    return behind, found.lengths if source is None else _ideal(given, behind, found, source)


def _reach(array: MicrolensArray, rays: RayBundle) -> float:
    """Largest distance from the origin, in mm, at which rays meet the array: listed lenses must reach as far."""
    if array.lattice is Lattice.FREE:
        assert array.centres is not None
        listed = 1.01 * float(np.abs(array.centres).max())
    else:
        listed = 0.0
    kept = rays.selected(rays.status == 0)
    if not len(kept):
        return listed + array.cell_radius
    slope = np.hypot(*kept.direction[:, :2].T) / kept.direction[:, 2]
    aside = array.thickness * slope if array.is_plate else 0.0
    return max(listed, float((np.hypot(*kept.at_z(0.0)[:, :2].T) + aside).max())) + 2.0 * array.cell_radius


def _ideal(rays: RayBundle, behind: RayBundle, found: FoundPaths, point: Floats) -> Floats:
    """Each microlens has an image of the point of its own."""
    passing = np.flatnonzero(behind.status == 0)
    kept, left = rays.selected(passing), behind.selected(passing)
    check_from(kept, point, 1.0)
    axis, power = found.lenses[passing, :2], found.lenses[passing, 4]
    if np.any(-point[2] * power == 1.0):
        raise InvalidValueError(f"the point is in a focal plane, z = {point[2]:g} mm, and has no image; move it")
    principal = np.column_stack([axis, np.zeros(len(passing))])
    lengths = np.full(len(rays), np.nan)
    lengths[passing] = paths_to_image(kept, left, point, IdealPlanes(principal, principal, power, 1.0))
    return lengths
