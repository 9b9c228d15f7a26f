"""Peak memory of a large white image."""

from starting import in_new_process
from table import Table

FULL, SMALL = (4384, 6576), (438, 657)
PIXEL_PITCH = 0.0055  # mm: a full-frame sensor

# On Linux a process that has only just been started inherits `ru_maxrss` from the one that started it, here a
# benchmark with arrays of its own; VmHWM is the same peak and begins anew.
CODE = """
import json, resource, sys, time
wall, cpu = time.perf_counter(), time.process_time()
import reference, plenoptic as pl
camera = reference.camera(sensor=pl.Sensor(shape={shape}, pixel_pitch={pitch}))
shot = pl.render_white(camera, samples=1, progress=False)
spent = time.perf_counter() - wall, time.process_time() - cpu
unit = 1 if sys.platform == "darwin" else 1024
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
if sys.platform == "linux":
    peak = next(1024 * int(line.split()[1]) for line in open("/proc/self/status") if line.startswith("VmHWM"))
print(json.dumps([peak / 2**30, *spent, shot.stats.threads]))
"""


def tables(*, quick):
    shape = SMALL if quick else FULL
    code = CODE.format(shape=shape, pitch=PIXEL_PITCH)
    in_new_process(CODE.format(shape=(16, 16), pitch=PIXEL_PITCH))  # compiles
    peak, wall, cpu, threads = in_new_process(code)
    remark = "Peak resident memory of the whole process, libraries included."
    title = "Memory: white image at 1 sample per pixel, in a process of its own"
    rows = [(f"{shape[0]} x {shape[1]}", int(threads), peak, 2, wall, cpu)]
    yield Table(title, "rows x columns | threads | peak GiB | wanted below | wall s | CPU s", rows, [remark])
