"""Exposures of studies: what is rendered, where on the sensor, and that it is complete."""

from __future__ import annotations

from typing import Any

from plenoptic.rendering.exposure import Exposure
from plenoptic.rendering.plan.stages import Subject
from plenoptic.rendering.render import render, render_white


def expose(subject: Subject, *, seed: int, region: tuple[slice, slice] | None, threads: int | None) -> Exposure:
    """Render a subject, without a progress bar."""
    settings = subject.settings
    common: dict[str, Any] = {
        "samples": subject.samples,
        "region": region,
        "seed": seed,
        "replicates": subject.replicates,
        "sampler": settings.sampler,
        "threads": threads,
        "progress": False,
    }
    if subject.scene is None:
        return render_white(subject.camera, **common)
    return render(
        subject.scene,
        subject.camera,
        max_bounces=settings.max_bounces,
        caustics=settings.caustics,
        clamp=settings.clamp,
        truth=subject.truth,
        **common,
    )


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
