"""Two processes of a dask cluster against two threads, and what tasks take and move."""

import contextlib
import dataclasses
import pickle
import time
from unittest import mock

import distributed
import numpy as np
import reference
from table import Table
from timing import timed

import plenoptic as pl
from plenoptic.core.engines.dask_engine import DaskEngine
from plenoptic.rendering.plan.stages import Subject
from plenoptic.rendering.schedule.progress import Progress

WANTED = 0.85


class Watched:
    """What the client does."""

    def __init__(self):
        self.tasks, self.brought, self.take, self.cpu, self.pixels = [], [], 0.0, 0.0, 0

    @contextlib.contextmanager
    def watching(self):
        original_results, original_take = DaskEngine._job_results, Progress.take

        def job_results(engine, group, reply):
            self.tasks.append(sum(reply.seconds))
            self.cpu += reply.cpu_seconds
            arrays = [array for one in reply.results for array in (one.sums, one.weights, *(one.truth or {}).values())]
            self.brought.append(sum(array.nbytes for array in arrays if array is not None))
            return original_results(engine, group, reply)

        def take(progress, i, result):
            begin = time.thread_time()
            original_take(progress, i, result)
            self.take += time.thread_time() - begin
            self.pixels += result.tile.pixels

        with mock.patch.object(DaskEngine, "_job_results", job_results), mock.patch.object(Progress, "take", take):
            yield


@contextlib.contextmanager
def client_of(workers):
    """Of processes of one thread."""
    with (
        distributed.LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=":0") as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


def tables(*, quick):
    scene, camera = pl.objects_scene(), reference.camera()
    samples, pixels = (16, 32 * 32) if quick else (384, 512 * 512)
    given = {"samples": samples, "progress": False}
    if quick:
        given |= {"region": reference.middle(32), "tile_side": 16}

    def render(**how):
        # A new camera: what feeds the pixels of one that was rendered before would be known to threads.
        anew = dataclasses.replace(camera, sensor=dataclasses.replace(camera.sensor))
        return pl.render(scene, anew, **{**given, **how})

    watched, rows = Watched(), []
    with client_of(2) as client:

        def with_workers(**how):
            """Seconds, those of processors here, and those of workers."""
            elsewhere = sum(client.run(time.process_time).values())
            cost, _ = timed(render, client=client, **how)
            return *cost, float(sum(client.run(time.process_time).values()) - elsewhere)

        # Kernels and the workers' imports: what a later render does not pay.
        started, _, start_cpu = with_workers(samples=2, region=np.s_[240:256, 240:256])
        render(threads=2, region=reference.middle(32))
        for turn in range(1 if quick else 2):
            on_threads, _ = timed(render, threads=2)
            with watched.watching():
                rows.append((turn + 1, *on_threads, *with_workers()))
    _, wall, cpu, *on_cluster = np.array(rows).min(axis=0)
    remark = (
        f"{pixels} pixels, {samples} samples. Efficiency of the best: {wall / on_cluster[0]:.2f} by the clock, "
        f"{cpu / sum(on_cluster[1:]):.2f} by processors (wanted: {WANTED}). The scheduler is in the client's process. "
        f"The first render of workers began after {started:.1f} s, {start_cpu:.1f} s of processors."
    )
    columns = "round | wall s, threads | CPU s, threads | wall s, cluster | CPU s, client | CPU s, workers"
    yield Table("Two processes of one thread against two threads, `objects`", columns, rows, [remark])
    turns, tasks, brought = len(rows), np.array(watched.tasks), np.array(watched.brought) / 1e6
    moved, sent = brought.sum() / turns, len(pickle.dumps(Subject(scene, camera))) / 1e6  # every worker gets it once
    row = len(tasks) // turns, np.median(tasks), tasks.max(), np.median(brought), moved, 1e6 * moved / pixels, sent
    columns = "tasks a render | s, median | s, longest | MB brought, median | MB in all | bytes a pixel | MB sent"
    yield Table("Tasks", columns, [tuple(map(float, row))])
    each, byte = of_empty_tasks(quick=quick)
    path, take = watched.cpu / turns / (pixels * samples), watched.take / watched.pixels
    row = (1e6 * path, 1e3 * each, 1e9 * byte, 1e9 * take, started)
    columns = "us a path | ms a task | ns a byte | ns a pixel taken | s to start"
    yield Table("Cost of a path on a worker, and of tasks, bytes and pixels on the client", columns, [row])


def of_empty_tasks(*, quick):
    """Seconds of this process, scheduler and all, for a task that does nothing, and for a byte that one brings."""
    count, size = (20, 1 << 20) if quick else (200, 1 << 23)

    def tasks(nbytes, n):
        for _ in range(n):
            client.submit(np.ones, nbytes // 8, pure=False).result()

    with client_of(1) as client:
        tasks(1, count)
        empty = timed(tasks, 1, count)[0].cpu / count
        full = timed(tasks, size, count // 5)[0].cpu / (count // 5)
    return empty, max(full - empty, 0.0) / size
