"""What a checkpoint costs: bytes written, and time with and without one."""

import tempfile
from functools import partial
from pathlib import Path

import numpy as np
import reference
from table import Table
from timing import timed

import plenoptic as pl

SAMPLES = 4


def tables(*, quick):
    shape = (256, 256) if quick else (4096, 4096)
    camera = reference.camera(sensor=pl.Sensor(shape=shape, pixel_pitch=0.0055))
    render = partial(reference.exposed, None, camera, samples=SAMPLES, threads=2)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "state"
        render(checkpoint=Path(folder) / "warm", region=np.s_[:256, :256])
        files = {"none": None, "new": file, "finished": file}
        costs = {name: timed(render, checkpoint=to)[0] for name, to in files.items()}
        written = file.stat().st_size
    rows = []
    for name, cost in costs.items():
        size = written if name == "new" else 0
        speeds = size / 1e6, size / (shape[0] * shape[1]), size / 1e6 / cost.wall
        rows.append((name, *cost, cost.cpu / costs["none"].cpu, *speeds))
    remark = "A finished one has all tiles: they are read, and not rendered."
    title = f"Checkpoints: white image of {shape[0]} x {shape[1]} pixels, {SAMPLES} samples"
    columns = "checkpoint | wall s | CPU s | CPU of none | MB written | bytes per pixel | MB/s"
    yield Table(title, columns, rows, [remark])
