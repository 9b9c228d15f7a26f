"""Run a study of the simulator itself, and print its table."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from plenoptic.core.files.atomic_file import check_folder, real_path, replace_file
from plenoptic.errors import InvalidValueError

if TYPE_CHECKING:
    from plenoptic.study.error_time.cases import ErrorCase
    from plenoptic.study.error_time.table import ErrorTable

_BEYOND = 1
"""The exit code where something is beyond its bounds."""
_QUICK_COST, _THOROUGH_COST = (4, 2, 16), (32, 9, 128)
"""Samples, rounds and pixels along the side."""


def fill_parser(parser: argparse.ArgumentParser) -> None:
    """Add the studies; what they are about is imported only where one is asked for."""
    from plenoptic.study.cost.cases import COST_CASES
    from plenoptic.study.error_time.cases import ERROR_CASES
    from plenoptic.study.rounding.table import QUICK, THOROUGH

    studies = parser.add_subparsers(title="studies", required=True, metavar="NAME")

    text = "rounding errors of ray tracing against a trace with 50 digits"
    one = _command(studies, "stability", text, run=_stability, quick=f"{QUICK} rays a case")
    one.add_argument("--rays", type=int, help=f"rays a case ({THOROUGH})")
    one.add_argument("--seed", type=int, default=0, help="of the random rays (0)")
    one.add_argument("--only", action="append", help="cases whose name begins so; may be given several times")

    text, quick = "error against run time of the bundled cases", "few pixels, seeds and samples"
    one = _command(studies, "error-against-time", text, run=_error_against_time, quick=quick)
    _add_render_options(one)
    one.epilog = "Cases: " + " ".join(f"{case.name}: {case.what}" for case in ERROR_CASES.values())
    one.add_argument("--case", nargs="+", choices=tuple(ERROR_CASES), help="which cases; all by default")
    one.add_argument("--target", type=float, action="append", help="recommend a setting for this error, such as 0.01")
    one.add_argument("--document", action="store_true", help="print the document on error and time")
    one.add_argument("--plot", metavar="FILE", help="draw all cases; a document refers to it as images/FILE")

    text = "what each part of a render costs, by leaving it out"
    one = _command(studies, "cost", text, run=_cost, quick="few pixels, samples and rounds")
    _add_render_options(one)
    samples, rounds, side = _THOROUGH_COST
    one.add_argument("--case", choices=tuple(COST_CASES), default="check", help="which case (check)")
    one.add_argument("--samples", type=int, help=f"paths per pixel ({samples})")
    one.add_argument("--rounds", type=int, help=f"renders of each variant ({rounds})")
    one.add_argument("--side", type=int, help=f"pixels along the side of the square in the middle ({side})")
    one.add_argument("--plan", action="store_true", help="print the plan first")


def run(options: argparse.Namespace) -> int:
    """Print its table: 0, or 1 where something is beyond its bounds.

    What was measured before Ctrl-C is printed and written too.
    """
    run_study: Callable[[argparse.Namespace], int] = options.run_study
    return run_study(options)


def _command(
    studies: Any, name: str, text: str, *, run: Callable[[argparse.Namespace], int], quick: str
) -> argparse.ArgumentParser:
    one: argparse.ArgumentParser = studies.add_parser(name, help=text, description=text)
    one.set_defaults(run_study=run)
    one.add_argument("--quick", action="store_true", help=f"{quick}: to see that all works")
    one.add_argument("--markdown", action="store_true", help="print Markdown alone")
    return one


def _add_render_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--threads", type=int, default=1, help="of the renders that are timed (1)")
    parser.add_argument("--csv", metavar="FILE", help="write all rows as comma-separated values")
    show = argparse.BooleanOptionalAction
    parser.add_argument("--progress", action=show, default=sys.stderr.isatty(), help="in terminals")


def _stability(options: argparse.Namespace) -> int:
    from plenoptic.study.rounding.table import QUICK, THOROUGH, stability

    count = options.rays if options.rays is not None else QUICK if options.quick else THOROUGH
    table = stability(rays=count, seed=options.seed, only=options.only)
    print(table.to_markdown() if options.markdown else table)
    if not options.markdown:
        print(repr(table))
    elif not table.holds:
        print(repr(table), file=sys.stderr)
    if table.interrupted:
        raise KeyboardInterrupt
    return 0 if table.holds else _BEYOND


def _error_against_time(options: argparse.Namespace) -> int:
    from plenoptic.rendering.schedule.budget import checked_target
    from plenoptic.study.error_time.cases import ERROR_CASES, case_table
    from plenoptic.study.error_time.document import error_document, load_now
    from plenoptic.study.error_time.table import csv_of

    targets: list[float] = options.target or []
    for target in targets:
        checked_target(target, "--target")  # before minutes are spent
    for path in filter(None, (options.csv, options.plot)):
        check_folder(real_path(path))
    studies: list[tuple[ErrorCase, ErrorTable]] = []
    load, interrupted = load_now(), True
    for case in (ERROR_CASES[name] for name in dict.fromkeys(options.case or ERROR_CASES)):
        try:
            table = case_table(case, quick=options.quick, threads=options.threads, progress=options.progress)
        except KeyboardInterrupt:
            if not studies:
                raise
            break
        studies.append((case, table))
        if not options.document:
            print(f"### `{case.name}`\n\n{table.to_markdown()}\n" if options.markdown else f"{table}\n")
            for target in targets:
                print(f"{_recommended(table, target)}\n", flush=True)
        if table.interrupted:
            break
    else:
        interrupted = False
    tables = [table for _, table in studies]
    if options.csv:
        csv_of(tables, options.csv)
    if options.plot:
        draw(tables, options.plot)
    if options.document:
        figure = f"images/{Path(options.plot).name}" if options.plot else None
        print(error_document(studies, load=load, figure=figure), end="")
    if interrupted:
        raise KeyboardInterrupt
    return 0


def _recommended(table: ErrorTable, target: float) -> str:
    try:
        return f"For {100 * target:g} %: {table.recommend(target)}"
    except InvalidValueError as error:
        return str(error)


def draw(tables: list[ErrorTable], path: str) -> None:
    """Draw all cases into a file."""
    from plenoptic.plots.error_time import plot_error_studies

    figure = plot_error_studies(tables)
    with replace_file(path) as file:
        figure.savefig(file, format=Path(path).suffix[1:] or None, dpi=110)


def _cost(options: argparse.Namespace) -> int:
    from plenoptic.study.cost.cases import COST_CASES
    from plenoptic.study.cost.measurement import cost_of
    from plenoptic.study.exposures import central_region

    plan = COST_CASES[options.case]()
    given = (options.samples, options.rounds, options.side)
    usual = _QUICK_COST if options.quick else _THOROUGH_COST
    samples, rounds, side = (u if g is None else g for g, u in zip(given, usual, strict=True))
    assert plan.subject is not None
    region = central_region(plan.subject.camera.sensor.shape, side)
    table = cost_of(
        plan, samples=samples, rounds=rounds, region=region, threads=options.threads, progress=options.progress
    )
    if options.plan:
        print(f"{plan}\n")
    print(table.to_markdown() if options.markdown else table)
    if options.csv:
        table.to_csv(options.csv)
    if table.interrupted:
        raise KeyboardInterrupt
    return 0
