"""A few rays through a lens, by its kernels run as Python: figures and files need no compilation."""

from __future__ import annotations

import types
from collections.abc import Callable
from typing import Any

import numpy as np

from plenoptic.core.values import Floats
from plenoptic.optics.lens.lens_record import lens_record
from plenoptic.optics.lens.stack import LensStack


def few_reverse_rays(
    lens: LensStack, origin: Floats, direction: Floats, wavelength: float, *, clipping: bool = True
) -> tuple[Floats, Floats]:
    """Trace at most some hundred rays from the sensor side into the scene, as LensModel.EXACT.

    Parameters
    ----------
    lens : LensStack
    origin, direction : (n, 3) arrays
        In the lens frame, mm; directions may have any length.
    wavelength : float
        nm.
    clipping : bool, optional
        True if rims and stops clip rays; the last point of a clipped ray lies on the element that clips it.

    Returns
    -------
    points : (n, k + 1, 3) array
        The origins and the points on the k elements, the last one first; nan after the loss of a ray.
    direction : (n, 3) array
        Unit vectors in front of the lens; nan for lost rays.
    """
    elements = range(len(lens.elements))[::-1]
    return _few_rays(lens, elements, origin, direction, wavelength, reverse=True, clipping=clipping)


def few_unclipped_rays(lens: LensStack, origin: Floats, direction: Floats, wavelength: float) -> Floats:
    """Points (n, k + 1, 3) of rays from the scene, as of `few_reverse_rays`: the origins, then the first element."""
    elements = range(len(lens.elements))
    return _few_rays(lens, elements, origin, direction, wavelength, reverse=False, clipping=False)[0]


def _few_rays(
    lens: LensStack,
    elements: range,
    origin: Floats,
    direction: Floats,
    wavelength: float,
    *,
    reverse: bool,
    clipping: bool,
) -> tuple[Floats, Floats]:
    from plenoptic.core.kernels.ray_blocks import CAUSES, CLIPPED
    from plenoptic.optics.lens.kernels.trace import trace_block

    n = len(origin)
    trace = _as_python(trace_block.py_func, _block_of(n), {})
    rays = np.zeros((8, n))
    rays[:3], rays[3:6] = origin.T, (direction / np.linalg.norm(direction, axis=1, keepdims=True)).T
    status, points = rays[7], [rays[:3].T.copy()]
    for i in elements:
        record = lens_record(lens, wavelength, reverse=reverse, first=i, last=i, clipping=clipping)
        going = status == 0
        with np.errstate(all="ignore"):  # lost rays hold undefined numbers
            trace(rays.reshape(-1), record._replace(rows=record.rows.view(np.recarray)), None, 0, None, None, None)
        arrives = going & ((status == 0) | (status % CAUSES == CLIPPED))
        points.append(np.where(arrives[:, None], rays[:3].T, np.nan))
    return np.stack(points, axis=1), np.where(status[:, None] == 0, rays[3:6].T, np.nan)


def _block_of(n: int) -> dict[str, int]:
    """Constants of `ray_blocks` for blocks of n rays."""
    from plenoptic.core.kernels import ray_blocks

    names = ("X", "Y", "Z", "L", "M", "N", "WEIGHT", "STATUS", "BLOCK", "RAY")
    return {name: getattr(ray_blocks, name) // ray_blocks.BLOCK * n for name in names}


def _as_python(
    function: Callable[..., Any], block: dict[str, int], made: dict[Callable[..., Any], Callable[..., Any]]
) -> Callable[..., Any]:
    """Python functions of a kernel and all its callees, for blocks of another length; `made` holds those made so far.

    NumPy functions replace `math`, as in compiled code: the square root of a negative number is nan, not an error.
    """
    if function not in made:
        namespace = {**function.__globals__, "math": np}
        namespace |= {name: number for name, number in block.items() if name in namespace}
        made[function] = types.FunctionType(function.__code__, namespace)
        for name in function.__code__.co_names:
            if called := getattr(namespace.get(name), "py_func", None):
                namespace[name] = _as_python(called, block, made)
    return made[function]
