"""Point-spread function of a camera by forward tracing.

It measures the same quantity as `render`. For the radiance L of a small emitter of area dA, the value of a pixel is

    E = 1/A_pixel  integral over pixel and microlens plane of L cos^4(sensor) / distance^2
      = 1/A_pixel  L  times the etendue, at the sensor, of the rays between emitter and pixel.

Real refraction conserves etendue, which is dA cos(theta) dOmega at the emitter. So E / (L dA) is the integral of
cos(theta) dOmega over the directions that end in the pixel, over the pixel's area. Ideal elements change etendue; see
`optics.microlens.kernels.to_sensor` for their factors. Dust and pixels attenuate the light as in `render`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.camera.psf.psf_results import (
    CameraSpread,
    LandingPoints,
    add_spots,
    dark_spot,
    to_camera_spread,
    trace_spots,
)
from plenoptic.camera.psf.sensor_hits import (
    HIT,
    diffraction_record,
    in_lens_axes,
    radiometric_record,
    ray_tasks,
    trace_task,
)
from plenoptic.core.parallel import run_in_order, thread_count
from plenoptic.core.progress.bar import CallProgress
from plenoptic.core.values import MAX_POINTS, Floats, check_has, frozen_array, seed_number, whole
from plenoptic.errors import InvalidValueError

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.optics.lens.ghosts.ghost_settings import Ghosts

_MAX_REPLICATES = 1 << 16


def point_spread(
    camera: PlenopticCamera,
    points: ArrayLike,
    *,
    rays: int = 1 << 18,
    seed: int = 0,
    replicates: int = 32,
    ghosts: Ghosts | None = None,
    threads: int | None = None,
    progress: bool = True,
) -> CameraSpread:
    """Compute the point-spread function of points by tracing their light through lens and microlenses.

    The image of a point is the limit, for a vanishing area, of the image by `render` of a Lambertian emitter at
    the point that faces along the camera's axis, per unit of radiance and mm^2. The response of pixels
    (`Sensor.pixel_aperture`, `Sensor.angular_response`) and `blemishes` are included; all light has the camera's
    `wavelength`. With `diffraction`, rays are deflected at their microlenses, and at the iris if that is enabled.

    Parameters
    ----------
    camera : PlenopticCamera
    points : (3,) or (n, 3) array
        World positions in mm, in front of the lens.
    rays : int, optional
        Rays per point, rounded up to a multiple of `replicates`.
    seed : int, optional
        Seed of the random numbers, at least 0. Each point has independent ones.
    replicates : int, optional
        Independent scramblings of the sampling points, at least 1, for the standard error.
    ghosts : Ghosts, optional
        Adds the light that two surfaces of the lens reflect, without diffraction, by as many rays again, which all
        pairs of surfaces share; `fates` and `fractions` remain those of the image. None: no ghosts.
    threads, progress : optional
        As for `render`. The result does not depend on them.

    Returns
    -------
    CameraSpread
        For one point, or for n points with n as the first dimension of its arrays. All zero if no light arrives.

    Raises
    ------
    InvalidValueError
        If a point is not finite or not in front of the lens, or a number is out of range; for microlenses with the
        model PINHOLE, which transmit no light of a point; for diffraction with clear gaps between openings.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.camera.example_camera()
    >>> spread = pl.point_spread(camera, (0.0, 0.0, -404.0))
    >>> f"{1e3 * spread.light:.3f} msr"
    '0.982 msr'
    """
    world, is_batch = _checked_points(camera, points)
    replicates = whole(replicates, "replicates", at_least=1, at_most=_MAX_REPLICATES)
    rays_per_replicate = -(-whole(rays, "rays", at_least=1) // replicates)
    scrambling, workers = np.uint64(seed_number(seed)), thread_count(threads)
    if ghosts is not None:
        from plenoptic.optics.lens.ghosts.ghost_settings import checked_ghosts

        checked_ghosts(ghosts, "ghosts")
    with CallProgress("tracing points", kind="camera", show=progress):
        record = diffraction_record(camera)
        tasks = ray_tasks(record, in_lens_axes(record, world), replicates, rays_per_replicate)
        spots = dict(trace_spots(record, tasks, rays_per_replicate, scrambling, workers))
        if ghosts is not None:
            from plenoptic.camera.psf.ghost_spread import ghost_spots  # few points have ghosts

            rays_of_each = replicates, rays_per_replicate
            for number, spot in ghost_spots(camera, ghosts, world, rays_of_each, scrambling, workers).items():
                spots[number] = add_spots(spots.get(number, dark_spot(record, replicates)), spot)
        spread = to_camera_spread(camera, world, spots, replicates, rays_per_replicate)
    return spread if is_batch else spread.of(0)


def landing_points(
    camera: PlenopticCamera, points: ArrayLike, *, rays: int = 1 << 12, seed: int = 0, threads: int | None = None
) -> LandingPoints:
    """Trace single rays of points to the sensor: intersections and microlenses, for calibration.

    Rays outside the sensitive area of a pixel (`Sensor.pixel_aperture`) are lost. Rays stopped by dust or an opaque
    microlens have the weight 0. Diffraction is ignored.

    Parameters
    ----------
    camera, points, seed, threads
        As in `point_spread`, with the same errors.
    rays : int, optional
        Rays per point; those that reach the sensor are returned.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.camera.example_camera(pl.CameraKind.CONVENTIONAL)
    >>> landed = pl.camera.landing_points(camera, [(0, 0, -404), (3, 0, -404)], rays=256)
    >>> f"{landed.position[landed.source == 1, 0].mean():.1f} mm"
    '-1.0 mm'
    """
    world, _ = _checked_points(camera, points)
    rays_per_replicate = whole(rays, "rays", at_least=1, at_most=MAX_POINTS)
    scrambling, workers = np.uint64(seed_number(seed)), thread_count(threads)
    record = radiometric_record(camera)
    tasks = ray_tasks(record, in_lens_axes(record, world), 1, rays_per_replicate)
    hits = list(run_in_order(lambda task: trace_task(record, task, scrambling).rows, tasks, threads=workers))
    rows = np.concatenate([np.empty(0, HIT), *hits])
    source = np.repeat([task.number for task in tasks], [len(part) for part in hits]).astype(np.int64)
    array = camera.microlenses
    position = np.column_stack([rows["x"], rows["y"]])
    if array is None:
        return LandingPoints(position, rows["weight"] / rays_per_replicate, source, None, None)
    index = np.column_stack([rows["first"], rows["second"]])
    microlens = index @ array.basis if array.centres is None else array.centres[index[:, 0]]
    return LandingPoints(position, rows["weight"] / rays_per_replicate, source, microlens, index)


def check_focusing(camera: PlenopticCamera) -> None:
    """Raise an InvalidValueError for microlenses through which no light of a point passes."""
    array = camera.microlenses
    if array is not None and not array.model.focuses:
        raise InvalidValueError(
            f"the microlenses have the model {array.model.name}, and no ray from a point meets a hole without extent; "
            "render a small emitter instead, or choose THIN"
        )


def _checked_points(camera: PlenopticCamera, points: ArrayLike) -> tuple[Floats, bool]:
    """Points (n, 3) in the world, and True if the argument is an array of points."""
    check_has(camera, "camera", "PlenopticCamera", "pl.PlenopticCamera(...)", "lens", "sensor")
    check_focusing(camera)
    world, is_batch = world_points(points)
    if not len(world):
        raise InvalidValueError("points is empty; give at least one point (x, y, z) in mm")
    return world, is_batch


def world_points(points: ArrayLike) -> tuple[Floats, bool]:
    """Points (n, 3) in the world, and True if the argument is an array of points rather than one."""
    try:
        is_batch = np.ndim(points) != 1
    except ValueError:  # rows of different lengths: the error follows below
        is_batch = True
    rows = points if is_batch else np.expand_dims(np.asarray(points), 0)
    world = frozen_array(rows, name="points", shape=("n", 3))
    if not np.isfinite(world).all():
        raise InvalidValueError(f"points holds {world[~np.isfinite(world)][0]}; all coordinates must be finite, in mm")
    return world, is_batch
