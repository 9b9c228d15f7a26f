"""Worth of each deviation from Numba's pipeline: compile and run times without it over those with all."""

import tempfile

import numpy as np
from table import Table
from timing import in_new_process

from plenoptic.core.numba.deviations import ALL

RENDER = """
import json, os, sys
import numpy as np, plenoptic as pl
import reference
def seconds(samples, scene, region):
    begin = sum(os.times()[:4])
    reference.exposed(scene, reference.camera(), samples=samples, region=region, threads=1)
    return sum(os.times()[:4]) - begin
scenes = None, pl.objects_scene()
first = sum(seconds(8, scene, reference.middle(32)) for scene in scenes)
print(json.dumps([first, *(seconds(int(sys.argv[1]), scene, reference.middle(256)) for scene in scenes)]))
"""
NONE = ""
NAMES = {NONE: "none", "1": "all"}


def tables(*, quick):
    compilations, runs, samples = (1, 1, 1) if quick else (3, 9, 64)
    variants = [NONE, "1", *(sorted(ALL - {"helper_processes"}) if not quick else [])]
    compiled, ran = ({one: [] for one in variants} for _ in range(2))
    with tempfile.TemporaryDirectory() as folder:

        def seconds(left_out, cache, samples):
            """CPU seconds of first renders, and of a white image and `objects` afterwards."""
            cache = None if quick else f"{folder}/{cache}"
            return in_new_process(RENDER, samples, cache=cache, PLENOPTIC_PLAIN_NUMBA=left_out)

        for k in range(compilations):
            for one in variants:
                compiled[one].append(seconds(one, f"{k}-{one}", 1)[:1])
        for _ in range(runs):
            for one in variants:
                ran[one].append(seconds(one, f"0-{one}", samples)[1:])

    def ratios(found, one):
        """Medians of the ratios to all deviations, by columns."""
        return np.median(np.divide(found[one], found[NONE]), axis=0).tolist()

    rows = [(NAMES.get(one, one), *ratios(compiled, one), *ratios(ran, one)) for one in variants]
    remark = (
        f"CPU time over that with all deviations, in turns: medians of {compilations} first renders of a white "
        f"image and `objects` ({np.median(compiled[NONE]):.1f} s with all), and of {runs} renders of "
        f"256 x 256 pixels with {samples} samples; one thread."
    )
    yield Table("Deviations from Numba's pipeline", "left out | compiling | white image | `objects`", rows, [remark])
