"""A large exposure to the disk and back: zarr and EXR, one chunk of it by xarray, and made of 4 x 4 parts."""

import tempfile
from pathlib import Path

from starting import in_new_process
from table import Table

FULL, SMALL = (5120, 7840), (520, 700)
"""40 megapixels; two by two chunks."""

# Each step has a process of its own. Linux begins to count the peak anew where it is told so.
CODE = """
import json, sys, time
from pathlib import Path
import numpy as np, OpenImageIO, plenoptic as pl, xarray, zarr
from plenoptic.command.main import main

def memory(name):
    found = [line.split() for line in open("/proc/self/status") if line.startswith(name)] if LINUX else []
    return int(found[0][1]) / 1e3 if found else 0.0

def exposure(rows, columns, region=None):
    # Gradients, with noise of 5 % as of some hundred paths; a step in depth.
    random = np.random.default_rng(1)
    y, x = (np.arange(n, dtype=np.float32) / n for n in (rows, columns))
    light = (1 + np.sin(40 * x) * np.cos(30 * y)[:, None])[:, :, None] * np.array([1.0, 0.8, 0.6], np.float32)
    error = (0.05 * np.sqrt(light)).astype(np.float32)
    image = light + error * random.standard_normal(light.shape, dtype=np.float32)
    depth = 400 + 30 * np.sin(5 * x.astype(float)) + np.where(y > 0.5, 100.0, 0.0)[:, None]
    depth += 1e-3 * random.random(depth.shape)
    return pl.Exposure(image, standard_error=error, truth=pl.GroundTruth(depth=depth), samples=64, seed=1,
        region=region)

LINUX = sys.platform == "linux"
step, path, shape = sys.argv[1], Path(sys.argv[2]), {shape}
shot = exposure(*shape) if step == "write" else None
parts, whole = [path.with_name(f"{k}-{path.name}") for k in range(16)], path.with_name("whole.zarr")
if LINUX:
    Path("/proc/self/clear_refs").write_text("5")
before, wall, cpu = memory("VmRSS"), time.perf_counter(), time.process_time()
if step == "write":
    shot.save(path)
elif step == "write 4 x 4 parts":
    for k, part in enumerate(parts):
        (rows, row), (columns, column) = ((n // 4, n // 4 * place) for n, place in zip(shape, divmod(k, 4)))
        exposure(rows, columns, (row, row + rows, column, column + columns)).save(part)
elif step == "merge them into a store":
    assert main(["merge", *map(str, parts), "-o", str(whole)]) == 0
elif step == "read":
    pl.Exposure.load(path, limits=pl.images.FileLimits(file_size=1 << 34, memory=1 << 36))
else:
    assert xarray.open_zarr(path).image[:512, :512].values.any()
spent = time.perf_counter() - wall, time.process_time() - cpu
arrays = np.prod(shape) * 32 / 1e6
made = {"write 4 x 4 parts": parts, "merge them into a store": [whole]}.get(step, [path])
size = sum(file.stat().st_size for one in made for file in [one, *one.rglob("*")] if file.is_file()) / 1e6
print(json.dumps([*spent, size, arrays, max(memory("VmHWM") - before, 0.0)]))
"""


def tables(*, quick):
    shape = SMALL if quick else FULL
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for ending, steps in (("zarr", ("write", "read", "one chunk")), ("exr", ("write", "read"))):
            for step in (*steps, "write 4 x 4 parts", "merge them into a store"):
                code = CODE.replace("{shape}", str(shape)).replace("sys.argv[1]", repr(step))
                path = Path(folder) / f"shot.{ending}"
                wall, cpu, size, arrays, peak = in_new_process(code.replace("sys.argv[2]", repr(str(path))))
                rows.append((ending, step, wall, cpu, size, arrays, peak))
    title = f"An exposure of {shape[0]} x {shape[1]} pixels, three channels, standard error and depth"
    columns = "format | step | wall s | CPU s | on the disk MB | arrays MB | memory beside what was there before MB"
    yield Table(title, columns, rows)
