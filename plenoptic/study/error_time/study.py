"""Error against run time: variants of a rendering, timed, and compared with a converged reference."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

from plenoptic.core.parallel import thread_count
from plenoptic.core.values import whole, wrong_kind
from plenoptic.errors import InvalidValueError
from plenoptic.rendering.exposure import Exposure
from plenoptic.study.error_time.measuring import measured_rows
from plenoptic.study.error_time.split import Reference, reference_of
from plenoptic.study.error_time.table import ErrorTable
from plenoptic.study.error_time.variants import Variant, checked_variants, default_variants
from plenoptic.study.finished import finished

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.scene.scene import Scene

REFERENCE_SEED = 1_000_003
"""Added to the first seed for the reference: rows use seeds from the first one on, far fewer than these."""

REFERENCE_FACTOR = 16
"""Samples of the reference over the largest number of samples, unless told otherwise."""

_CROP = 64
"""Pixels along the central region that is rendered unless another is given."""


def study_of(
    scene: Scene | None,
    camera: PlenopticCamera,
    variants: Mapping[str, Variant] | None,
    *,
    samples: Sequence[int],
    region: tuple[slice, slice] | None,
    seeds: int,
    seed: int,
    repeats: int,
    reference: Variant | Exposure | None,
    reference_samples: int | None,
    threads: int,
    title: str | None,
    progress: bool,
) -> ErrorTable:
    """Run a study; see `plenoptic.study.error_against_time`."""
    from plenoptic.camera.checks import check_scene_and_camera, sensor_region

    check_scene_and_camera(scene, camera)
    numbers, first, workers = _checked_numbers(samples), whole(seed, "seed", at_least=0), thread_count(threads)
    count, rounds = whole(seeds, "seeds", at_least=2), whole(repeats, "repeats", at_least=1)
    chosen = default_variants(scene, camera) if variants is None else checked_variants(variants)
    cameras = {name: variant.camera_from(camera) for name, variant in chosen.items()}
    rows, end_row, columns, end_column = sensor_region(camera.sensor.shape, region or _central(camera.sensor.shape))
    window = (slice(rows, end_row), slice(columns, end_column))
    middle = tuple(slice((part.start + part.stop) // 2, (part.start + part.stop) // 2 + 1) for part in window)

    def expose(name: str, n: int, seed: int) -> Exposure:
        return finished(chosen[name].render(scene, cameras[name], samples=n, seed=seed, region=window, threads=workers))

    def set_up(name: str) -> None:
        chosen[name].render(scene, cameras[name], samples=1, seed=0, region=middle, threads=workers)  # type: ignore[arg-type]

    converged = whole(
        REFERENCE_FACTOR * numbers[-1] if reference_samples is None else reference_samples,
        "reference_samples",
        at_least=2,
    )
    with _progress_bar(converged + len(chosen) * sum(numbers) * count * rounds, progress) as bar:
        if isinstance(reference, Exposure):
            known = _given_reference(reference, window)
        else:
            known = _rendered_reference(scene, camera, reference, converged, first + REFERENCE_SEED, window)
        bar.update(converged)
        found = measured_rows(
            expose,
            list(chosen),
            numbers,
            known,
            seeds=count,
            seed=first,
            repeats=rounds,
            set_up=set_up,
            done=bar.update,
        )
    return ErrorTable(
        title=title or ("white image" if scene is None else repr(scene)),
        rows=found,
        pixels=int(known.lit.size),
        lit_pixels=int(known.lit.sum()),
        seeds=count,
        threads=workers,
        reference_samples=(isinstance(reference, Exposure) and reference.samples) or converged,
        reference_error=math.sqrt(known.squared_error),
    )


def _checked_numbers(samples: Sequence[int]) -> list[int]:
    if isinstance(samples, str | bytes) or not isinstance(samples, Sequence) or not samples:
        raise wrong_kind(samples, "samples", "sequence of whole numbers", "(16, 64, 256)")
    numbers = [whole(n, "samples", at_least=1) for n in samples]
    if any(b <= a for a, b in pairwise(numbers)):
        raise InvalidValueError(f"samples is {tuple(samples)}; each number must be above the one before")
    return numbers


def _central(shape: tuple[int, int]) -> tuple[slice, slice]:
    starts = [max(length - _CROP, 0) // 2 for length in shape]
    rows, columns = (slice(start, start + min(_CROP, length)) for start, length in zip(starts, shape, strict=True))
    return rows, columns


def _given_reference(exposure: Exposure, window: tuple[slice, slice]) -> Reference:
    wanted = tuple(part.stop - part.start for part in window)
    place = (window[0].start, window[0].stop, window[1].start, window[1].stop)
    if exposure.image.shape[:2] != wanted or (exposure.region is not None and exposure.region != place):
        raise InvalidValueError(
            f"the reference has {exposure.image.shape[:2]} pixels of region {exposure.region}; it must be of "
            f"rows and columns {place}, as the study is: give it region="
        )
    return reference_of(exposure)


def _rendered_reference(
    scene: Scene | None,
    camera: PlenopticCamera,
    reference: Variant | None,
    samples: int,
    seed: int,
    window: tuple[slice, slice],
) -> Reference:
    variant = Variant() if reference is None else reference
    if not isinstance(variant, Variant):
        raise wrong_kind(reference, "reference", "Variant or an Exposure", "Variant(max_bounces=32)")
    # On all processors: it is not timed, and its bits do not depend on them.
    shot = finished(variant.render(scene, variant.camera_from(camera), samples=samples, seed=seed, region=window))
    return reference_of(shot)


def _progress_bar(samples: int, show: bool):  # type: ignore[no-untyped-def]
    from tqdm.auto import tqdm

    return tqdm(total=samples, bar_format="{percentage:3.0f}%|{bar}| {elapsed}, {remaining} left", disable=not show)
