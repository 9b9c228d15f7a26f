"""Print timings as Markdown tables: ``python tests/benchmarks [--quick] [--only tracing,waves]``."""

import argparse
import importlib
import importlib.metadata
import os
import platform
import time
from pathlib import Path

BENCHMARKS = sorted(path.stem for path in Path(__file__).parent.glob("*.py") if "\ndef tables(" in path.read_text())
PROGRAMS = ("plenoptic-camera", "numpy", "numba", "embreex", "trimesh", "OpenImageIO", "batoid", "mitsuba")


def main():
    parser = argparse.ArgumentParser(prog="python tests/benchmarks", description="Print timings as Markdown tables.")
    parser.add_argument("--only", default=",".join(BENCHMARKS), help=f"some of {', '.join(BENCHMARKS)}")
    parser.add_argument("--quick", action="store_true", help="small sizes: shows that all works, not how fast")
    options = parser.parse_args()
    chosen = options.only.split(",")
    unknown = sorted(set(chosen) - set(BENCHMARKS))
    if unknown:
        parser.error(f"--only has {', '.join(unknown)}; it may have {', '.join(BENCHMARKS)}")
    print(f"{surroundings()}\n", flush=True)
    for name in chosen:
        begin = time.perf_counter()
        for table in importlib.import_module(name).tables(quick=options.quick):
            print(table.markdown(), flush=True)
        print(f"`{name}` took {time.perf_counter() - begin:.0f} s.\n", flush=True)


def surroundings():
    """Versions, processors and how busy these are with other things."""
    versions = [f"Python {platform.python_version()}", *map(_version, PROGRAMS)]
    load = f", load average {os.getloadavg()[0]:.1f} at the start" if hasattr(os, "getloadavg") else ""
    name = next((line.split(":")[1].strip() for line in _cpuinfo() if line.startswith("model name")), "unknown")
    machine = f"{platform.system()} {platform.machine()}, {os.cpu_count()} processors ({name})"
    return f"{', '.join(versions)}; {machine}{load}"


def _cpuinfo():
    path = Path("/proc/cpuinfo")
    return path.read_text().splitlines() if path.exists() else []


def _version(program):
    try:
        return f"{program} {importlib.metadata.version(program)}"
    except importlib.metadata.PackageNotFoundError:
        return f"{program} (not installed)"


if __name__ == "__main__":
    main()
