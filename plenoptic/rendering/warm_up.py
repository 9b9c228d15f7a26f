"""Compilation, in advance, of the kernels for a scene and a camera."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import time
import warnings
from typing import TYPE_CHECKING

import numpy as np

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.checks import check_scene_and_camera
from plenoptic.camera.gaussian import object_plane
from plenoptic.camera.points.centres import microlens_centres
from plenoptic.camera.points.projection import project
from plenoptic.camera.psf.point_spread import point_spread
from plenoptic.core.progress.bar import CallProgress
from plenoptic.core.progress.compiling import compiling
from plenoptic.core.values import Floats, value
from plenoptic.errors import InvalidValueError
from plenoptic.rendering.render import render, render_white
from plenoptic.truth.channels import Truth
from plenoptic.truth.ground_truth import ground_truth
from plenoptic.truth.truth_arrays import available_truth, valid_truth

if TYPE_CHECKING:
    from plenoptic.optics.microlens.array import MicrolensArray
    from plenoptic.scene.scene import Scene

_HALF = 16
"""Half side in pixels of the rendered square: a micro image with its rim."""
_FAR = 1e3
"""Distance of the projected point in mm, without a plane in focus."""
_IMAGES = 4
"""Micro images on a side of the sensor from which depth is estimated."""


@value
class WarmUp:
    """Kernels compiled by `warm_up`, and its duration.

    Parameters
    ----------
    kernels : tuple of str
        Names of the functions compiled by this process, in order; helper processes compile further ones.
    seconds : float
        Duration in s.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.rendering.WarmUp((), 0.2)
    nothing was to be compiled (0.2 s)
    """

    kernels: tuple[str, ...]
    seconds: float

    def __repr__(self) -> str:
        if not self.kernels:
            return f"nothing was to be compiled ({self.seconds:.2g} s)"
        first = ", ".join(self.kernels[:3])
        more = f" and {len(self.kernels) - 3} more" if len(self.kernels) > 3 else ""
        return f"compiled in {self.seconds:.2g} s: {first}{more}"


def warm_up(
    scene: Scene | None,
    camera: PlenopticCamera,
    *,
    truth: Truth = Truth.ALL,
    depth: bool = False,
    progress: bool = True,
) -> WarmUp:
    """Compile the kernels of renders, ground truth and projections of a scene and a camera.

    Each is run for few pixels. Compiled code is stored on disk, so that other processes, too, render such scenes
    without delay. It depends only on the kinds of materials, lights, stops and microlenses, not on sizes and sample
    numbers. Renders that exclude caustics or clamp compile a few more kernels.

    Parameters
    ----------
    scene : Scene or None
        None: kernels of white images.
    camera : PlenopticCamera
    truth : Truth, optional
        The ground truth that will be requested.
    depth : bool, optional
        Whether views and depth will be computed from the raw image too.
    progress : bool, optional
        Whether to show that something is being compiled.

    Returns
    -------
    WarmUp

    Raises
    ------
    InvalidValueError
        If an argument has another type.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.camera.example_camera()
    >>> done = pl.warm_up(pl.check_scene(), camera, progress=False)
    >>> pl.warm_up(pl.check_scene(), camera, progress=False).kernels
    ()
    """
    check_scene_and_camera(scene, camera)
    requested = valid_truth(truth)
    begin, before = time.perf_counter(), len(compiling.names)
    with CallProgress("warming up", kind="scene", show=progress), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # few pixels may be dark or miss the scene
        _run_small(scene, camera, requested)
        if depth and scene is not None and camera.microlenses is not None:
            _estimate_depth(scene, camera, camera.microlenses)
    return WarmUp(tuple(compiling.names[before:]), time.perf_counter() - begin)


def _run_small(scene: Scene | None, camera: PlenopticCamera, truth: Truth) -> None:
    """Run everything once, for the centre of the sensor and for one point."""
    rows, columns = (slice(max(n // 2 - _HALF, 0), n // 2 + _HALF) for n in camera.sensor.shape)
    array, meshes = camera.microlenses, False
    render_white(camera, samples=2, region=(rows, columns), progress=False)
    if scene is not None:
        render(scene, camera, samples=2, region=(rows, columns), truth=truth, progress=False)
        meshes = bool(scene.meshes)
    if available := available_truth(truth, meshes=meshes, microlenses=array is not None):
        ground_truth(scene, camera, truth=available, region=(rows, columns))
    if array is not None:
        microlens_centres(camera)
    project(camera, point := _point(camera), scene=scene, rays=32)
    if array is None or array.model.focuses:
        point_spread(camera, point, rays=32)


def _estimate_depth(scene: Scene, camera: PlenopticCamera, array: MicrolensArray) -> None:
    """Compute views and depth from a few micro images, if the camera has any."""
    from plenoptic import lightfield

    sensor = camera.sensor
    side = math.ceil(_IMAGES * max(array.pitches) / sensor.pixel_pitch)
    shape = min(sensor.shape[0], side), min(sensor.shape[1], side)
    small = dataclasses.replace(camera, sensor=dataclasses.replace(sensor, shape=shape))
    white = render_white(small, samples=2, progress=False)
    shot = render(scene, small, samples=2, progress=False)
    # Unfocused cameras have sub-aperture views; focused ones depth of their raw image.
    with contextlib.suppress(InvalidValueError):
        lightfield.depth(lightfield.decode(shot, white), progress=False)
    with contextlib.suppress(InvalidValueError):
        depth = lightfield.depth(shot, white, progress=False)
        disparity = np.where(np.isfinite(depth.disparity), depth.disparity, 0.2 * side / _IMAGES)
        lightfield.render_view(shot, white, disparity, progress=False)


def _point(camera: PlenopticCamera) -> Floats:
    """Point (3,) of the world on the axis, on the plane in focus if that lies in front of the lens."""
    z, front = object_plane(camera.lens, camera.stop_to_microlenses, camera.wavelength), float(camera.lens.vertices[0])
    point = np.array([0.0, 0.0, z if -math.inf < z < front else front - _FAR])
    return point if camera.pose is None else camera.pose.to_world(point[None])[0]
