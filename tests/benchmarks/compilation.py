"""Worth of each deviation from Numba's pipeline: compile and run times without it over those with all."""

import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from table import Table

from plenoptic.core.numba.deviations import ALL

RENDER = """
import json, os, sys
import numpy as np, plenoptic as pl
import reference
def seconds(samples, scene, region):
    begin = sum(os.times()[:4])
    reference.exposed(scene, reference.camera(), samples=samples, region=region, threads=1)
    return sum(os.times()[:4]) - begin
scenes, small, large = [None, pl.objects_scene()], np.s_[240:272, 240:272], np.s_[128:384, 128:384]
first = sum(seconds(8, scene, small) for scene in scenes)
print(json.dumps([first, *(seconds(SAMPLES, scene, large) for scene in scenes)]))
"""
NONE = ""
NAMES = {NONE: "none", "1": "all"}


def tables(*, quick):
    variants = ["1", *(sorted(ALL - {"helper_processes"}) if not quick else [])]
    yield deviations(variants, compilations=1 if quick else 3, runs=1 if quick else 9, samples=1 if quick else 64)


def seconds(left_out, cache, samples):
    """CPU seconds of a process: of its first renders, and of a white image and `objects` afterwards."""
    here = Path(__file__).resolve().parent
    paths = os.pathsep.join([str(here), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {**os.environ, "PYTHONPATH": paths, "NUMBA_CACHE_DIR": cache, "PLENOPTIC_PLAIN_NUMBA": left_out}
    code = RENDER.replace("SAMPLES", str(samples))
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def deviations(variants, *, compilations, runs, samples):
    compiled = {one: [] for one in ["", *variants]}
    ran = {one: [] for one in compiled}
    with tempfile.TemporaryDirectory() as folder:
        for k in range(compilations):
            for one in compiled:
                compiled[one].append(seconds(one, f"{folder}/{k}-{one}", 1)[0])
        for _ in range(runs):
            for one in ran:
                ran[one].append(seconds(one, f"{folder}/0-{one}", samples)[1:])

    def ratio(values, reference):
        return statistics.median(value / other for value, other in zip(values, reference, strict=True))

    rows = [
        (
            NAMES.get(one, one),
            ratio(compiled[one], compiled[NONE]),
            *(ratio(*([times[i] for times in ran[each]] for each in (one, ""))) for i in (0, 1)),
        )
        for one in compiled
    ]
    return Table(
        "Deviations from Numba's pipeline",
        ("left out", "compiling", "white image", "`objects`"),
        rows,
        [
            f"CPU time over that with all deviations, in turns: medians of {compilations} first renders of a white "
            f"image and `objects` ({statistics.median(compiled[NONE]):.1f} s with all), and of {runs} renders of "
            f"256 x 256 pixels with {samples} samples; one thread."
        ],
    )
