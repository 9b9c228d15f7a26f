"""A large exposure to the disk and back: zarr and EXR, one chunk of it by xarray, and made of 4 x 4 parts."""

import importlib
import tempfile
import time
from pathlib import Path

import numpy as np
from table import Table
from timing import apart, count_peak_anew, memory

import plenoptic as pl
from plenoptic.command.main import main

FULL, SMALL = (5120, 7840), (520, 700)
"""40 megapixels; two by two chunks."""
PARTS, MERGE = "write 4 x 4 parts", "merge them into a store"
STEPS = {"zarr": ("write", "read", "one chunk", PARTS, MERGE), "exr": ("write", "read", PARTS, MERGE)}


def tables(*, quick):
    shape = SMALL if quick else FULL
    with tempfile.TemporaryDirectory() as folder:
        rows = [
            (ending, step, *apart(measured, step, f"{folder}/shot.{ending}", shape))
            for ending, steps in STEPS.items()
            for step in steps
        ]
    title = f"An exposure of {shape[0]} x {shape[1]} pixels, three channels, standard error and depth"
    columns = "format | step | wall s | CPU s | on the disk MB | arrays MB | memory beside what was there before MB"
    yield Table(title, columns, rows)


def exposure(rows, columns, region=None):
    """Gradients, with noise of 5 % as of some hundred paths; a step in depth."""
    random = np.random.default_rng(1)
    y, x = (np.arange(n, dtype=np.float32) / n for n in (rows, columns))
    light = (1 + np.sin(40 * x) * np.cos(30 * y)[:, None])[:, :, None] * np.array([1.0, 0.8, 0.6], np.float32)
    error = (0.05 * np.sqrt(light)).astype(np.float32)
    image = light + error * random.standard_normal(light.shape, dtype=np.float32)
    depth = 400 + 30 * np.sin(5 * x.astype(float)) + np.where(y > 0.5, 100.0, 0.0)[:, None]
    truth = pl.GroundTruth(depth=depth + 1e-3 * random.random(depth.shape))
    return pl.Exposure(image, standard_error=error, truth=truth, samples=64, seed=1, region=region)


def measured(step, path, shape):
    """Of a step in a process of its own: seconds, and MB on the disk, of arrays and of memory."""
    _, _, xarray = (importlib.import_module(name) for name in ("OpenImageIO", "zarr", "xarray"))
    path = Path(path)
    shot = exposure(*shape) if step == "write" else None
    parts, whole = [path.with_name(f"{k}-{path.name}") for k in range(16)], path.with_name("whole.zarr")
    count_peak_anew()
    before, wall, cpu = memory(), time.perf_counter(), time.process_time()
    if step == "write":
        shot.save(path)
    elif step == PARTS:
        for k, part in enumerate(parts):
            rows, columns = (n // 4 for n in shape)
            row, column = rows * (k // 4), columns * (k % 4)
            exposure(rows, columns, (row, row + rows, column, column + columns)).save(part)
    elif step == MERGE:
        assert main(["merge", *map(str, parts), "-o", str(whole)]) == 0
    elif step == "read":
        pl.Exposure.load(path, limits=pl.images.FileLimits(file_size=1 << 34, memory=1 << 36))
    else:
        assert xarray.open_zarr(path).image[:512, :512].values.any()
    spent = time.perf_counter() - wall, time.process_time() - cpu
    made = {PARTS: parts, MERGE: [whole]}.get(step, [path])
    size = sum(file.stat().st_size for one in made for file in [one, *one.rglob("*")] if file.is_file())
    return [*spent, size / 1e6, 32 * shape[0] * shape[1] / 1e6, max(memory("VmHWM") - before, 0) / 1e6]
