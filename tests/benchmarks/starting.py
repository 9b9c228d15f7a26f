"""What starting costs: the import, and the first rendering from an empty and from a warm cache of kernels."""

import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from table import Table

IMPORT = """
import json, time
wall, cpu = time.perf_counter(), time.process_time()
import plenoptic
print(json.dumps([time.perf_counter() - wall, time.process_time() - cpu]))
"""
RENDER = """
import json, os, time
wall = time.perf_counter()
import reference
import numpy as np, plenoptic as pl
scene = {scene}
reference.exposed(scene, reference.camera(), samples=8, region=np.s_[240:272, 240:272])
print(json.dumps([time.perf_counter() - wall, sum(os.times()[:4])]))
"""
SCENES = {"white": "None", "check": "pl.check_scene()", "objects": "pl.objects_scene()"}
SCENES |= {"still life": "pl.still_life()"}


def tables(*, quick):
    yield starting(runs=1 if quick else 7, scenes=("white",) if quick else tuple(SCENES))


def in_new_process(code, cache=None):
    """What a program prints as JSON; its kernels are cached in a folder of its own where one is given."""
    here = Path(__file__).resolve().parent
    paths = [str(here), str(here.parents[1]), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    if cache is not None:
        environment["NUMBA_CACHE_DIR"] = str(cache)
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"a timed process failed with exit code {done.returncode}:\n{done.stderr}")
    return list(json.loads(done.stdout.splitlines()[-1]))


def starting(*, runs, scenes):
    in_new_process(IMPORT)  # writes byte code where there is none yet
    imports = [in_new_process(IMPORT) for _ in range(runs)]
    rows = [("import plenoptic", runs, *_medians(imports), "0.15")]
    for name in scenes:
        code = RENDER.format(scene=SCENES[name])
        with tempfile.TemporaryDirectory() as cache:
            rows.append((f"first rendering of {name}, empty cache", 1, *in_new_process(code, cache), "11"))
            warm = [in_new_process(code, cache) for _ in range(min(runs, 3))]
        rows.append((f"first rendering of {name}, warm cache", len(warm), *_medians(warm), "3"))
    remark = (
        "Renderings have 32 x 32 pixels and 8 samples, and take all processors; importing and making camera and "
        "scene included, and in the CPU time the processes that help to compile."
    )
    return Table("Starting, in new processes", "what | runs | wall s | CPU s | wanted: wall s below", rows, [remark])


def _medians(runs):
    return tuple(statistics.median(column) for column in zip(*runs, strict=True))
