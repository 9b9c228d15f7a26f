"""Images of points as waves: what they cost, how sure they are, and how far they are from rays."""

import numpy as np
import reference
from table import Table
from timing import apart, memory, timed

import plenoptic as pl
from plenoptic.wave.grid import OVERSAMPLING
from plenoptic.wave.point_image import _add_images, _image_at

UNFOCUSED = {"stop": 5.0, "z": 134.6, "b": 2.0}
CASES = (
    ("1.0, in focus", UNFOCUSED, (3.0, 1.0, -404.0)),
    ("1.0, near", UNFOCUSED, (3.0, 1.0, -380.0)),
    ("2.0", {}, (3.0, 1.0, -404.0)),
)


def tables(*, quick):
    rows = []
    for name, changes, point in CASES[:1] if quick else CASES:
        camera = reference.built((512, 512), **changes)
        cpu, peak = apart(cost, changes, point)
        parts = [_image_at(camera, np.array(point), denser) for denser in (OVERSAMPLING, 2 * OVERSAMPLING)]
        given = camera, np.array(point), np.array([camera.wavelength]), np.ones(1)
        once, twice = (_add_images(*given, [part]) for part in parts)
        rays = pl.point_spread(camera, point, progress=False).whole()
        told, whole = once.samplings[0], once.whole()
        errors = [100 * value for value in (told.error, off(whole, twice.whole()), off(whole, rays))]
        rows.append((name, "{} x {}".format(*told.shape.tolist()), cpu, int(peak), *errors))
    remark = "Light in other places, over all light, against twice as dense samples and against rays. The peak is that "
    remark += "of a process of its own, some 200 MiB of which are libraries."
    columns = "camera | samples | CPU s | peak MiB | stated error, % | twice as dense, % | rays, %"
    yield Table("Images of points as waves, 587.6 nm, pixels of 10 um", columns, rows, [remark])


def cost(changes, point):
    """CPU seconds of an image, and the peak of the memory, MiB."""
    camera = reference.built((512, 512), **changes)
    camera.lens.trace(pl.RayBundle([[0, 0, -100]], [[0, 0, 1]]))  # compiles
    spent, _ = timed(pl.wave.point_spread, camera, point)
    return [spent.cpu, memory("VmHWM") / 2**20]


def off(image, other):
    return float(np.abs(image - other).sum() / other.sum())
