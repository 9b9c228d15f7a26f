"""The document on error and time, written by ``plenoptic study error-against-time --document``."""

from __future__ import annotations

import datetime
import importlib.metadata
import os
import platform
from collections.abc import Sequence
from pathlib import Path

from plenoptic.errors import InvalidValueError
from plenoptic.study.error_time.cases import ErrorCase
from plenoptic.study.error_time.table import ErrorTable
from plenoptic.study.text_table import markdown_table

TARGETS = (0.05, 0.02, 0.01, 0.005)
"""Errors for which the document recommends a setting."""

_LIBRARIES = ("numpy", "numba", "embreex")

_WORDS = """\
Each case is rendered in several ways (variants), each with several numbers of samples and several seeds, and compared
with a converged reference. The first variant is the camera as it is: exact lens, thin microlenses, scrambled Sobol
points in 2 replicates, depth limit 8. All others differ from it in what their name says.

## What the numbers are

- **Lit pixels**: those whose mean over the channels is above 0.1 of the 99th percentile of these means in the
  reference, black pixels left out. Only they count.
- **Relative error**: for each lit pixel, the mean over the channels of (image - reference)^2, over the squared mean
  over the channels of the reference; of this the mean over lit pixels, and the root. The reference's own squared error,
  known from its standard errors, is subtracted.
- **Noise**: the part that differs from seed to seed, from the sample variance among seeds. **Bias**: the part that all
  seeds share: the squared difference of their mean from the reference, minus what the noise of both explains. The
  squared error is the sum of both squares. Where the squared bias is less than three of its standard errors above 0, it
  cannot be told from 0, and the table says what it is below with 97.7 % confidence.
- **True / reported**: noise among seeds over the noise that the standard errors of the renders report; 1 where they
  are right. With few samples under bright lights it is below 1: a pixel whose samples all agree is told the error of
  a single sample. Empty with one replicate, which has no standard error.
- **Slope**: of the logarithm of the noise against that of the number of samples. Independent samples give -0.5.
- **Time**: CPU time of all threads of a whole call, and wall time; medians over the seeds, with kernels compiled, and
  pupils and the scene's tree known from a call before. **Setting up**: a call that renders one path. "Without setting
  up" is the difference. Variants take turns, so that what disturbs the machine disturbs all of them.
- **Front** (Pareto): marked where no other row is both faster and better.
- **Recommendations**: the variant with the least CPU time for an error. Between and beyond its rows the variance is
  taken as a power of the number of samples; where the number of samples is beyond those measured, "extrapolated" is
  said."""


def error_document(
    studies: Sequence[tuple[ErrorCase, ErrorTable]], *, load: str | None = None, figure: str | None = None
) -> str:
    """The whole document as Markdown, with the text of `load_now`, and the file of a figure of all studies."""
    if not studies:
        raise InvalidValueError("there is no study; give at least one")
    names = " ".join(case.name for case, _ in studies)
    parts = [
        "# Error against time",
        f"Written by `plenoptic study error-against-time --case {names} --document"
        f"{'' if figure is None else ' --plot ' + figure.rpartition('/')[2]}` on {datetime.date.today().isoformat()}.",
        _WORDS,
        "## The machine",
        _machine(load_now() if load is None else load),
    ]
    if figure is not None:
        parts.append(f"![Error against CPU time]({figure})")
    return "\n\n".join([*parts, *(_section(case, table) for case, table in studies)]) + "\n"


def _section(case: ErrorCase, table: ErrorTable) -> str:
    """One case: its table, slopes and floors, recommendations."""
    threads = f"{table.threads} thread{'s' * (table.threads != 1)}"
    facts = (
        f"{case.what} The central {table.pixels} pixels, of which {table.lit_pixels} are lit; {threads}; "
        f"{table.seeds} seeds a row. Reference of {table.reference_samples} samples, whose own error of "
        f"{100 * table.reference_error:.2g} % is subtracted."
    )
    columns = ("wanted error %", "cheapest", "samples", "CPU s", "wall s", "expected error %", "remarks")
    recommendations = markdown_table(columns, [_recommendation(table, target) for target in TARGETS])
    return "\n\n".join([f"## `{case.name}`", facts, table.to_markdown(), recommendations])


def _recommendation(table: ErrorTable, target: float) -> tuple[str, ...]:
    wanted = f"{100 * target:g}"
    try:
        found = table.recommend(target)
    except InvalidValueError:
        return (wanted, "none gets there", "", "", "", "", "")
    seconds = (f"{found.cpu_seconds:.3g}", f"{found.wall_seconds:.3g}")
    return (wanted, found.variant, str(found.samples), *seconds, f"{100 * found.error:.2g}", "; ".join(found.remarks))


def _machine(load: str) -> str:
    versions = [f"Python {platform.python_version()}", *(f"{name} {_version(name)}" for name in _LIBRARIES)]
    return "\n".join(
        [
            f"- Processor: {_processor_model()}, {os.cpu_count()} logical processors, {platform.system()}",
            f"- {', '.join(versions)}",
            f"- Load: {load}",
        ]
    )


def load_now() -> str:
    """Number of processes that ran in the last minute, in words."""
    if not hasattr(os, "getloadavg"):
        return "not known on this system"
    return f"{os.getloadavg()[0]:.1f} processes ran on average in the minute before the study"


def _processor_model() -> str:
    """The model of the processor, as the system names it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return (names[0] if names else platform.processor()) or platform.machine()


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return "(not installed)"
