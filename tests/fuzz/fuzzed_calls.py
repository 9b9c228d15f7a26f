"""Calls of the public API: valid ones, of whose arguments one to three are replaced by what nobody should give."""

import collections
import contextlib
import dataclasses
import datetime
import decimal
import faulthandler
import fractions
import math
import os
import random
import resource
import sys
import traceback
import warnings
from pathlib import Path

import numpy as np
from numba.core import event
from valid_calls import calls, camera, lens, rays, scene, shot

import plenoptic as pl
from plenoptic import lights, materials, optics, sensor
from plenoptic.errors import PlenopticError

HANGS = 120.0
"""s, after which the process ends with a traceback: nothing else can stop a kernel."""
LONGEST, MOST_BYTES = 20.0, 10**9
"""Of one call: s of CPU, unless something was compiled, and more memory than ever before."""

NUMBERS = (0, -0.0, 5e-324, 1e-300, -1e-300, 1e-30, 1e-15, 1e-5, 1e5, 1e15, 1e28, 1e38, 3.5e38, 1e300, -1e300)
NUMBERS += (math.inf, -math.inf, math.nan, -1, -7.5, 0.5, 1, 3, 1000, 1 << 20, 123456789, 1 << 31, 1 << 63, 1 << 64)
NUMBERS += (10**400, -(1 << 63), np.float16(6e4), np.float32(1e38), np.longdouble("1e4000"), np.uint64(2**64 - 1))
NUMBERS += (np.int8(-128), np.float64("nan"), True, np.False_, 1j, np.complex64(1 + 1j))
NUMBERS += (decimal.Decimal("1e999"), fractions.Fraction(1, 3), np.timedelta64(5, "s"), np.datetime64("2020-01-01"))
OTHERS = (None, "text", "", "12", b"x", [], (), {}, set(), {"a": 1}, [[1], [2, 3]], [1, [2]], [[[]]], object(), object)
OTHERS += (np.array([]), np.ones(3), np.ones((2, 2)), np.zeros((0, 3)), np.full(3, np.nan), np.full((3, 3), 1e300))
OTHERS += (np.array(5), np.array([None, 1.0]), np.array(["a"]), np.array([1, 2**70], dtype=object), np.zeros(3, bool))
OTHERS += (np.ones(3, np.complex128), np.ma.masked, np.zeros((2, 2, 2, 2)), range(3), slice(None), slice(2, None, -1))
OTHERS += (len, datetime.date(2020, 1, 1), pl.Truth.DEPTH, pl.Lattice.SQUARE, Ellipsis, NotImplemented)
OTHERS += (memoryview(b"a"), float("1e-10"), np.zeros((3, 0)), bytearray(3), iter, math, (1, 2), (1, 2, 3), [1e38] * 3)
OTHERS += ([1e300] * 3,)


def spoiled(rnd, given):
    """A value in place of the given one; of a sequence, sometimes one of its items."""
    if isinstance(given, tuple | list) and given and rnd.random() < 0.6:
        at = rnd.randrange(len(given))
        return type(given)([*given[:at], spoiled(rnd, given[at]), *given[at + 1 :]])
    if isinstance(given, np.ndarray) and given.size and given.dtype.kind in "iuf" and rnd.random() < 0.5:
        changed = given.astype(np.float64)
        changed[tuple(rnd.randrange(n) for n in given.shape)] = float(rnd.choice(NUMBERS[:26]))
        return changed
    chosen = rnd.random()
    if chosen < 0.4 and type(given) in (float, int) and abs(given) < 1e300:
        scaled = float(given) * 10.0 ** rnd.uniform(-rnd.choice((1, 4, 12)), rnd.choice((1, 4, 12)))
        return scaled if isinstance(given, float) or abs(scaled) > 1e6 else round(scaled)
    if chosen < 0.45:
        return (i for i in range(3))
    return rnd.choice(NUMBERS) if chosen < 0.8 else rnd.choice(OTHERS)


def use(made):
    """What users do next with what they made: a value that was accepted must work, or be refused where it is used."""
    repr(made)
    if isinstance(made, pl.CircularStop | pl.PolygonStop | pl.StarStop | optics.MaskStop):
        assert made.area >= 0 and made.outline().shape[1] == 2
        made = lens().with_stop(made)
    if isinstance(made, pl.Surface):
        made = pl.LensStack([pl.CircularStop(2.0, thickness=1.0), made, pl.Surface(-80.0, semi_diameter=9.0)])
    if isinstance(made, pl.LensStack):
        made.check()
        made.trace(rays(), threads=1)
        # Cameras look at freeform lenses from 16 sides, for seconds.
        made = {"lens": made} if all(getattr(e, "freeform", None) is None for e in made.elements) else None
    parts = {pl.Sensor: "sensor", pl.MicrolensArray: "microlenses", pl.Pose: "pose", sensor.Sensitivity: "sensitivity"}
    parts[pl.Blemishes] = "blemishes"
    if type(made) in parts:
        made = {parts[type(made)]: made}
    if isinstance(made, dict) and made:
        made = dataclasses.replace(camera(), **made)
    if isinstance(made, pl.PlenopticCamera):
        rows, columns = made.sensor.shape
        middle = (slice(rows // 2, rows // 2 + 2), slice(columns // 2, columns // 2 + 2))
        image = pl.render_white(made, samples=4, region=middle, progress=False, threads=1).image
        assert np.isfinite(image).all()
    if isinstance(made, materials.HenyeyGreenstein):
        made = materials.Medium(scattering=0.01, phase=made)
    if isinstance(made, materials.Medium):
        made = materials.Dielectric(1.0, medium=made)
    if type(made) in materials.__dict__.values() and not isinstance(made, materials.Texture):
        made = pl.box(50.0, material=made).translated(z=-400.0)
    if isinstance(made, pl.Mesh | pl.scene.Instances):
        made = pl.Scene([made], background=0.1)
    if isinstance(made, lights.Sheet):
        particles = pl.Points([(0.0, 0.0, -400.0)], sheet=made, cross_section=1.0)
        made = dataclasses.replace(scene().with_lights([made]), points=particles)
    if isinstance(made, pl.Points):
        made = pl.Scene(points=made)
    if type(made) in lights.__dict__.values():
        made = scene().with_lights([made]) if not isinstance(made, pl.EnvironmentMap) else pl.Scene([], [], made)
    if isinstance(made, pl.Scene):
        shown = {"samples": 4, "region": np.s_[6:8, 6:8], "progress": False, "threads": 1, "max_bounces": 2}
        assert np.isfinite(pl.render(made, camera(), **shown).image).all()
    if isinstance(made, pl.SensorModel):
        shot().develop(made)


def spoil(rnd, arguments):
    """Arguments with one to three of them replaced, and which these are."""
    changed = dict(arguments)
    for _ in range(rnd.choice((1, 1, 2, 3))):
        which = rnd.choice(list(arguments))
        changed[which] = spoiled(rnd, changed[which])
    return changed


def shown(arguments, changed):
    """What was replaced, in short."""
    parts = []
    for name, value in changed.items():
        if value is not arguments[name]:
            with contextlib.suppress(Exception):
                parts.append(f"{name}={value!r:.80}")
    return ", ".join(parts)


def findings(seed, count, names=None, *, used=True):
    """What went wrong in random calls (an error not the package's, too long, too large), and how many ended well."""
    table = calls()
    for name, (function, arguments) in table.items():
        if names is None or name in names:
            made = function(**arguments)  # what is valid is accepted, and its kernels are compiled
            if used:
                use(made)
    wrong, ended = [], collections.Counter()
    for i in range(count):
        rnd = random.Random(f"{seed}-{i}")
        name = rnd.choice(sorted(table if names is None else names))
        function, arguments = table[name]
        changed = spoil(rnd, arguments)
        memory, begin = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, os.times().user
        faulthandler.dump_traceback_later(HANGS, exit=True)
        found = ""
        with event.install_recorder("numba:compile") as compiled:
            try:
                made = function(**changed)
                if used:
                    use(made)
                ended["accepted"] += 1
            except PlenopticError as error:
                ended["refused"] += 1
                found = "" if len(str(error).split()) >= 4 else f"no sentence: {error}"
            except Exception as error:
                place = traceback.extract_tb(error.__traceback__)[-1]
                found = f"{type(error).__name__}: {error} ({place.filename}:{place.lineno})"
        faulthandler.cancel_dump_traceback_later()
        took = os.times().user - begin
        more = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory) * (1 if sys.platform == "darwin" else 1024)
        if took > LONGEST and not compiled.buffer:
            found = f"took {took:.1f} s"
        if more > MOST_BYTES:
            found = f"took {more / 1e9:.1f} GB"
        if found:
            wrong.append(f"{seed}-{i}: {name}({shown(arguments, changed)}): {found}")
    return wrong, ended


def main(seed, count):
    """In a process of its own, whose memory ends where a call asks for far more than it may."""
    warnings.simplefilter("ignore")
    calls()
    in_use = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (in_use + 4 * MOST_BYTES, resource.RLIM_INFINITY))
    wrong, ended = findings(seed, count)
    print(*wrong, f"{count} calls: {dict(ended)}, {len(wrong)} wrong", sep="\n")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), int(sys.argv[2])))
