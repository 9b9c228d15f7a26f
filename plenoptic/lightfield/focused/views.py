"""Light field of a focused camera: its views from a grid of points of the pupil."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.camera.assembly import array_axes
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.core.parallel import thread_count
from plenoptic.lightfield.decode import field_of, odd_count
from plenoptic.lightfield.focused.pixel_rays import pixel_rays
from plenoptic.lightfield.focused.view_rendering import (
    LEAST_LIGHT,
    picture_focus,
    picture_samples,
    render_from_viewpoint,
)
from plenoptic.lightfield.views import LightField
from plenoptic.rendering.exposure import Exposure

_WIDTH = 0.6
"""Half the side of the grid of viewpoints, in semi-diameters of the iris; its corners lie at 0.85."""


def render_views(
    shot: Exposure,
    white: Exposure,
    disparity: ArrayLike,
    *,
    views: int = 5,
    spacing: float | None = None,
    camera: PlenopticCamera | None = None,
    threads: int | None = None,
) -> LightField:
    """Render views of a focused plenoptic camera (2.0) from a grid of points of the pupil, as a light field.

    Parameters
    ----------
    shot, white, disparity, spacing, camera, threads
        As in `render_view`; the disparity of each pixel.
    views : int, optional
        Number of views along u and along v; odd. The outermost lie at 0.6 of the iris's semi-diameter to the right and
        left, above and below.

    Returns
    -------
    LightField
        Its `u` and `v` are offsets from the chief rays on the sensor, as in `decode`, so that
        `LightField.disparity_at`, `LightField.truth`, `refocus` and exports apply. Views are in focus everywhere.

    Raises
    ------
    InvalidValueError
        As `render_view` does, and for an even number of views.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.camera.example_camera(shape=(96, 96))
    >>> shot = pl.render(pl.check_scene(), camera, samples=16, progress=False, truth=pl.Truth.CHORD_DISPARITY)
    >>> white = pl.render_white(camera, samples=16, progress=False)
    >>> field = pl.lightfield.render_views(shot, white, shot.truth.chord_disparity, views=3)
    >>> field, field.pupil[2, 2].round(6).tolist()
    (LightField(3 x 3 views of 31 x 31 x 1), [0.6, -0.6])
    """
    count = odd_count(views)
    rays = pixel_rays(shot, white, camera, LEAST_LIGHT)
    camera, pupil = rays.camera, rays.pupil
    samples = picture_samples(rays, *picture_focus(rays, disparity), spacing)
    positions = np.linspace(-_WIDTH, _WIDTH, count) if count > 1 else np.zeros(1)
    # Offsets increase to the right in the image, and in an upright pupil.
    scale = pupil.slope * camera.microlenses_to_sensor / camera.sensor.pixel_pitch
    sign, workers = math.copysign(1.0, scale), thread_count(threads)
    rendered = [
        [render_from_viewpoint(samples, (sign * x, -sign * y), math.inf, workers) for y in positions] for x in positions
    ]
    axes, local = array_axes(camera), samples.grid.positions()
    chief = axes.on_sensor(local.reshape(-1, 2), local.reshape(-1, 2) * pupil.vergence)
    pixel = camera.sensor.pixel_of(chief).reshape(local.shape)
    errors = [[view.standard_error for view in column] for column in rendered]
    return field_of(
        camera,
        np.array([[view.picture for view in column] for column in rendered]),
        None if rays.raw.variance is None else np.array(errors),
        np.tile(abs(scale) * positions, (2, 1)),
        local[0, 0],
        (samples.grid.spacing, samples.grid.spacing),
        np.concatenate([pixel, rendered[0][0].on_array], axis=-1),
    )
