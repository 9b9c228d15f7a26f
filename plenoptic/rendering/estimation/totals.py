"""Time, memory and file sizes of a render, from the costs of its pixels."""

from __future__ import annotations

import math

from plenoptic.camera.cache import MAX_CACHED_BYTES
from plenoptic.rendering.estimation.costs import Costs, Pilots
from plenoptic.rendering.estimation.errors import render_error
from plenoptic.rendering.estimation.estimated import Estimate, Estimated
from plenoptic.rendering.estimation.memory import PUPIL_BYTES, resident_bytes, truth_bytes
from plenoptic.rendering.schedule.clock import Clock
from plenoptic.rendering.tile import status_codes

_WORK_BYTES, _DECIDED_BYTES = 1200, 100
"""Bytes of a pixel of a tile being rendered, and of each pixel while tiles are decided upon."""
_LOG_BYTES, _RECORD_BYTES = 950, 650
"""Bytes of a checkpoint besides its records, and of a record besides its arrays."""


def totals(pilots: Pilots, costs: Costs) -> Estimate:
    """Time, memory and file sizes of a frame, whose pixels have these costs."""
    n, budget, channels = pilots.pixels, pilots.budget, pilots.context.channels
    cpu = Estimated(*(n * part for part in costs.cpu_seconds))
    fastest, slowest = 1.0 / pilots.threads, 1.0 / (pilots.threads * costs.busy)
    wall = Estimated(cpu.value * math.sqrt(fastest * slowest), cpu.low * fastest, cpu.high * slowest)
    once, state = 8 + truth_bytes(pilots.subject.truth), 8 * channels * (budget.replicates + 1)
    pixels_in_memory, spread = pilots.threads * min(pilots.side**2, n), pilots.context.camera.diffraction_kernel
    shared = 0 if spread is None else state * spread.table.weights.shape[1]
    working_memory = pixels_in_memory * (4 * (state + once) + _WORK_BYTES + shared)
    cached = (costs.cached_bytes or PUPIL_BYTES) * n if budget.steps or budget.passes else 0
    memory = resident_bytes() + _film_bytes(pilots) * n + working_memory + min(cached, MAX_CACHED_BYTES)
    record = _RECORD_BYTES + 8 * status_codes(pilots.context.camera)
    records_per_tile = [costs.steps if budget.steps else _records(tile.pixels, pilots) for tile in pilots.tiles]
    log = sum((tile.pixels * state + record) * k for tile, k in zip(pilots.tiles, records_per_tile, strict=True))
    return Estimate(
        cpu_seconds=cpu,
        seconds=wall,
        peak_memory=about(memory, 0.1),
        file_size=about(costs.head_bytes + pilots.asked_pixels * costs.exposure_bytes, 0.15),
        checkpoint_size=about(_LOG_BYTES + once * n + log, 0.3 if budget.steps else 0.02),
        samples=costs.samples,
        plan=pilots.context.plan,
        relative_error=render_error(budget, costs),
    )


def _records(pixels: int, pilots: Pilots) -> int:
    """Records of a tile in the checkpoint of a render with given samples: its number of batches."""
    done, batches, batch_samples = 0, 0, Clock(0.0, None).samples_per_batch(pixels, pilots.context.together)
    while done < pilots.budget.max_samples:
        done = min(done + batch_samples, pilots.budget.following(done))
        batches += 1
    return batches


def _film_bytes(pilots: Pilots) -> float:
    """Bytes of a pixel during rendering and finishing."""
    budget, channels = pilots.budget, pilots.context.channels
    bytes_ = 4 * channels + truth_bytes(pilots.subject.truth)
    if budget.replicates >= 2:
        bytes_ += 2 * 4 * channels + 4
    if budget.steps or budget.passes:
        bytes_ += 4 + 8 * channels * (budget.replicates + 1)
    if budget.target_error is not None:
        bytes_ += 2 * 8 + _DECIDED_BYTES
    return bytes_


def about(number: float, part: float) -> Estimated:
    """A number that is known within a part of it."""
    return Estimated(number, number * (1 - part), number * (1 + part))
