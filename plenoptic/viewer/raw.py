"""A raw image as a page: its values and errors, the object points of its pixels, and the microlenses over it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.checks import sensor_region
from plenoptic.camera.points.centres import CentreMethod, MicrolensCentres, microlens_centres
from plenoptic.camera.points.projection_rows import lenses_at
from plenoptic.core.files.codes import block_means
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError
from plenoptic.lightfield.raw_arrays import raw_arrays
from plenoptic.optics.microlens.lattice import Lattice
from plenoptic.truth.channels import NO_MICROLENS
from plenoptic.viewer.blocks import Blocks, Curve, pack
from plenoptic.viewer.page import Viewer, page
from plenoptic.viewer.pictures import block_for, middles, positive_white, rgba, webp
from plenoptic.viewer.sight import ENOUGH, Sight, sight

if TYPE_CHECKING:
    from plenoptic.rendering.exposure import Exposure

_BYTES = 7.3e6
"""Of data: in base64 and with all else, the page has less than 10 MB."""
_MOST_PIXELS = 1 << 20
_STEPS = (5e-4, 1e-3, 2e-3, 4e-3, 8e-3, 0.016, 0.032)
"""Relative steps of values; the first one with which all fits is taken."""
_STILL = 640
"""Pixels along the longer side of the picture shown before scripts run."""
_LEAST_LIGHT = 0.05
"""Of the white image's 99th percentile, below which nothing is divided by it."""
_DISTANCES = (2, 25, 50, 75, 98)
"""Percentiles of the depth at which the polynomial of chief rays is judged."""
_MOST_BESIDE, _STEP_BESIDE = 4.0, 1 / 32
"""Pixels by which a point's chief ray lands beside the pixel that shows it, and their steps."""
_MOST_LENSES = 50_000
"""28 bytes each, which hardly shrink."""
_CHUNK = 1 << 15
_MODULES = ("numbers", "planes", "colors", "gl", "window", "gestures", "panel", "lenses", "sight", "raw_overlay", "raw")
_SHADERS = ("common", "raw", "values")


class _Shown(NamedTuple):
    """Displayed part of a raw image, on its pixels."""

    image: NDArray[np.float32]
    error: NDArray[np.float32] | None
    truth: dict[str, NDArray[Any]]
    """Channels of the ground truth by name."""
    first: tuple[int, int]
    """Row and column of the first pixel on the sensor."""
    block: int
    """Pixels of the sensor along each side of one that is shown."""


def exposure_page(
    exposure: Exposure, *, white: Exposure | None = None, region: tuple[slice, slice] | None = None
) -> Viewer:
    """The page of a raw image; see `Exposure.viewer`."""
    display = _shown(exposure, white, region)
    rows, columns, channels = display.image.shape
    blocks = Blocks()
    top = positive_white(display.image)
    facts: dict[str, Any] = {
        "rows": rows,
        "columns": columns,
        "channels": channels,
        "block": display.block,
        "first": list(display.first),
        "white": top,
        "unit": "radiance" if white is not None else "radiance × sr",
        "samples": exposure.samples,
        "left_out": [],
        "planes": {},
        "lenses": None,
        "sight": None,
    }
    planes = facts["planes"]
    if display.error is not None:
        error = np.sqrt(np.mean(np.square(display.error, dtype=np.float64), axis=2))
        planes["error"] = blocks.plane(error, curve=Curve.ASINH, step=0.02, unit=1e-6 * top)
    for name, curve in (("depth", Curve.RECIPROCAL), ("virtual_depth", Curve.RECIPROCAL), ("disparity", Curve.LINEAR)):
        # Disparities are pitch / (virtual depth pixel pitch): one says the other.
        if name in display.truth and not (name == "disparity" and "virtual_depth" in display.truth and exposure.camera):
            planes[name] = blocks.plane(display.truth[name], curve=curve)
    if exposure.camera is not None and exposure.camera.microlenses is not None:
        _add_lenses(facts, blocks, exposure.camera, display)
    _add_image(facts, blocks, display.image)
    step = max(1, math.ceil(max(rows, columns) / _STILL))
    return page(
        f"Raw image, {exposure.image.shape[0]} × {exposure.image.shape[1]} pixels",
        facts={"raw": facts},
        data=blocks.join(),
        still=webp(rgba(_means(display.image, step), top), 75),
        modules=_MODULES,
        shaders=_SHADERS,
    )


def _shown(exposure: Exposure, white: Exposure | None, region: tuple[slice, slice] | None) -> _Shown:
    image, error = exposure.image, exposure.standard_error
    if white is not None:
        image, error = _divide(exposure, white)
    truth = {} if exposure.truth is None else dict(exposure.truth.arrays())
    start = (0, 0) if exposure.region is None else (exposure.region[0], exposure.region[2])
    first, part = start, (slice(None), slice(None))
    if region is not None:
        first, part = _part(region, start, image.shape[:2])
    block = block_for(image[part].shape[:2], _MOST_PIXELS)
    return _Shown(
        image=_means(image[part], block),
        error=None if error is None else (error[part] if block == 1 else _error_of_means(error[part], block)),
        truth={name: middles(values[part], block) for name, values in truth.items()},
        first=first,
        block=block,
    )


def _divide(exposure: Exposure, white: Exposure) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """Radiance and its error; nan where the white image is dark."""
    planes = raw_arrays(exposure, white, _LEAST_LIGHT)
    light = np.where(planes.white >= planes.least, planes.white, np.nan)
    radiance = planes.shot / light
    variance = planes.variance_of(radiance, light, lambda plane: plane)
    return radiance.astype(np.float32), None if variance is None else np.sqrt(variance).astype(np.float32)


def _part(
    region: tuple[slice, slice], start: tuple[int, int], shape: tuple[int, ...]
) -> tuple[tuple[int, int], tuple[slice, slice]]:
    """First pixel and slices of a region of the sensor, which must lie in the image."""
    ends = (start[0] + shape[0], start[1] + shape[1])
    top, bottom, left, right = sensor_region(ends, region)
    if top < start[0] or left < start[1]:
        raise InvalidValueError(
            f"region begins at row {top}, column {left}; the exposure holds rows {start[0]} to {ends[0]} and columns "
            f"{start[1]} to {ends[1]}"
        )
    return (top, left), (slice(top - start[0], bottom - start[0]), slice(left - start[1], right - start[1]))


def _means(image: NDArray[np.float32], block: int) -> NDArray[np.float32]:
    """(rows, columns, C): means of known values over blocks."""
    if block == 1:
        return image
    finite = np.isfinite(image)
    with np.errstate(invalid="ignore"):  # nothing of a block may be known
        means = block_means(np.where(finite, image, 0.0), block) / block_means(finite, block)
    return np.asarray(means, dtype=np.float32)


def _error_of_means(error: NDArray[np.float32], block: int) -> NDArray[np.float32]:
    return np.asarray(np.sqrt(_means(np.square(error), block)) / block, dtype=np.float32)


def _add_image(facts: dict[str, Any], blocks: Blocks, image: NDArray[np.float32]) -> None:
    """Channels as planes, in the finest steps with which the page keeps its size."""
    for step in _STEPS:
        trial = Blocks()
        scale = 1e-5 * facts["white"]
        channels = [
            trial.plane(image[:, :, k], curve=Curve.ASINH, step=step, unit=scale) for k in range(image.shape[2])
        ]
        if blocks.size + trial.size <= _BYTES:
            break
    for each in channels:
        each["bytes"][0] += blocks.size
    blocks.add(trial.join())
    facts["image"] = channels


def _add_lenses(facts: dict[str, Any], blocks: Blocks, camera: PlenopticCamera, shown: _Shown) -> None:
    """A table of microlenses, which of them each pixel belongs to, and how chief rays run through them."""
    array = camera.microlenses
    assert array is not None
    centres = microlens_centres(camera, CentreMethod.CHIEF_RAY, margin=2.0 * max(array.pitches))
    rows, columns = shown.image.shape[:2]
    near = _near(centres, shown, max(array.pitches) / camera.sensor.pixel_pitch)
    index = centres.index[near]
    numbers = shown.truth.get("microlens")
    if numbers is not None:
        pixel_index = numbers.reshape(-1, 2).astype(np.int64)
        index = np.unique(np.concatenate([index, pixel_index[pixel_index[:, 0] != NO_MICROLENS]]), axis=0)
    if not len(index):
        return
    if len(index) > _MOST_LENSES:
        facts["left_out"].append(
            f"{len(index)} microlenses are more than a page holds: for a region with at most {_MOST_LENSES} there are "
            "cells, centres and images of a point, too."
        )
        return
    lenses = lenses_at(array, index)
    place = {tuple(each): k for k, each in enumerate(centres.index.tolist())}
    at = np.array([place.get(tuple(each), -1) for each in index.tolist()])
    centre = np.where(at[:, None] >= 0, centres.pixel[at], np.nan)
    table = np.column_stack([index, lenses.type, lenses.axis, centre]).astype("<f4")
    facts["lenses"] = {
        "count": len(index),
        "table": {"bytes": blocks.add(pack(np.ascontiguousarray(table).view("<u4"))), "wide": True},
        "free": array.lattice is Lattice.FREE,
        "cell": _cell(array.lattice, array.cell_corners, array.basis, centres),
        "focal_lengths": list(array.focal_lengths),
        "pitch": min(array.pitches) / camera.sensor.pixel_pitch,
        "radius": array.cell_radius / camera.sensor.pixel_pitch,
        "of_pixels": None,
    }
    if numbers is not None:
        numbers_of_lenses = {tuple(each): k + 1 for k, each in enumerate(index.tolist())}
        once, inverse = np.unique(pixel_index, axis=0, return_inverse=True)
        codes = np.array([numbers_of_lenses.get(tuple(each), 0) for each in once.tolist()])[inverse.reshape(-1)]
        facts["lenses"]["of_pixels"] = blocks.whole_numbers(codes.reshape(rows, columns))
    depth = shown.truth.get("depth")
    depths = np.empty(0) if depth is None else depth[np.isfinite(depth) & (depth > 0)]
    if depths.size:
        polynomial = sight(camera, centres, np.percentile(depths, _DISTANCES))
        facts["sight"] = None if polynomial is None else polynomial.facts()
        if polynomial is None:
            facts["left_out"].append(
                f"Images of a point are left out: no polynomial of chief rays is good to {ENOUGH} pixels for this "
                "lens, or too few of them pass; camera.project finds them."
            )
        if polynomial is not None and numbers is not None and "position" in shown.truth:
            _add_beside(facts, blocks, polynomial, camera, shown)


def _add_beside(facts: dict[str, Any], blocks: Blocks, seen: Sight, camera: PlenopticCamera, shown: _Shown) -> None:
    """Add the displacement of each pixel from the landing point of the chief ray of its object point."""
    points, numbers = shown.truth["position"], shown.truth["microlens"].astype(np.int64)
    rows, columns = np.nonzero(np.isfinite(points).all(axis=2) & (numbers[..., 0] != NO_MICROLENS))
    displacement = np.full((*points.shape[:2], 2), np.nan)
    array = camera.microlenses
    assert array is not None
    lenses, which = np.unique(numbers[rows, columns], axis=0, return_inverse=True)
    on_array = lenses_at(array, lenses).axis[which.reshape(-1)]
    pixel = np.column_stack([rows, columns]) * shown.block + shown.block // 2 + np.array(shown.first)
    for start in range(0, len(rows), _CHUNK):
        part = slice(start, start + _CHUNK)
        place = points[rows[part], columns[part]]
        local = place if camera.pose is None else camera.pose.to_camera(place)
        displacement[rows[part], columns[part]] = seen.beside(local, pixel[part].astype(np.float64), on_array[part])
    displacement[np.abs(displacement).max(axis=2) > _MOST_BESIDE] = np.nan
    for k, name in enumerate(("beside_row", "beside_column")):
        facts["planes"][name] = blocks.plane(displacement[..., k], curve=Curve.LINEAR, step=_STEP_BESIDE)


def _near(centres: MicrolensCentres, shown: _Shown, margin: float) -> NDArray[np.bool_]:
    """True for centres on the displayed pixels, or within a pitch of them."""
    low = np.array(shown.first) - margin
    high = np.array(shown.first) + np.array(shown.image.shape[:2]) * shown.block + margin
    return np.asarray(((centres.pixel >= low) & (centres.pixel <= high)).all(axis=1))


def _cell(lattice: Lattice, corners: Floats, basis: Floats, centres: MicrolensCentres) -> list[list[float]] | None:
    """Corners of a cell beside its centre, in rows and columns; None where cells differ."""
    if lattice is Lattice.FREE or len(centres) < 3:
        return None
    table = np.column_stack([centres.index, np.ones(len(centres))])
    steps, _, rank, _ = np.linalg.lstsq(table, centres.pixel, rcond=None)
    if rank < 3:
        return None
    return (corners @ np.linalg.inv(basis) @ steps[:2]).tolist()  # type: ignore[no-any-return]
