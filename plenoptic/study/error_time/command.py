"""The error study from the command line: ``python -m plenoptic.study error-against-time``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from plenoptic.errors import FileError, InvalidValueError
from plenoptic.rendering.schedule.budget import checked_target
from plenoptic.study.error_time.cases import case_table, error_case, error_cases
from plenoptic.study.error_time.document import error_document, load_now
from plenoptic.study.error_time.table import ErrorTable
from plenoptic.study.error_time.text import csv_of
from plenoptic.study.options import add_render_options, study_command


def add_command(subparsers: Any) -> None:
    """Add ``error-against-time`` to the studies of a parser."""
    text = "error against run time of the bundled cases"
    one = study_command(subparsers, "error-against-time", text, run=_run, quick="few pixels, seeds and samples")
    add_render_options(one)
    one.epilog = "Cases: " + " ".join(f"{name}: {error_case(name).what}" for name in error_cases())
    one.add_argument("--case", nargs="+", choices=error_cases(), help="which cases; all by default")
    one.add_argument("--target", type=float, action="append", help="recommend a setting for this error, such as 0.01")
    one.add_argument("--document", action="store_true", help="print the document on error and time")
    one.add_argument("--plot", metavar="FILE", help="draw all cases; a document refers to it as images/FILE")


def _run(options: argparse.Namespace) -> int:
    cases = [error_case(name) for name in dict.fromkeys(options.case or error_cases())]
    targets: list[float] = options.target or []
    for target in targets:
        checked_target(target, "--target")  # before minutes are spent
    for path in filter(None, (options.csv, options.plot)):
        if not Path(path).absolute().parent.is_dir():
            raise FileError(f"{path!r} cannot be written: there is no such folder; make it first")
    load = load_now()
    studies = []
    for case in cases:
        table = case_table(case, quick=options.quick, threads=options.threads, progress=options.progress)
        studies.append((case, table))
        if not options.document:
            _print(table, targets, markdown=options.markdown)
    tables = [table for _, table in studies]
    if options.csv:
        csv_of(tables, options.csv)
    if options.plot:
        _draw(tables, options.plot)
    if options.document:
        figure = f"images/{Path(options.plot).name}" if options.plot else None
        print(error_document(studies, load=load, figure=figure), end="")
    return 0


def _print(table: ErrorTable, targets: list[float], *, markdown: bool) -> None:
    print(f"### `{table.title}`\n\n{table.to_markdown()}\n" if markdown else f"{table}\n")
    for target in targets:
        print(f"{_recommended(table, target)}\n", flush=True)


def _recommended(table: ErrorTable, target: float) -> str:
    try:
        return f"For {100 * target:g} %: {table.recommend(target)}"
    except InvalidValueError as error:
        return str(error)


def _draw(tables: list[ErrorTable], path: str) -> None:
    from plenoptic.plots.error_time import plot_error_studies

    try:
        plot_error_studies(tables).savefig(path, dpi=110)
    except (OSError, ValueError) as error:
        raise FileError(f"{path!r} cannot be written: {error}; it must end in .png, .svg or .pdf") from error
