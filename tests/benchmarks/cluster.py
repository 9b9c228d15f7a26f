"""Two processes of a dask cluster against two threads, what tasks take and move, and a model of larger clusters."""

import dataclasses
import itertools
import pickle
import time

import cluster_model
import distributed
import numpy as np
import reference
from table import Table

import plenoptic as pl
from plenoptic.core.engines.dask_engine import DaskEngine
from plenoptic.rendering.plan.stages import Subject
from plenoptic.rendering.schedule.progress import Progress

WANTED = 0.85
WORKERS = (1, 8, 64, 512)


class Watched:
    """What the client does, while it is entered."""

    def __init__(self):
        self.tasks, self.brought, self.take, self.cpu, self.pixels = [], [], 0.0, 0.0, 0

    def __enter__(self):
        self._taken, self._take = DaskEngine._taken, Progress.take
        watched = self

        def taken(engine, group, reply):
            watched.tasks.append(sum(reply.seconds))
            watched.cpu += reply.cpu_seconds
            arrays = [array for one in reply.results for array in (one.sums, one.weights, *(one.truth or {}).values())]
            watched.brought.append(sum(array.nbytes for array in arrays if array is not None))
            return watched._taken(engine, group, reply)

        def take(progress, i, result):
            begin = time.thread_time()
            watched._take(progress, i, result)
            watched.take += time.thread_time() - begin
            watched.pixels += result.tile.pixels

        DaskEngine._taken, Progress.take = taken, take
        return self

    def __exit__(self, *error):
        DaskEngine._taken, Progress.take = self._taken, self._take


def tables(*, quick):
    scene, camera = pl.objects_scene(), reference.camera()
    given = {"samples": 384, "progress": False}
    if quick:
        given |= {"samples": 16, "region": np.s_[240:272, 240:272], "tile_side": 16}
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster,
        distributed.Client(cluster) as client,
    ):

        def there():
            return float(sum(client.run(time.process_time).values()))

        def render(**how):
            # A new camera: what feeds the pixels of one that was rendered before would be known to threads.
            anew = dataclasses.replace(camera, sensor=dataclasses.replace(camera.sensor))
            return pl.render(scene, anew, **how, **given)

        pixels = int(np.prod(camera.sensor.shape)) if not quick else 32 * 32
        # Kernels and the workers' imports: what a later render does not pay.
        first, cpu = time.perf_counter(), there()
        pl.render(scene, camera, samples=2, region=np.s_[240:256, 240:256], client=client, progress=False)
        started, start_cpu = time.perf_counter() - first, there() - cpu
        render(threads=2, **({} if quick else {"region": np.s_[240:272, 240:272]}))
        watched, rows = Watched(), []
        for turn in range(1 if quick else 2):
            on_threads = _cost(lambda: render(threads=2), lambda: 0.0)
            with watched:
                on_cluster = _cost(lambda: render(client=client), there)
            rows.append((turn + 1, *on_threads[:2], *on_cluster))
        a, b = np.array(rows).min(axis=0), pixels
        wall, cpu_ratio = a[1] / a[3], a[2] / (a[4] + a[5])
    remark = (
        f"{pixels} pixels, {given['samples']} samples. Efficiency of the best: {wall:.2f} by the clock, "
        f"{cpu_ratio:.2f} by processors (wanted: {WANTED}). The scheduler is in the client's process. "
        f"The first render of workers began after {started:.1f} s, {start_cpu:.1f} s of processors."
    )
    columns = "round | wall s, threads | CPU s, threads | wall s, cluster | CPU s, client | CPU s, workers"
    yield Table("Two processes of one thread against two threads, `objects`", columns, rows, [remark])
    turns, moved = len(rows), float(sum(watched.brought)) / len(rows)
    tasks, brought = np.array(watched.tasks), np.array(watched.brought) / 1e6
    columns = "tasks a render | s, median | s, longest | MB brought, median | MB in all | bytes a pixel | MB sent"
    row = len(tasks) // turns, np.median(tasks), tasks.max(), np.median(brought), moved / 1e6, moved / b
    yield Table("Tasks", columns, [(*map(float, row), subject_bytes(scene, camera) / 1e6)])
    each, byte = of_empty_tasks(quick=quick)
    path = watched.cpu / turns / (b * given["samples"])
    measured = cluster_model.Measured(path, each, byte, watched.take / watched.pixels, started, started / 3)
    row = (1e6 * path, 1e3 * each, 1e9 * byte, 1e9 * measured.take, started)
    yield Table(
        "What the model is fed with", "us a path | ms a task | ns a byte | ns a pixel taken | s to start", [row]
    )
    yield model(measured)


def subject_bytes(scene, camera):
    """Of what every worker gets once."""
    return len(pickle.dumps(Subject(scene, camera)))


def model(measured):
    rows, renders = [], (("64 samples", "FEW"), ("1024 samples", "MANY"), ("target 2 %", "ADAPTIVE"))
    for (name, rounds), megapixels, workers in itertools.product(renders, (16, 40), WORKERS):
        found = cluster_model.estimated(measured, megapixels, workers, getattr(cluster_model, rounds))
        shares = (found.efficiency, found.client, found.setup, found.idle)
        percent = [f"{100 * share:.0f}" for share in shares]
        rows.append((name, megapixels, workers, found.seconds, *percent, found.task, found.bytes / 1e9))
    columns = "render | Mpx | workers | s | efficiency % | client busy % | starting % | idle % | s a task | GB"
    return Table("Model of larger clusters, cold, one thread a worker", columns, rows)


def _cost(run, there):
    """Wall, processor seconds here, and those of workers."""
    elsewhere, wall, cpu = there(), time.perf_counter(), time.process_time()
    run()
    spent = time.perf_counter() - wall, time.process_time() - cpu
    return *spent, there() - elsewhere


def of_empty_tasks(*, quick):
    """Seconds of this process, scheduler and all, for a task that does nothing, and for a byte that one brings."""
    count, size = (20, 1 << 20) if quick else (200, 1 << 23)
    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=":0") as cluster,
        distributed.Client(cluster) as client,
    ):
        spent = []
        for nbytes in (1, 1, size):
            begin = time.process_time()
            for _ in range(count if nbytes == 1 else count // 5):
                client.submit(np.ones, nbytes // 8, pure=False).result()
            spent.append((time.process_time() - begin) / (count if nbytes == 1 else count // 5))
    return spent[1], max(spent[2] - spent[1], 0.0) / size
