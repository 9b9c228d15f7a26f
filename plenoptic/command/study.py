"""Run a study of the simulator itself, and print its table."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from plenoptic.command.render_options import add_progress
from plenoptic.core.files.atomic_file import check_folder, real_path, replace_file
from plenoptic.errors import InvalidValueError

if TYPE_CHECKING:
    from plenoptic.study.error_time.error_table import ErrorTable

_BEYOND = 1
"""Exit code if an error is beyond its bound."""

_QUICK_COST, _THOROUGH_COST = (4, 2, 16), (32, 9, 128)
"""Samples, rounds and pixels along the side."""


def fill_parser(parser: argparse.ArgumentParser) -> None:
    """Add the studies."""
    from plenoptic.study.cost.cost_cases import COST_CASES
    from plenoptic.study.error_time.error_cases import ERROR_CASES
    from plenoptic.study.stability_study import QUICK, THOROUGH

    studies = parser.add_subparsers(title="studies", required=True, metavar="NAME")

    text = "rounding errors of ray tracing against a trace with 50 digits, in a clone of the repository"
    study = _add_study(studies, "stability", text, run=_stability, quick=f"{QUICK} rays a case")
    study.add_argument("--rays", type=int, help=f"rays a case ({THOROUGH})")
    study.add_argument("--seed", type=int, default=0, help="of the random rays (0)")
    study.add_argument("--only", action="append", help="cases whose name begins so; may be given several times")

    text, quick = "error against run time of the bundled cases", "few pixels, seeds and samples"
    study = _add_study(studies, "error-against-time", text, run=_error_against_time, quick=quick)
    _add_render_options(study)
    study.epilog = "Cases: " + " ".join(f"{name}: {case.description}" for name, case in ERROR_CASES.items())
    study.add_argument("--case", nargs="+", choices=tuple(ERROR_CASES), help="which cases; all by default")
    study.add_argument("--target", type=float, action="append", help="recommend a setting for this error, such as 0.01")
    study.add_argument("--plot", metavar="FILE", help="draw all cases")

    text = "cost of each part of a render, by leaving it out"
    study = _add_study(studies, "cost", text, run=_cost, quick="few pixels, samples and rounds")
    _add_render_options(study)
    samples, rounds, side = _THOROUGH_COST
    study.add_argument("--case", choices=tuple(COST_CASES), default="check", help="which case (check)")
    study.add_argument("--samples", type=int, help=f"paths per pixel ({samples})")
    study.add_argument("--rounds", type=int, help=f"renders of each variant ({rounds})")
    study.add_argument("--side", type=int, help=f"pixels along the side of the square in the middle ({side})")
    study.add_argument("--plan", action="store_true", help="print the plan first")


def run(options: argparse.Namespace) -> int:
    """Print the table: 0, or 1 if an error is beyond its bound. After Ctrl-C, the rows that are done."""
    run_study: Callable[[argparse.Namespace], int] = options.run_study
    return run_study(options)


def _add_study(
    studies: Any, name: str, text: str, *, run: Callable[[argparse.Namespace], int], quick: str
) -> argparse.ArgumentParser:
    study: argparse.ArgumentParser = studies.add_parser(name, help=text, description=text)
    study.set_defaults(run_study=run)
    study.add_argument("--quick", action="store_true", help=f"{quick}: to see that all works")
    study.add_argument("--markdown", action="store_true", help="print Markdown alone")
    return study


def _add_render_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--threads", type=int, default=1, help="of the renders that are timed (1)")
    parser.add_argument("--csv", metavar="FILE", help="write all rows as comma-separated values")
    add_progress(parser)


def _stability(options: argparse.Namespace) -> int:
    from plenoptic.study.stability_study import QUICK, THOROUGH, stability

    count = options.rays if options.rays is not None else QUICK if options.quick else THOROUGH
    table = stability(rays=count, seed=options.seed, only=options.only)
    print(table)
    if table.interrupted:
        raise KeyboardInterrupt
    return 0 if all(row.holds for row in table.rows) else _BEYOND


def _error_against_time(options: argparse.Namespace) -> int:
    from plenoptic.rendering.schedule.budget import checked_target
    from plenoptic.study.error_time.error_cases import ERROR_CASES, case_table
    from plenoptic.study.error_time.error_table import csv_of

    targets = [checked_target(target, "--target") for target in options.target or []]  # before minutes are spent
    for path in filter(None, (options.csv, options.plot)):
        check_folder(real_path(path))
    tables: list[ErrorTable] = []
    cases = tuple(dict.fromkeys(options.case or ERROR_CASES))
    for name in cases:
        try:
            table = case_table(name, quick=options.quick, threads=options.threads, progress=options.progress)
        except KeyboardInterrupt:
            if not tables:
                raise
            break
        tables.append(table)
        print(f"### `{name}`\n\n{table.to_markdown()}\n" if options.markdown else f"{table}\n")
        for target in targets:
            print(f"{_recommendation(table, target)}\n", flush=True)
        if table.interrupted:
            break
    if options.csv:
        csv_of(tables, options.csv)
    if options.plot:
        draw(tables, options.plot)
    if len(tables) < len(cases) or tables[-1].interrupted:
        raise KeyboardInterrupt
    return 0


def _recommendation(table: ErrorTable, target: float) -> str:
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
    from plenoptic.study.cost.cost_cases import COST_CASES
    from plenoptic.study.cost.cost_study import cost_of
    from plenoptic.study.exposures import central_region

    plan = COST_CASES[options.case]()
    defaults = _QUICK_COST if options.quick else _THOROUGH_COST
    typed = (options.samples, options.rounds, options.side)
    samples, rounds, side = (d if t is None else t for t, d in zip(typed, defaults, strict=True))
    assert plan.subject is not None
    region = central_region(plan.subject.camera.sensor.shape, side)
    table = cost_of(
        plan, samples=samples, rounds=rounds, region=region, threads=options.threads, progress=options.progress
    )
    if options.plan:
        print(f"{plan}\n")
    print(table)
    if options.csv:
        table.to_csv(options.csv)
    if table.interrupted:
        raise KeyboardInterrupt
    return 0
