"""Error against run time: variants of a render, timed, and compared with a converged reference."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

from plenoptic.camera.checks import check_scene_and_camera
from plenoptic.core.engines.choice import cluster_of
from plenoptic.core.engines.engine import Engine, ThreadEngine
from plenoptic.core.parallel import thread_count
from plenoptic.core.progress.bar import load_tqdm
from plenoptic.core.values import seed_number, whole, wrong_kind
from plenoptic.errors import InvalidValueError
from plenoptic.rendering.exposure import Exposure
from plenoptic.study.error_time.measurement import Call, Runs, Timed, measured_rows, timed
from plenoptic.study.error_time.split import reference_of
from plenoptic.study.error_time.table import ErrorTable
from plenoptic.study.error_time.variants import Variant, checked_variants, default_variants
from plenoptic.study.exposures import central_pixel, complete, studied_region

if TYPE_CHECKING:
    import distributed

    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.scene.scene import Scene

REFERENCE_SEED = 1_000_003
"""Added to the first seed for the reference: rows use seeds from the first one on, far fewer than these."""

REFERENCE_FACTOR = 16
"""Samples of the reference over the largest number of samples, unless told otherwise."""

SIDE = 64
"""Pixels along the central region that is rendered unless another is given."""

_BAR = "{percentage:3.0f}%|{bar}| {elapsed}, {remaining} left"


def error_against_time(  # noqa: PLR0913
    scene: Scene | None,
    camera: PlenopticCamera,
    variants: Mapping[str, Variant] | None = None,
    *,
    samples: Sequence[int] = (16, 32, 64, 128, 256),
    region: tuple[slice, slice] | None = None,
    seeds: int = 8,
    seed: int = 0,
    repeats: int = 1,
    reference: Variant | Exposure | None = None,
    reference_samples: int | None = None,
    threads: int = 1,
    client: distributed.Client | None = None,
    title: str | None = None,
    progress: bool = True,
) -> ErrorTable:
    """What an error costs: variants of a render, timed, and compared with a converged reference.

    Each variant is rendered with several numbers of samples and several seeds. What seeds differ by is variance; what
    their mean is off from the reference, beyond what noise explains, is bias. The reference's own squared error is
    known from its standard errors and subtracted. Errors are relative root mean squares over lit pixels: those above
    0.1 of the reference's 99th percentile, in the mean over the channels.

    Parameters
    ----------
    scene : Scene or None
        None: the white image.
    camera : PlenopticCamera
    variants : mapping of str to Variant, optional
        By their names; None: `default_variants`, of which the first is the camera as it is.
    samples : sequence of int, optional
        Paths per pixel, rising.
    region : (slice, slice), optional
        Rows and columns of the sensor; None: the central 64 x 64 pixels.
    seeds : int, optional
        Renders of each row, at least 2.
    seed : int, optional
        The first seed.
    repeats : int, optional
        How often each render is timed; times are medians over seeds and repeats.
    reference : Variant or Exposure, optional
        How the reference is rendered; None: as ``Variant()``. Or one that has been rendered already, of the same
        region, with another seed and with standard errors.
    reference_samples : int, optional
        Paths per pixel of the reference; None: 16 times the largest number in `samples`.
    threads : int, optional
        Of the renders that are timed.
    client : distributed.Client, optional
        Of a dask cluster (extra `cluster`) on whose workers all is rendered, with one thread each: times are then those
        of its processors, which should be alike and not shared. None: here.
    title : str, optional
        Of the table.
    progress : bool, optional
        Whether to show a progress bar.

    Returns
    -------
    ErrorTable
        `print` shows it; `plot()`, `recommend(target_error)`, `slope(variant)`, `bias_floor(variant)`, `pareto()`,
        `to_csv()`, `to_markdown()`. After Ctrl-C it is `interrupted`, with the numbers of samples that were done.

    Raises
    ------
    InvalidValueError
        If an argument is impossible, or the reference is black or does not fit.

    Notes
    -----
    Setting up is timed by calls that render one path, once everything is compiled, and pupils and the scene's tree are
    known from a call before.
    Errors are relative to the reference, so that a poor one makes them too large, by some three times its own squared
    error, and biases that all pixels share by more. Its error should be below the smallest that is studied.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> camera = pl.PlenopticCamera(lens=pl.load_lens("double-gauss-100mm-f2"),
    ...     sensor=pl.Sensor(shape=(16, 16), pixel_pitch=1.0), stop_to_microlenses=130.0)
    >>> table = pl.study.error_against_time(None, camera, samples=(64, 256), seeds=3, progress=False)
    >>> table.variants
    ('EXACT lens', 'PARAXIAL lens', 'THIN lens', 'RANDOM sampler', '1 replicate')
    >>> table.bias_floor("EXACT lens"), table.bias_floor("PARAXIAL lens") > 0.02
    (0.0, True)
    >>> table.recommend(0.02).variant in table.variants
    True
    """
    check_scene_and_camera(scene, camera)
    numbers, first, workers = _checked_numbers(samples), seed_number(seed), thread_count(threads)
    count, rounds = whole(seeds, "seeds", at_least=2), whole(repeats, "repeats", at_least=1)
    chosen = default_variants(scene, camera) if variants is None else checked_variants(variants)
    cameras = {name: variant.camera_from(camera) for name, variant in chosen.items()}
    window = studied_region(camera.sensor.shape, region, SIDE)
    if isinstance(reference, Exposure):
        _check_place(reference, window)
    elif reference is not None and not isinstance(reference, Variant):
        raise wrong_kind(reference, "reference", "Variant or an Exposure", "Variant(max_bounces=32)")

    cluster = cluster_of(client, None if threads == 1 else threads)
    converged = REFERENCE_FACTOR * numbers[-1] if reference_samples is None else reference_samples
    whole(converged, "reference_samples", at_least=2)
    total = converged + len(chosen) * sum(numbers) * count * rounds
    with load_tqdm()(total=total, bar_format=_BAR, disable=not progress) as bar, contextlib.ExitStack() as stack:
        if not isinstance(reference, Exposure):
            variant = Variant() if reference is None else reference
            there, other = variant.camera_from(camera), first + REFERENCE_SEED
            # On all processors: it is not timed, and its bits do not depend on them.
            shot = variant.render(scene, there, samples=converged, seed=other, region=window, client=client)
            reference = complete(shot)
        known = reference_of(reference)
        bar.update(converged)
        job = _Job(scene, cameras, chosen, window, workers, numbers[0], first)
        engine: Engine[Call, Timed]
        if cluster is None:
            work = _timed_renders(job)
            engine = ThreadEngine(lambda call, _: work(call), 1)
        else:
            engine = stack.enter_context(cluster.engine(_timed_renders, job))
        found = measured_rows(engine, list(chosen), Runs(numbers, count, first, rounds), known, done=bar.update)
    return ErrorTable(
        title=title or ("white image" if scene is None else repr(scene)),
        rows=found,
        pixels=int(known.lit.size),
        lit_pixels=int(known.lit.sum()),
        seeds=count,
        threads=workers,
        reference_samples=reference.samples or converged,
        reference_error=math.sqrt(known.squared_error),
        interrupted=len(found) < len(chosen) * len(numbers),
    )


class _Job(NamedTuple):
    """What all renders of a study have in common, as values that pickle."""

    scene: Scene | None
    cameras: dict[str, PlenopticCamera]
    variants: dict[str, Variant]
    window: tuple[slice, slice]
    threads: int
    samples: int
    seed: int


def _timed_renders(job: _Job, processes: int = 1) -> Callable[[Call], Timed]:
    """What carries out the calls of a study: here, or in another process. All is compiled, and pupils are known."""
    middle = central_pixel(job.window)

    def expose(name: str, n: int, seed: int, region: tuple[slice, slice] = job.window) -> Exposure:
        variant, camera = job.variants[name], job.cameras[name]
        return complete(variant.render(job.scene, camera, samples=n, seed=seed, region=region, threads=job.threads))

    for name in job.variants:
        expose(name, job.samples, job.seed)
    # With one thread it is this one that renders, whatever others of the process do meanwhile.
    clock = time.thread_time if job.threads == 1 else time.process_time
    return lambda call: timed(expose, lambda name: expose(name, 1, 0, middle), call, clock)


def _checked_numbers(samples: Sequence[int]) -> list[int]:
    if isinstance(samples, str | bytes) or not isinstance(samples, Sequence) or not samples:
        raise wrong_kind(samples, "samples", "sequence of whole numbers", "(16, 64, 256)")
    numbers = [whole(n, "samples", at_least=1) for n in samples]
    if any(b <= a for a, b in pairwise(numbers)):
        raise InvalidValueError(f"samples is {tuple(samples)}; each number must be above the one before")
    return numbers


def _check_place(exposure: Exposure, window: tuple[slice, slice]) -> None:
    """Raise where a reference is not that of the region studied."""
    wanted = tuple(part.stop - part.start for part in window)
    place = (window[0].start, window[0].stop, window[1].start, window[1].stop)
    if exposure.image.shape[:2] != wanted or (exposure.region is not None and exposure.region != place):
        raise InvalidValueError(
            f"the reference has {exposure.image.shape[:2]} pixels of region {exposure.region}; it must be of "
            f"rows and columns {place}, as the study is: give it region="
        )
