"""Which path of which exposure is asked for, and whether there is one."""

from __future__ import annotations

import numpy as np

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.core.values import check_kind, whole
from plenoptic.errors import InvalidValueError
from plenoptic.rendering.exposure import Exposure
from plenoptic.rendering.settings import RenderSettings


def known(exposure: Exposure) -> tuple[PlenopticCamera, RenderSettings]:
    """Camera and settings, or an error where the exposure does not know how it was made."""
    check_kind(exposure, "exposure", Exposure, "pl.render(scene, camera, samples=64)")
    missing = [
        name for name in ("camera", "settings", "seed", "replicates", "samples") if getattr(exposure, name) is None
    ]
    if missing:
        raise InvalidValueError(
            f"the exposure does not know its {', '.join(missing)}; only what `render` made can be replayed, or an .exr "
            "file to which that was saved"
        )
    assert exposure.camera is not None and exposure.settings is not None
    return exposure.camera, exposure.settings


def pair(pixel: tuple[int, int]) -> tuple[int, int]:
    """Row and column."""
    if not isinstance(pixel, tuple | list | np.ndarray) or len(pixel) != 2:
        raise InvalidValueError(f"pixel is {pixel!r}; it must be (row, column)")
    return pixel[0], pixel[1]


def triple(path: tuple[int, int, int]) -> tuple[int, int, int]:
    """Row, column and sample."""
    if not isinstance(path, tuple | list | np.ndarray) or len(path) != 3:
        raise InvalidValueError(f"a path is {path!r}; each must be (row, column, sample)")
    return path[0], path[1], path[2]


def checked(exposure: Exposure, row: int, column: int, sample: int) -> tuple[tuple[int, int], int]:
    """Pixel and sample, or an error where the exposure has no such path."""
    row, column = whole(row, "row of the pixel", at_least=0), whole(column, "column of the pixel", at_least=0)
    height, width = exposure.image.shape[:2]
    first_row, end_row, first_column, end_column = exposure.region or (0, height, 0, width)
    if not (first_row <= row < end_row and first_column <= column < end_column):
        raise InvalidValueError(
            f"pixel ({row}, {column}) is outside the exposure, which has rows {first_row} to {end_row - 1} and columns "
            f"{first_column} to {end_column - 1} of the sensor"
        )
    counts = exposure.sample_counts
    samples = exposure.samples if counts is None else int(counts[row - first_row, column - first_column])
    sample = whole(sample, "sample", at_least=0)
    if samples is None or sample >= samples:
        raise InvalidValueError(
            f"sample is {sample}, and pixel ({row}, {column}) has {samples} samples; it must be below that"
        )
    return (row, column), sample
