"""Exposures of studies: subject, region, and a check that they are complete."""

from __future__ import annotations

from typing import Any

from plenoptic.camera.checks import sensor_region
from plenoptic.rendering.exposure import Exposure
from plenoptic.rendering.plan.stages import Subject
from plenoptic.rendering.render import render, render_white


def expose(
    subject: Subject, *, seed: int, region: tuple[slice, slice] | None, threads: int | None, client: Any = None
) -> Exposure:
    """Render a subject, without a progress bar."""
    common: dict[str, Any] = {
        "samples": subject.samples,
        "region": region,
        "seed": seed,
        "replicates": subject.replicates,
        "threads": threads,
        "client": client,
        "progress": False,
    }
    if subject.scene is None:
        return render_white(subject.camera, sampler=subject.settings.sampler, **common)
    return render(subject.scene, subject.camera, truth=subject.truth, **vars(subject.settings), **common)


def complete(exposure: Exposure) -> Exposure:
    """The exposure, or KeyboardInterrupt where it was interrupted: a part of it would be a wrong number."""
    if exposure.interrupted:
        raise KeyboardInterrupt
    return exposure


def central_region(shape: tuple[int, int], side: int) -> tuple[slice, slice]:
    """Rows and columns in the middle of a sensor, at most so many of each."""
    starts = [max(length - side, 0) // 2 for length in shape]
    rows, columns = (slice(start, start + min(side, length)) for start, length in zip(starts, shape, strict=True))
    return rows, columns


def studied_region(shape: tuple[int, int], region: tuple[slice, slice] | None, side: int) -> tuple[slice, slice]:
    """A region of a sensor with its bounds in full; None: at most so many rows and columns in the middle."""
    first, end, left, right = sensor_region(shape, central_region(shape, side) if region is None else region)
    return slice(first, end), slice(left, right)


def central_pixel(region: tuple[slice, slice]) -> tuple[slice, slice]:
    """The pixel in the middle of a region, as a region, by which set-up is timed."""
    row, column = ((part.start + part.stop) // 2 for part in region)
    return slice(row, row + 1), slice(column, column + 1)
