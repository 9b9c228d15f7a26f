"""Observations of one camera at several focus settings, joined into one."""

from __future__ import annotations

import dataclasses
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.calibration.fitting.start_values import image_lattice
from plenoptic.calibration.observations import Observations
from plenoptic.core.values import Floats
from plenoptic.errors import InvalidValueError

_SAME_LATTICE = 0.02
"""Largest relative difference of the micro images' lattices at two settings: it is the change of the ratio of the
distances from array to sensor and from lens to array."""
_SAME_PLACE = 0.05
"""Largest displacement of the lattice in pitches, beyond that by the change of its pitch about any pixel."""
_MEASURED = "pixel", "centre_pixel"


class JointObservations(NamedTuple):
    """Observations of all settings with one numbering of frames and microlenses, sorted by setting."""

    observations: Observations
    setting: NDArray[np.int64]
    """(n,) of the corners."""
    centre_setting: NDArray[np.int64]


def join_settings(settings: tuple[Observations, ...]) -> JointObservations:
    """Join the observations of focus settings; raise InvalidValueError if they are not of one camera and board."""
    first, numbers = settings[0], np.arange(len(settings))
    for k, each in enumerate(settings):
        for name in ("sensor", "lattice", "board"):
            if not np.array_equal(getattr(each, name), getattr(first, name)):
                raise InvalidValueError(
                    f"observations[{k}] has another {name} than observations[0]; all focus settings must be those of "
                    "one camera, with the same board"
                )
    for j, k in combinations(numbers.tolist(), 2):
        if all(np.array_equal(getattr(settings[j], name), getattr(settings[k], name)) for name in _MEASURED):
            raise InvalidValueError(
                f"observations[{k}] are the same as observations[{j}], which doubles their weight; give those of each "
                "focus setting once"
            )
    steps = [_renumbering(first, each, k) for k, each in enumerate(settings)]
    starts = np.cumsum([0, *(len(each.frames) for each in settings)])
    with_corners = [each for each in settings if len(each.pixel)]
    if len({each.in_views for each in with_corners}) > 1:
        raise InvalidValueError(
            "some focus settings have their corners in views and others in micro images; all must be of one kind"
        )
    columns: dict[str, list[Any]] = {
        "index": [each.index @ step + shift for each, (step, shift) in zip(settings, steps, strict=True)],
        "centre_index": [each.centre_index @ step + shift for each, (step, shift) in zip(settings, steps, strict=True)],
        "frame": [
            np.searchsorted(each.frames, each.frame) + start for each, start in zip(settings, starts, strict=False)
        ],
    }
    columns |= {name: [getattr(each, name) for each in settings] for name in ("pixel", "point", "centre_pixel")}
    arrays: dict[str, Any] = {name: np.concatenate(parts) for name, parts in columns.items()}
    for name in ("blur", "standard_error"):
        parts = [getattr(each, name) for each in with_corners]
        arrays[name] = None if any(part is None for part in parts) else np.concatenate(parts)
    joint = dataclasses.replace(first, **arrays)
    corners, centres = ([len(part) for part in columns[name]] for name in ("pixel", "centre_pixel"))
    return JointObservations(joint, np.repeat(numbers, corners), np.repeat(numbers, centres))


def _renumbering(first: Observations, other: Observations, k: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Whole steps (2, 2) and shift (2,) from lattice indices of one white image to those of the first.

    White images are numbered from their middle, and from one of the equal directions of the lattice. At the axis of the
    lens, and nearly over the whole image, a microlens has its micro image in the same pixel at all settings.
    """
    lattice, moved = (image_lattice(each.centre_index.astype(np.float64), each.centre_pixel) for each in (first, other))
    to_index: Floats = np.asarray(np.linalg.inv(lattice.steps), dtype=np.float64)
    ratio = moved.steps @ to_index
    step = np.rint(ratio)
    change = float(np.abs(ratio - step).max())
    middle = other.centre_index.mean(axis=0)
    displacement = (moved.origin + middle @ moved.steps - lattice.origin) @ to_index - middle @ step
    shift = np.rint(displacement)
    offset = float(np.abs(displacement - shift).max())
    limit = _SAME_PLACE + change * float(np.ptp(other.centre_index, axis=0).max())
    if not (change < _SAME_LATTICE and offset < limit) or abs(round(float(np.linalg.det(step)))) != 1:
        pitches = [np.linalg.norm(each.steps[0]) for each in (moved, lattice)]
        raise InvalidValueError(
            f"micro images of observations[{k}] form another lattice than those of observations[0]: of pitches "
            f"{pitches[0]:.3f} and {pitches[1]:.3f} pixels, turned, or displaced by {offset:.2f} pitches; they are of "
            "another camera, or its array or sensor was moved between them"
        )
    return step.astype(np.int64), shift.astype(np.int64)
