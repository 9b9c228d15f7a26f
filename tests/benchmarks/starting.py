"""What new processes take: the import, the first rendering from an empty and a warm cache, a large image's memory."""

import statistics
import tempfile

import reference
from table import Table
from timing import apart, in_new_process, memory, timed

import plenoptic as pl

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
    shape = (438, 657) if quick else (4384, 6576)  # a full-frame sensor
    apart(large, (16, 16))  # compiles
    row = f"{shape[0]} x {shape[1]}", *apart(large, shape)
    remark = "Peak resident memory of the whole process, libraries included."
    title = "Memory: white image at 1 sample per pixel, in a process of its own"
    yield Table(title, "rows x columns | threads | peak GiB | wanted below | wall s | CPU s", [row], [remark])


def starting(*, runs, scenes):
    in_new_process(IMPORT)  # writes byte code where there is none yet
    imports = [in_new_process(IMPORT) for _ in range(runs)]
    rows = [("import plenoptic", runs, *_medians(imports), "0.15")]
    for name in scenes:
        code = RENDER.format(scene=SCENES[name])
        with tempfile.TemporaryDirectory() as cache:
            rows.append((f"first rendering of {name}, empty cache", 1, *in_new_process(code, cache=cache), "11"))
            warm = [in_new_process(code, cache=cache) for _ in range(min(runs, 3))]
        rows.append((f"first rendering of {name}, warm cache", len(warm), *_medians(warm), "3"))
    remark = "Renderings have 32 x 32 pixels and 8 samples, and take all processors; importing and making camera and "
    remark += "scene included, and in the CPU time the processes that help to compile."
    return Table("Starting, in new processes", "what | runs | wall s | CPU s | wanted: wall s below", rows, [remark])


def large(shape):
    """A white image: threads, peak GiB, those wanted, seconds."""
    camera = reference.camera(sensor=pl.Sensor(shape=shape, pixel_pitch=0.0055))
    cost, shot = timed(reference.exposed, None, camera, samples=1)
    return [shot.stats.threads, memory("VmHWM") / 2**30, 2, *cost]


def _medians(runs):
    return tuple(statistics.median(column) for column in zip(*runs, strict=True))
