"""Refocusing: views are shifted against each other and averaged."""

from __future__ import annotations

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
        Mean of the views that have light at a pixel; nan if none has. Shifts follow Gaussian optics
        (`LightField.disparity_at`), and views are interpolated by cubic convolution.

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
    if (z is None) == (disparity is None):
        raise InvalidValueError("give either z, the plane in mm, or disparity=, in pixels from view to view")
    if z is None:
        across = finite(disparity, "disparity")  # type: ignore[arg-type]
        down = across * down_over_across(field)
    else:
        across, down = field.disparity_at(z)
    total, count = np.zeros(field.views.shape[2:]), np.zeros(field.views.shape[2:])
    for i, u in enumerate(field.u):
        for j, v in enumerate(field.v):
            # A single row or column of views does not shift, and its disparity may be unknown. A positive disparity
            # goes against the step from view to view.
            shifts = -down * float(v) if v else 0.0, -across * float(u) if u else 0.0
            shifted = _shift(field.views[i, j].astype(np.float64), *shifts)
            valid = np.isfinite(shifted)
            total += np.where(valid, shifted, 0.0)
            count += valid
    with np.errstate(invalid="ignore"):
        return np.asarray(total / np.where(count > 0, count, np.nan), dtype=np.float32)


def _shift(view: Floats, down: float, right: float) -> Floats:
    """Shift a view (rows, columns, C) by `down` rows and `right` columns; nan outside.

    Interpolated by cubic convolution (R. G. Keys, IEEE Trans. ASSP 29 (1981), doi:10.1109/TASSP.1981.1163711), linearly
    at borders.
    """
    for axis, shift in enumerate((down, right)):
        base = int(np.floor(shift))
        t = shift - base
        if t == 0:
            view = _shift_whole(view, base, axis)
            continue
        taps = [_shift_whole(view, base + k, axis) for k in (-1, 0, 1, 2)]
        weights = (-0.5 * t * (1 - t) ** 2, 1 - 2.5 * t**2 + 1.5 * t**3, 0.5 * t + 2 * t**2 - 1.5 * t**3)
        cubic = sum(weight * tap for weight, tap in zip((*weights, -0.5 * t**2 * (1 - t)), taps, strict=True))
        view = np.where(np.isnan(cubic), (1 - t) * taps[1] + t * taps[2], cubic)
    return view


def _shift_whole(view: Floats, shift: int, axis: int) -> Floats:
    """Shift a view by whole pixels along an axis; nan where it ends."""
    rolled = np.roll(view, -shift, axis=axis)
    np.moveaxis(rolled, axis, 0)[slice(-shift, None) if shift > 0 else slice(-shift)] = np.nan
    return rolled
