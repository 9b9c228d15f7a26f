"""Exposures of studies: what is rendered, where on the sensor, and that it is complete."""

from __future__ import annotations

from typing import Any

from plenoptic.rendering.exposure import Exposure
from plenoptic.rendering.plan.stages import Subject
from plenoptic.rendering.render import render, render_white


def expose(subject: Subject, *, seed: int, region: tuple[slice, slice] | None, threads: int | None) -> Exposure:
    """Render a subject, without a progress bar.

    Examples
    --------
    >>> import plenoptic as pl
    >>> from plenoptic.study.exposures import expose
    >>> camera = pl.PlenopticCamera(lens=pl.load_lens("double-gauss-100mm-f2"),
    ...     sensor=pl.Sensor(shape=(16, 16), pixel_pitch=0.01), stop_to_microlenses=130.0)
    >>> expose(pl.plan(None, camera, samples=8).subject, seed=0, region=None, threads=1).image.shape
    (16, 16, 1)
    """
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
    """The exposure, or KeyboardInterrupt where it was interrupted: a part of it would be a wrong number.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> from plenoptic.study.exposures import complete
    >>> complete(pl.Exposure(np.ones((1, 1, 1)))).image.shape
    (1, 1, 1)
    """
    if exposure.interrupted:
        raise KeyboardInterrupt
    return exposure


def central_region(shape: tuple[int, int], side: int) -> tuple[slice, slice]:
    """Rows and columns in the middle of a sensor, at most so many of each.

    Examples
    --------
    >>> from plenoptic.study.exposures import central_region
    >>> central_region((512, 20), 64)
    (slice(224, 288, None), slice(0, 20, None))
    """
    starts = [max(length - side, 0) // 2 for length in shape]
    rows, columns = (slice(start, start + min(side, length)) for start, length in zip(starts, shape, strict=True))
    return rows, columns
