"""A light field as a page: its views as pictures, with its depth and error."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.files.codes import block_means, brightest
from plenoptic.core.values import Floats, check_kind
from plenoptic.errors import InvalidValueError
from plenoptic.lightfield.depth_map import DepthMap
from plenoptic.lightfield.epipolar import default_range, down_over_across, view_depths
from plenoptic.lightfield.views import LightField
from plenoptic.viewer.blocks import Blocks, Curve
from plenoptic.viewer.page import Viewer, page
from plenoptic.viewer.pictures import block_for, middles, positive_white, rgba, webp, within

_BYTES = 6.6e6
"""Of pictures: in base64 and with all else, the page has less than 10 MB."""
_MOST_VIEWS = 256
"""Layers of a texture that every browser has."""
_MOST_PIXELS = 24e6
"""Of all views, which take 4 bytes each in the memory of the graphics card."""
_HEADROOM = 2.0
"""Values up to so many times the white of the picture are kept; highlights beyond are cut."""
_TABLE = 129
_MARGIN, _LEAST = 0.3, 0.1
"""Of the range of focus beyond that of the depth: a part of it, pixels."""
_MODULES = (
    *("numbers", "planes", "colors", "gl", "window", "gestures", "panel", "focus"),
    *("field_pictures", "pupil", "field_planes", "field"),
)
_SHADERS = ("common", "sum", "sheet", "slice", "match", "show", "values")


class _Part(NamedTuple):
    """Part of a light field that is shown: all of it, except for large ones."""

    field: LightField
    across: NDArray[np.int64]
    down: NDArray[np.int64]
    """Rows of `field.u` and `v`."""
    block: int
    """Pixels that one of the page stands for, along each side."""


def light_field_page(field: LightField, *, depth: DepthMap | None = None) -> Viewer:
    """The page of a light field; see `LightField.viewer`."""
    if depth is not None:
        check_kind(depth, "depth", DepthMap, "pl.lightfield.depth(field)")
        if depth.disparity.shape != field.views.shape[2:4]:
            raise InvalidValueError(
                f"depth has shape {depth.disparity.shape}; it must have that of a view, {field.views.shape[2:4]}"
            )
    if 0 in field.views.shape or not np.isfinite(field.views).any():
        raise InvalidValueError("no view of the light field holds any light; decode one with a larger region")
    part = _shown(field)
    blocks = Blocks()
    rows, columns = (max(length // part.block, 1) for length in field.views.shape[2:4])
    white = positive_white(field.views)
    top = max(min(brightest(field.views), _HEADROOM * white), white)
    codes = [rgba(block_means(field.views[i, j], part.block), top) for i in part.across for j in part.down]
    files, quality = within(codes, _BYTES)
    facts: dict[str, Any] = {
        "rows": rows,
        "columns": columns,
        "block": part.block,
        "whole": list(field.views.shape),
        "u": field.u[part.across].tolist(),
        "v": field.v[part.down].tolist(),
        "middle": [_middle_of(part.across, field.u), _middle_of(part.down, field.v)],
        "ratio": _ratio(field),
        "top": top,
        "white": white,
        "cut": float(np.mean(field.views[np.isfinite(field.views)] > top)),
        "quality": quality,
        "views": [blocks.add(file) for file in files],
        "focus": _focus(field, depth, part.block),
        "error": None,
        "disparity": None,
        "disparity_error": None,
    }
    if field.standard_error is not None:
        central = middles(field.standard_error[len(field.u) // 2, len(field.v) // 2], part.block)
        error = np.sqrt(np.mean(np.square(central, dtype=np.float64), axis=2))
        facts["error"] = blocks.plane(error, curve=Curve.ASINH, step=0.01, unit=1e-5 * white)
    if depth is not None:
        facts["disparity"] = blocks.plane(middles(depth.disparity, part.block) / part.block, curve=Curve.LINEAR)
        block_errors = middles(depth.standard_error, part.block) / part.block
        facts["disparity_error"] = blocks.plane(block_errors, curve=Curve.ASINH, step=0.01, unit=1e-4)
    middle = files[facts["middle"][0] * len(part.down) + facts["middle"][1]]
    return page(
        f"Light field, {len(field.u)} × {len(field.v)} views",
        facts={"light_field": facts},
        data=blocks.join(),
        still=middle if len(middle) < 2e5 else webp(codes[len(codes) // 2], 75),
        modules=_MODULES,
        shaders=_SHADERS,
    )


def _shown(field: LightField) -> _Part:
    """Every view if they are few enough, else every second, third, ... from the middle; pixels by blocks likewise."""
    across, down, rows, columns, _ = field.views.shape
    step = 1
    while math.ceil(across / step) * math.ceil(down / step) > _MOST_VIEWS:
        step += 1
    chosen = [np.arange(count // 2 % step, count, step) for count in (across, down)]
    block = block_for((rows, columns), _MOST_PIXELS / (len(chosen[0]) * len(chosen[1])))
    return _Part(field, chosen[0], chosen[1], block)


def _middle_of(chosen: NDArray[np.int64], offsets: Floats) -> int:
    return int(np.flatnonzero(chosen == len(offsets) // 2)[0])


def _ratio(field: LightField) -> float:
    """Disparity along rows over that along columns; 1 where it cannot be known."""
    ratio = down_over_across(field)
    return ratio if math.isfinite(ratio) and ratio != 0 else 1.0


def _focus(field: LightField, depth: DepthMap | None, block: int) -> dict[str, Any] | None:
    """Disparities that can be focused on, in pixels of the page, and some distances; None without a second view."""
    try:
        low, high = default_range(field)
    except InvalidValueError:  # there is no second view
        if depth is None:
            return None
        low = high = 0.0
    disparities = np.empty(0) if depth is None else depth.disparity[np.isfinite(depth.disparity)]
    if disparities.size:
        first, last = np.percentile(disparities, (0.5, 99.5)).tolist()
        margin = max(_MARGIN * (last - first), _LEAST)
        low, high = min(first - margin, 0.0), max(last + margin, 0.0)
    table = np.linspace(low, high, _TABLE)
    with np.errstate(divide="ignore", invalid="ignore"):
        closeness = 1.0 / view_depths(field, table)
    return {
        "low": low / block,
        "high": high / block,
        "closeness": [each if math.isfinite(each) else None for each in closeness.tolist()],
    }
