"""Forward tracing: where the light of points lands on the sensor of a camera.

It measures the quantity that `render` measures. For the radiance L of a small emitter of area dA, a pixel has the value

    E = 1/A_pixel  integral over pixel and microlens plane of L cos^4(sensor) / distance^2
      = 1/A_pixel  L  times the etendue, at the sensor, of the rays between emitter and pixel.

Where all refraction is real, etendue is the same at the emitter: dA times cos(theta) dOmega. So E / (L dA) is the
integral of cos(theta) dOmega over the directions that end in the pixel, over the pixel's area. Ideal elements change
etendue; see `optics.microlens.kernels.to_sensor` for their factors. Dust and pixels dim the light as in `render`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.psf.histogram import assembled, spots_of
from plenoptic.camera.psf.sensor_hits import HIT, bending_record, in_lens_axes, landed, measuring_record, tasks_of
from plenoptic.camera.psf.spread import CameraSpread, LandingPoints
from plenoptic.core.parallel import run_in_order, thread_count
from plenoptic.core.progress.bar import CallProgress
from plenoptic.core.values import MAX_POINTS, Floats, check_kind, frozen_array, seed_number, whole
from plenoptic.errors import InvalidValueError


def point_spread(
    camera: PlenopticCamera,
    points: ArrayLike,
    *,
    rays: int = 1 << 18,
    seed: int = 0,
    replicates: int = 32,
    threads: int | None = None,
    progress: bool = True,
) -> CameraSpread:
    """Trace the light of points through lens and microlenses and see where it lands on the sensor.

    The image of a point is the limit of `render`'s image, as the area goes to zero, of a Lambertian emitter that stands
    at the point and faces along the camera's axis, for each unit of radiance and mm^2. The response of the camera's
    pixels (`Sensor.pixel_aperture`, `Sensor.angular_response`) and its `blemishes` count; all light has its
    `wavelength`. Where the camera has `diffraction`, rays bend at their microlenses, and at the iris if that is asked
    for.

    Parameters
    ----------
    camera : PlenopticCamera
    points : (3,) or (n, 3) array
        World positions in mm, in front of the lens.
    rays : int, optional
        Rays of each point, rounded up to a multiple of `replicates`.
    seed : int, optional
        Of the random numbers, at least 0. Each point has its own.
    replicates : int, optional
        Independent scramblings of the sampling points, at least 1; errors come from their spread.
    threads : int, optional
        None: one for each processor, at most NUMBA_NUM_THREADS. The result does not depend on it.
    progress : bool, optional
        Whether to show, from the second second on, how far it is or that something is compiled.

    Returns
    -------
    CameraSpread
        Of one point, or of n points with n as the first length of its arrays. All zero where no light arrives.

    Raises
    ------
    InvalidValueError
        If a point is not finite or does not lie in front of the lens, or a number is out of range; for microlenses
        with the model PINHOLE, through which a point sends no light; with diffraction, where gaps between openings are
        clear.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.camera.example_camera()
    >>> spread = pl.point_spread(camera, (0.0, 0.0, -404.0))
    >>> f"{1e3 * spread.light:.3f} msr"
    '0.982 msr'
    """
    positions, several = _checked_points(camera, points)
    replicates = whole(replicates, "replicates", at_least=1)
    each = -(-whole(rays, "rays", at_least=1) // replicates)
    scrambling, workers = np.uint64(seed_number(seed)), thread_count(threads)
    with CallProgress("tracing points", kind="camera", show=progress):
        record = bending_record(camera)
        tasks = tasks_of(record, in_lens_axes(record, positions), replicates, each)
        spots = dict(spots_of(record, tasks, each, scrambling, workers))
        spread = assembled(camera, positions, spots, replicates, each)
    return spread if several else spread.of(0)


def landing_points(
    camera: PlenopticCamera, points: ArrayLike, *, rays: int = 1 << 12, seed: int = 0, threads: int | None = None
) -> LandingPoints:
    """Single rays of points: where they land on the sensor and through which microlens, such as calibration needs it.

    Rays beside the opening of a pixel (`Sensor.pixel_aperture`) do not land. Those that dust or an opaque microlens
    stops do, with the weight 0. Light does not bend here.

    Parameters
    ----------
    camera, points, seed, threads
        As in `point_spread`, with the same errors.
    rays : int, optional
        Rays of each point; those that land are returned.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.camera.example_camera(pl.CameraKind.CONVENTIONAL)
    >>> landed = pl.camera.landing_points(camera, [(0, 0, -404), (3, 0, -404)], rays=256)
    >>> f"{landed.position[landed.source == 1, 0].mean():.1f} mm"
    '-1.0 mm'
    """
    positions, _ = _checked_points(camera, points)
    each = whole(rays, "rays", at_least=1, at_most=MOST_POINTS)
    scrambling, workers = np.uint64(seed_number(seed)), thread_count(threads)
    record = measuring_record(camera)
    tasks = tasks_of(record, in_lens_axes(record, positions), 1, each)
    hits = list(run_in_order(lambda task: landed(record, task, scrambling).rows, tasks, threads=workers))
    rows = np.concatenate([np.empty(0, HIT), *hits])
    source = np.repeat([task.number for task in tasks], [len(part) for part in hits]).astype(np.int64)
    array = camera.microlenses
    position = np.column_stack([rows["x"], rows["y"]])
    if array is None:
        return LandingPoints(position, rows["weight"] / each, source, None, None)
    index = np.column_stack([rows["first"], rows["second"]])
    microlens = index @ array.basis if array.centres is None else array.centres[index[:, 0]]
    return LandingPoints(position, rows["weight"] / each, source, microlens, index)


def _checked_points(camera: PlenopticCamera, points: ArrayLike) -> tuple[Floats, bool]:
    """The points (n, 3) in the world, and whether there may be several."""
    check_kind(camera, "camera", PlenopticCamera, "pl.PlenopticCamera(...)")
    array = camera.microlenses
    if array is not None and array.model.rules.to_sensor is None:
        raise InvalidValueError(
            f"the microlenses have the model {array.model.name}, and no ray from a point meets a hole without extent; "
            "render a small emitter instead, or choose THIN"
        )
    positions, several = world_points(points)
    if not len(positions):
        raise InvalidValueError("points is empty; give at least one point (x, y, z) in mm")
    return positions, several


def world_points(points: ArrayLike) -> tuple[Floats, bool]:
    """One point or several as an array (n, 3), and whether there may be several."""
    try:
        several = np.ndim(points) != 1
    except ValueError:  # rows of different lengths, which is said below
        several = True
    rows = points if several else np.expand_dims(np.asarray(points), 0)
    positions = frozen_array(rows, name="points", shape=("n", 3))
    if not np.isfinite(positions).all():
        raise InvalidValueError(
            f"points holds {positions[~np.isfinite(positions)][0]}; all coordinates must be finite, in mm"
        )
    return positions, several
