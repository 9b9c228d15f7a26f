"""Compilation ahead for a scene and a camera."""

from __future__ import annotations

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
from plenoptic.camera.report.optics import object_plane
from plenoptic.core.progress.bar import CallProgress
from plenoptic.core.progress.compiling import compiling
from plenoptic.core.values import Floats, value
from plenoptic.rendering.render import render, render_white
from plenoptic.truth.channels import Truth
from plenoptic.truth.ground_truth import ground_truth
from plenoptic.truth.truth_arrays import available_truth, valid_truth

if TYPE_CHECKING:
    from plenoptic.scene.scene import Scene

_HALF = 16
"""Half of the pixels along the square that is rendered: a microlens image with its rim, where light is looked for."""
_FAR = 1e3
"""Distance of a point in mm, where no plane is in focus."""


@value
class WarmUp:
    """Kernels and time of a `warm_up`.

    Parameters
    ----------
    kernels : tuple of str
        Names of the functions that this process has compiled, in order; helpers on other processors compile further.
    seconds : float
        How long it took.

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


def warm_up(scene: Scene | None, camera: PlenopticCamera, *, truth: Truth = Truth.ALL, progress: bool = True) -> WarmUp:
    """Compile the kernels of renders, ground truth and projections of a scene and a camera, by running each for few
    pixels.

    Compiled code is kept on disk: afterwards other processes, too, render such scenes without waiting. It
    depends on the kind of scene and camera only (which materials, lights, stops and microlenses there are), not on
    sizes and numbers of samples. Where a render leaves caustics out or clamps, a few kernels are compiled then.

    Parameters
    ----------
    scene : Scene or None
        None: the kernels of white images.
    camera : PlenopticCamera
    truth : Truth, optional
        The ground truth that will be asked for.
    progress : bool, optional
        Whether to show that something is compiled.

    Returns
    -------
    WarmUp

    Raises
    ------
    InvalidValueError
        Where an argument is something else.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.camera.example_camera()
    >>> done = pl.warm_up(pl.check_scene(), camera, progress=False)
    >>> pl.warm_up(pl.check_scene(), camera, progress=False).kernels
    ()
    """
    check_scene_and_camera(scene, camera)
    asked = valid_truth(truth)
    begin, before = time.perf_counter(), len(compiling.names)
    with CallProgress("warming up", kind="scene", show=progress), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of what few pixels do not show
        _run_small(scene, camera, asked)
    return WarmUp(tuple(compiling.names[before:]), time.perf_counter() - begin)


def _run_small(scene: Scene | None, camera: PlenopticCamera, truth: Truth) -> None:
    """Everything once, of the middle of the sensor and of one point."""
    rows, columns = (slice(max(n // 2 - _HALF, 0), n // 2 + _HALF) for n in camera.sensor.shape)
    array, meshes = camera.microlenses, False
    render_white(camera, samples=2, region=(rows, columns), progress=False)
    if scene is not None:
        render(scene, camera, samples=2, region=(rows, columns), truth=truth, progress=False)
        meshes = bool(scene.meshes)
    if found := available_truth(truth, meshes=meshes, microlenses=array is not None):
        ground_truth(scene, camera, truth=found, region=(rows, columns))
    if array is not None:
        microlens_centres(camera)
    project(camera, point := _point(camera), scene=scene, rays=32)
    if array is None or array.model.rules.to_sensor is not None:
        point_spread(camera, point, rays=32)


def _point(camera: PlenopticCamera) -> Floats:
    """A point (3,) of the world on the axis, on the plane in focus where that lies in front of the lens."""
    z, front = object_plane(camera.lens, camera.stop_to_microlenses, camera.wavelength), float(camera.lens.vertices[0])
    point = np.array([0.0, 0.0, z if -math.inf < z < front else front - _FAR])
    return point if camera.pose is None else camera.pose.to_world(point[None])[0]
