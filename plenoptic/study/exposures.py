"""Exposures of studies: a subject rendered, the region of the sensor, and that the exposure is complete."""

from __future__ import annotations

from typing import Any

from plenoptic.camera.checks import sensor_region
from plenoptic.rendering.exposure import Exposure
from plenoptic.rendering.plan.stages import Subject
from plenoptic.rendering.render import render, render_white

Region = tuple[slice, slice]
"""Rows and columns of the sensor."""


def expose(subject: Subject, *, seed: int, region: Region, threads: int | None) -> Exposure:
    """Render a subject without a progress bar; KeyboardInterrupt after Ctrl-C, since a part of it is a wrong number."""
    common: dict[str, Any] = {
        "samples": subject.samples,
        "region": region,
        "seed": seed,
        "replicates": subject.replicates,
        "threads": threads,
        "progress": False,
    }
    if subject.scene is None:
        exposure = render_white(subject.camera, sampler=subject.settings.sampler, **common)
    else:
        exposure = render(subject.scene, subject.camera, truth=subject.truth, **vars(subject.settings), **common)
    if exposure.interrupted:
        raise KeyboardInterrupt
    return exposure


def central_region(shape: tuple[int, int], side: int) -> Region:
    """Rows and columns in the middle of a sensor, at most `side` of each."""
    starts = [max(length - side, 0) // 2 for length in shape]
    rows, columns = (slice(start, start + min(side, length)) for start, length in zip(starts, shape, strict=True))
    return rows, columns


def region_bounds(shape: tuple[int, int], region: Region | None, side: int) -> Region:
    """A region of a sensor with its bounds in full; None: the `central_region`."""
    first, end, left, right = sensor_region(shape, central_region(shape, side) if region is None else region)
    return slice(first, end), slice(left, right)


def central_pixel(region: Region) -> Region:
    """The pixel in the middle of a region: rendering it takes little more than set-up."""
    row, column = ((part.start + part.stop) // 2 for part in region)
    return slice(row, row + 1), slice(column, column + 1)
