"""CPU time and error of this version beside another that is installed: PLENOPTIC_BEFORE names its Python interpreter.

Processes of both take turns. Where it is not set, this version is compared with itself, which shows what the machine's
other work does to the ratios.
"""

import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from table import Table

RENDER = """
import json, os, sys
import numpy as np, plenoptic as pl
import reference
def cpu():
    return sum(os.times()[:4])
def mean_error(samples, side):
    shot = reference.exposed(scene, reference.camera(), samples=samples, region=reference.middle(side), threads=1)
    return float(100 * np.sqrt(np.square(shot.standard_error).mean()) / shot.image.mean())
printed = []
for scene in None, pl.objects_scene():
    mean_error(8, 32)
    printed.append(cpu())  # of the process: importing, and compiling or loading
    begin, error = cpu(), mean_error(int(sys.argv[1]), 256)
    printed += [cpu() - begin, error]
print(json.dumps(printed))
"""
COLUMNS = ("first render of a white image", "white image", "", "and of `objects`", "`objects`", "")


def tables(*, quick):
    here, rounds, samples = Path(sys.executable), 1 if quick else 9, 8 if quick else 64
    other = Path(os.environ.get("PLENOPTIC_BEFORE", here))
    folder, pythons = Path(__file__).resolve().parent, {"before": other, "now": here}
    found = {(version, state): [] for state in ("cold", "warm") for version in pythons}
    for _ in range(1 if quick else 3):
        with tempfile.TemporaryDirectory() as caches:
            for turn in range(1 + rounds):
                for version, python in pythons.items():
                    paths = [str(folder), *([str(folder.parents[1])] if python == here else [])]
                    environment = {"PYTHONPATH": os.pathsep.join(paths)}
                    if not quick:
                        environment["NUMBA_CACHE_DIR"] = f"{caches}/{version}"
                    command = [python, "-P", "-c", RENDER, str(samples)]
                    done = subprocess.run(command, env=os.environ | environment, stdout=subprocess.PIPE, check=True)
                    found[version, "warm" if turn else "cold"].append(json.loads(done.stdout))
    rows = []
    for name, state, k in (
        *((f"{COLUMNS[k]}, {state} cache", state, k) for k in (0, 3) for state in ("cold", "warm")),
        *((f"{COLUMNS[k]}, 256 x 256 pixels, {samples} samples", "warm", k) for k in (1, 4)),
    ):
        before, now = ([run[k] for run in found[version, state]] for version in pythons)
        errors = [found[version, state][0][k + 1] if k % 3 else "" for version in pythons]
        ratio = statistics.median(b / a for a, b in zip(before, now, strict=True))
        rows.append((name, statistics.median(before), statistics.median(now), ratio, *errors))
    remark = f"One thread; medians of {len(found['now', 'cold'])} cold and {len(found['now', 'warm'])} warm processes."
    columns = "CPU s | before | now | ratio, median | error % of the mean, before | now"
    yield Table("This version beside another", columns, rows, [remark])
