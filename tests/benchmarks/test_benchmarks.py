"""Every benchmark runs at small size and prints whole tables; times are for people to judge."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
BENCHMARKS = sorted(path.stem for path in HERE.glob("*.py") if "\ndef tables(" in path.read_text())

pytestmark = pytest.mark.benchmark


def command(*options):
    paths = [str(HERE.parents[1]), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    return subprocess.run([sys.executable, str(HERE), *options], env=environment, capture_output=True, text=True)


@pytest.mark.parametrize("name", BENCHMARKS)
def test_prints_whole_tables(name):
    done = command("--quick", "--only", name)
    assert done.returncode == 0, done.stderr
    tables = re.findall(r"(?:^\|.*\n)+", done.stdout, flags=re.MULTILINE)
    assert tables and done.stdout.count("### ") == len(tables)
    for table in tables:
        rows = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in table.splitlines()]
        assert len(rows) >= 3
        assert {len(row) for row in rows} == {len(rows[0])}
        assert not {"nan", "inf", "None"} & {cell for row in rows for cell in row}


def test_an_unknown_one_is_named():
    assert len(BENCHMARKS) > 20
    done = command("--only", "tracing,soldering")
    assert done.returncode == 2 and "soldering" in done.stderr and all(name in done.stderr for name in BENCHMARKS)
