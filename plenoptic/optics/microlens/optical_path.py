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
from plenoptic.optics.microlens.lenslets import lenses_of
from plenoptic.optics.microlens.model_records import TracedPaths
from plenoptic.optics.microlens.plano_convex import ConvexSide
from plenoptic.optics.microlens.plate_losses import add_losses


def microlens_path(
    array: MicrolensArray, rays: RayBundle, *, reverse: bool = False, point: ArrayLike | None = None
) -> tuple[RayBundle, Floats]:
    """Trace a bundle through microlenses, and compute the optical path length of each ray.

    Parameters
    ----------
    array : MicrolensArray
        Rays pass the lens in whose cell, or opening, they meet it; walls and dust are ignored.
    rays : RayBundle
        In the axes of the array, in mm: x and y as of `array.lenses`, z from its first vertex towards the sensor. In
        front of the array, or with `reverse` behind it.
    reverse : bool, optional
        Towards the scene.
    point : (3,) array, optional
        For THIN lenses, which have no surfaces: common point of all rays, in the same axes. All paths
        from there to its image by one microlens are equal.

    Returns
    -------
    rays : RayBundle
        Rays at the side by which they leave. Those that meet no microlens are lost; the transmission of dark ones
        multiplies the weight, and sides with a coating, in air, take their light.
    path : (n,) array
        Optical path length from the origins to there, mm; negative if an origin lies behind the array; nan for lost
        rays.

    Raises
    ------
    InvalidValueError
        For THIN lenses without a point, rays that do not come from it, or a PINHOLE, which passes one ray of a point.

    Notes
    -----
    FLAT_HIGH_INDEX: a plane with the normals of a sphere shifts the phase as the height s of the sphere would, by
    s (n cos i - n' cos t) with the angles to the axis. If that bracket is the same for all rays, as in parallel
    light, wavefronts are perpendicular to rays; otherwise they deviate by s times its variation.

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
        return _trace(array, rays, source)
    # Light in reverse traverses the mirror image of the array.
    end = array.thickness if array.is_plate else 0.0
    other = ConvexSide.SENSOR if array.convex_side is ConvexSide.SCENE else ConvexSide.SCENE
    mirrored = dataclasses.replace(array, convex_side=other)
    behind, path = _trace(
        mirrored, _mirror(rays, end), None if source is None else source * [1.0, 1.0, -1.0] + [0.0, 0.0, end]
    )
    return _mirror(behind, end), path


def _checked_source(array: MicrolensArray, point: ArrayLike | None) -> Floats | None:
    model = array.model
    if not model.focuses:
        raise InvalidValueError(
            f"a {model.name} passes one ray of a point, straight through its centre; there are no paths to "
            "compare: use the model THIN, or a plate"
        )
    if model.is_plate:
        if point is not None:
            raise InvalidValueError("point is for ideal microlenses, whose paths follow from it; leave it out")
        return None
    if point is None:
        raise InvalidValueError(
            f"an ideal microlens ({model.name}) makes all paths from a point to its image equal, "
            "and defines no path of a single ray; give the point from which the rays come, or use the model SPHERICAL"
        )
    return positions(point, name="point", shape=(3,))


def _mirror(rays: RayBundle, end: float) -> RayBundle:
    """Rays mirrored at z = end / 2."""
    flip = np.array([1.0, 1.0, -1.0])
    columns = {name: getattr(rays, name) for name in ("weight", "status", "lost_at")}
    return RayBundle([0.0, 0.0, end] + flip * rays.origin, flip * rays.direction, rays.wavelength, **columns)


def _trace(array: MicrolensArray, rays: RayBundle, source: Floats | None) -> tuple[RayBundle, Floats]:
    """Trace rays towards +z, and compute their optical path lengths."""
    goes_back = (rays.status == 0) & ~(rays.direction[:, 2] > 0.0)
    status = np.where(goes_back, np.uint8(RayStatus.MISSED), rays.status)
    forward = RayBundle(rays.origin, rays.direction, rays.wavelength, weight=rays.weight, status=status)
    record = forward_record(
        array, turn=np.eye(2), origin=np.zeros(2), reach=_reach(array, forward), wavelength=rays.wavelength
    )
    record = add_losses(record, array, (rays.wavelength,))
    traced = TracedPaths(np.full(len(rays), np.nan), np.empty((len(rays), 5)))
    behind = array.model.refraction.trace_rays(
        forward, traced, record, differs_forward(record), array.index_at(rays.wavelength)
    )
    lost = behind.status != 0
    weight = np.where(lost, 0.0, rays.weight if array.coating is None else behind.weight)
    if array.imperfections is not None:
        index = np.where(lost[:, None], 0, traced.lenses[:, 2:4]).astype(np.int64)
        weight = weight * lenses_of(array, index).transmission
    behind = RayBundle(
        behind.origin, behind.direction, rays.wavelength, weight=weight, status=behind.status, lost_at=rays.lost_at
    )
    return behind, traced.lengths if source is None else _ideal_paths(forward, behind, traced, source)


def _reach(array: MicrolensArray, rays: RayBundle) -> float:
    """Distance in mm from the origin within which lenses must be in the lens table: that of the farthest ray."""
    if array.lattice is Lattice.FREE:
        assert array.centres is not None
        table_reach = 1.01 * float(np.abs(array.centres).max())
    else:
        table_reach = 0.0
    valid = rays.selected(rays.status == 0)
    if not len(valid):
        return table_reach + array.cell_radius
    slope = np.hypot(*valid.direction[:, :2].T) / valid.direction[:, 2]
    lateral = array.thickness * slope if array.is_plate else 0.0
    return max(table_reach, float((np.hypot(*valid.at_z(0.0)[:, :2].T) + lateral).max())) + 2.0 * array.cell_radius


def _ideal_paths(rays: RayBundle, behind: RayBundle, traced: TracedPaths, point: Floats) -> Floats:
    """Optical path lengths of rays from a point, of which each ideal microlens makes an image."""
    passing = np.flatnonzero(behind.status == 0)
    rays_in, rays_out = rays.selected(passing), behind.selected(passing)
    check_from(rays_in, point, 1.0)
    axis, power = traced.lenses[passing, :2], traced.lenses[passing, 4]
    if np.any(-point[2] * power == 1.0):
        raise InvalidValueError(f"the point is in a focal plane, z = {point[2]:g} mm, and has no image; move it")
    principal = np.column_stack([axis, np.zeros(len(passing))])
    lengths = np.full(len(rays), np.nan)
    lengths[passing] = paths_to_image(rays_in, rays_out, point, IdealPlanes(principal, principal, power, 1.0))
    return lengths
