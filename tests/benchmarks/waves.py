"""Images of points as waves: what they cost, how sure they are, and how far they are from rays."""

import numpy as np
from starting import in_new_process
from table import Table

import plenoptic as pl
from plenoptic.wave.grid import DENSER
from plenoptic.wave.patterns import _added, _of_wavelength

CAMERA = """
import plenoptic as pl
camera = pl.PlenopticCamera(
    lens=pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter={stop})),
    microlenses=pl.MicrolensArray(pitch={pitch}, focal_lengths=(2.0,)),
    sensor=pl.Sensor(shape=(512, 512), pixel_pitch=0.010),
    stop_to_microlenses={z}, microlenses_to_sensor={b},
)
"""
COST = """
import json, time
peak = lambda: next(int(line.split()[1]) for line in open("/proc/self/status") if line.startswith("VmHWM")) / 1024
camera.lens.trace(pl.RayBundle([[0, 0, -100]], [[0, 0, 1]]))  # compiles
cpu = time.process_time()
pl.wave.point_spread(camera, {point})
print(json.dumps([time.process_time() - cpu, peak()]))
"""
CASES = (
    ("1.0, in focus", {"stop": 5.0, "pitch": 0.217, "z": 134.6, "b": 2.0}, (3.0, 1.0, -404.0)),
    ("1.0, near", {"stop": 5.0, "pitch": 0.217, "z": 134.6, "b": 2.0}, (3.0, 1.0, -380.0)),
    ("2.0", {"stop": 5.0, "pitch": 0.217, "z": 123.3, "b": 1.7}, (3.0, 1.0, -404.0)),
)


def tables(*, quick):
    rows = []
    for name, numbers, point in CASES[:1] if quick else CASES:
        made = {}
        exec(CAMERA.format(**numbers), made)
        camera = made["camera"]
        cpu, peak = in_new_process(CAMERA.format(**numbers) + COST.format(point=point, **numbers))
        parts = [_of_wavelength(camera, np.array(point), denser) for denser in (DENSER, 2 * DENSER)]
        given = camera, np.array(point), np.array([camera.wavelength]), np.ones(1)
        once, twice = (_added(*given, [part]) for part in parts)
        rays = pl.point_spread(camera, point, progress=False).whole()
        told, whole = once.samplings[0], once.whole()
        errors = [100 * value for value in (told.error, off(whole, twice.whole()), off(whole, rays))]
        rows.append((name, "{} x {}".format(*told.shape.tolist()), cpu, int(peak), *errors))
    remark = (
        "Light in other places, over all light, against twice as dense samples and against rays. The peak is that "
        "of a process of its own, some 200 MiB of which are libraries."
    )
    columns = "camera | samples | CPU s | peak MiB | stated error, % | twice as dense, % | rays, %"
    yield Table("Images of points as waves, 587.6 nm, pixels of 10 um", columns, rows, [remark])


def off(image, other):
    return float(np.abs(image - other).sum() / other.sum())
