"""What a checkpoint costs: bytes written, and time with and without one."""

import tempfile
from pathlib import Path

import numpy as np
import reference
from table import Table
from timing import Task, cost_of

import plenoptic as pl

FULL, SMALL = (4096, 4096), (256, 256)
PIXEL_PITCH = 0.0055  # mm
SAMPLES = 4


def tables(*, quick):
    shape = SMALL if quick else FULL
    camera = reference.camera(sensor=pl.Sensor(shape=shape, pixel_pitch=PIXEL_PITCH))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "state"

        def rendered(checkpoint, region=None):
            return reference.exposed(None, camera, samples=SAMPLES, threads=2, region=region, checkpoint=checkpoint)

        rendered(Path(folder) / "warm", np.s_[:256, :256])
        files = {"none": None, "new": file, "finished": file}
        costs = {name: cost_of(Task(lambda _, to=to: rendered(to))) for name, to in files.items()}
        size = file.stat().st_size
    pixels = shape[0] * shape[1]
    remark = "A finished one has all tiles: they are read, and not rendered."
    title = f"Checkpoints: white image of {shape[0]} x {shape[1]} pixels, {SAMPLES} samples"
    columns = "checkpoint | wall s | CPU s | CPU of none | MB written | bytes per pixel | MB/s"
    rows = [_row(name, cost, costs["none"], size if name == "new" else 0, pixels) for name, cost in costs.items()]
    yield Table(title, columns, rows, [remark])


def _row(name, cost, without, size, pixels):
    return name, cost.wall, cost.cpu, cost.cpu / without.cpu, size / 1e6, size / pixels, size / 1e6 / cost.wall
