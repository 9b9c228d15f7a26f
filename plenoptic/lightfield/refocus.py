"""Refocusing: views are shifted against each other and averaged."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats, check_kind, finite
from plenoptic.errors import InvalidValueError
from plenoptic.lightfield.epipolar import down_over_across
from plenoptic.lightfield.views import LightField


def refocus(field: LightField, z: float | None = None, *, disparity: float | None = None) -> NDArray[np.float32]:
    """Image of a conventional camera focused on a plane: mean of all views, shifted so that the plane coincides.

    Parameters
    ----------
    field : LightField
    z : float, optional
        The plane in the camera's frame in mm, negative: in front of the camera.
    disparity : float, optional
        Disparity in focus, in place of z: shift along columns in pixels for each unit of `field.u`, positive against
        the step, as `DepthMap.disparity`. Along rows it is scaled by the ratios of pixel spacing and of view
        spacing, if the light field has them. For light fields without distances.

    Returns
    -------
    (rows, columns, C) array of float32
        Mean of the views that have light at a pixel; nan if none has. Views of which the lens vignettes more than a
        tenth are left out, since they show light of neighbouring microlenses. Views are shifted as traced through the
        real lens, each pixel of each view by its own shift, and interpolated by cubic convolution, linearly at borders.

    References
    ----------
    R. Ng et al., Stanford Tech Report CTSR 2005-02, section 4.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.camera.example_camera(pl.CameraKind.PLENOPTIC_1, shape=(110, 110))
    >>> white = pl.render_white(camera, samples=16, progress=False)
    >>> picture = pl.lightfield.refocus(pl.lightfield.decode(white, white, views=5), z=-390.0)
    >>> bool(abs(picture[2, 2, 0] - 1) < 1e-6)
    True
    """
    check_kind(field, "field", LightField, "pl.lightfield.decode(shot, white)")
    from plenoptic.lightfield.kernels.refocus import add_view

    if (z is None) == (disparity is None):
        raise InvalidValueError("give either z, the plane in mm, or disparity=, in pixels from view to view")
    total, count = np.zeros(field.views.shape[2:]), np.zeros(field.views.shape[2:])
    light = np.ones(field.views.shape[:2]) if field.camera is None else field.model.light
    shifts = _shifts(field, z, disparity)
    for view, shift, part in zip(field.views.reshape(-1, *total.shape), shifts, light.ravel(), strict=True):
        if part > 0 and np.isfinite(shift).all():
            add_view(total, count, view, shift)
    with np.errstate(invalid="ignore"):
        return np.asarray(total / np.where(count > 0, count, np.nan), dtype=np.float32)


def _shifts(field: LightField, z: float | None, disparity: float | None) -> Iterator[Floats]:
    """Shifts (rows, columns, 2) in pixels of the plane in focus from the central view to each view."""
    if field.camera is not None:
        model = field.model
        if z is None:
            traced = finite(disparity, "disparity")  # type: ignore[arg-type]
            modelled = float(model.traced_disparity(1).inverse(traced)[model.axis])
        else:
            modelled = model.disparity(field.camera, finite(z, "z"))
        for u in range(len(field.u)):
            yield from model.shifts(modelled, u)
        return
    if z is None:
        across = finite(disparity, "disparity")  # type: ignore[arg-type]
        down = across * down_over_across(field)
    else:
        across, down = field.disparity_at(z)
    for u, v in product(field.u, field.v):
        # A single row or column of views does not shift, and its disparity may be unknown. A positive disparity goes
        # against the step from view to view.
        steps = (down, float(v)), (across, float(u))
        yield np.broadcast_to([-size * step if step else 0.0 for size, step in steps], (*field.views.shape[2:4], 2))
