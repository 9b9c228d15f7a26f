"""A simple model of a render on a cluster: workers take tasks as they are free, and one client takes what they bring.

One worker is a thread. Tasks are grouped as `core/engines/dask_engine.py` does. The client is one server: it spends
time on every task, on every byte that comes or goes, and on every pixel; meanwhile workers have `_AHEAD` tasks each.
"""

import heapq
import math
from typing import NamedTuple

import numpy as np

from plenoptic.core.engines import dask_engine

FEW, MANY, ADAPTIVE = ((64, 1.0),), ((64, 1.0), (960, 1.0)), ((32, 1.0), (32, 0.9), (64, 0.6), (96, 0.3))
"""Rounds: samples that tiles get in each, and the share of tiles that do. The last is about a target of 2 %."""
CHANNELS, REPLICATES = 3, 2


class Measured(NamedTuple):
    """What a run has shown, in seconds."""

    path: float  # of one thread for a path
    task: float  # of the client for a task: submitting, and what the scheduler does in its process
    byte: float  # of the client for a byte that comes or goes
    take: float  # of the client for a pixel of a result
    start: float  # until the first worker of a host has compiled
    load: float  # until the others have loaded that from the disk


class Estimated(NamedTuple):
    """How a render goes."""

    seconds: float
    efficiency: float  # of the workers: what they have computed over what they could have
    client: float  # share of the time that the client is busy
    setup: float  # share of the time until all have begun
    idle: float  # share of the time that workers wait for each other at the end of rounds, or for the client
    task: float  # seconds of a task, the mean
    bytes: float  # moved in all


def side_of(samples):
    """Of a tile: what `rendering/tiling.py` takes."""
    return min(max(int(math.sqrt((1 << 17) / samples)), 16), 256) if samples == FEW[0][0] else 64


def estimated(measured, megapixels, workers, rounds):
    """Of a colour frame with errors from two replicates and depth, on cold workers."""
    random, side = np.random.default_rng(1), side_of(rounds[0][0])
    pixels = side * side
    tiles = math.ceil(megapixels * 1e6 / pixels)
    sums = 8 * CHANNELS * (REPLICATES + 1) * pixels
    begin = now = measured.start + (measured.load if workers > 1 else 0.0)
    client = computed = moved = 0.0
    tasks = 0
    for number, (samples, share) in enumerate(rounds):
        left, free, client_free = math.ceil(share * tiles), [now] * workers, now
        # Microlens images and bodies make tiles unlike: within a factor of some three.
        costs = measured.path * samples * pixels * random.lognormal(-0.08, 0.4, left)
        sent = sums if number else 0
        brought = sums + (0 if number else 12 * pixels)
        heapq.heapify(free)
        done = []
        at = 0
        while left or done:
            known = number > 0 or at > len(done)  # how long orders take
            while left and len(done) < (dask_engine._AHEAD if known else 1) * workers:
                group = _together(left, workers, measured.path * samples * pixels, sums) if known else 1
                client_free += measured.task + measured.byte * sent * group
                client += measured.task + measured.byte * sent * group
                took = float(costs[at : at + group].sum())
                end = max(heapq.heappop(free), client_free) + took
                heapq.heappush(free, end)
                heapq.heappush(done, (end, group))
                at, left, computed, tasks = at + group, left - group, computed + took, tasks + 1
                moved += (sent + brought) * group
            end, group = heapq.heappop(done)
            busy = (measured.byte * brought + measured.take * pixels) * group
            client_free, client = max(client_free, end) + busy, client + busy
        now = client_free
    parts = computed / (now * workers), client / now, begin / now
    idle = max(1 - begin / now - computed / (now * workers), 0.0)
    return Estimated(now, *parts, idle, computed / tasks, moved)


def _together(left, workers, seconds, nbytes):
    """Orders of a task; see `DaskEngine._group`."""
    fitting = min(dask_engine._SECONDS / seconds, dask_engine._MOST_BYTES / nbytes, left)
    shared = max(-(-left // (dask_engine._SHARE * workers)), math.ceil(dask_engine._HANDLING * workers / seconds))
    return max(min(int(fitting), shared), 1)
