"""What parts of a rendering cost, from the command line: ``python -m plenoptic.study cost``."""

from __future__ import annotations

import argparse
import sys
from typing import Any

import numpy as np

from plenoptic.study.cost.cases import cost_case, cost_cases
from plenoptic.study.cost.costs import cost_of

_QUICK = (4, 2, 16)
_THOROUGH = (32, 9, 128)
"""Samples, rounds and pixels along the side."""


def add_command(subparsers: Any) -> None:
    """Add ``cost`` to the studies of a parser.

    Parameters
    ----------
    subparsers : what `argparse.ArgumentParser.add_subparsers` gives

    Examples
    --------
    >>> import argparse
    >>> from plenoptic.study.cost.command import add_command
    >>> parser = argparse.ArgumentParser()
    >>> add_command(parser.add_subparsers())
    >>> parser.parse_args(["cost", "--case", "check", "--quick"]).case
    'check'
    """
    text = "what each part of a rendering costs, by leaving it out"
    one = subparsers.add_parser("cost", help=text, description=text)
    one.add_argument("--case", choices=cost_cases(), default="check", help="which case (check)")
    one.add_argument("--quick", action="store_true", help="few pixels, samples and rounds: to see that all works")
    one.add_argument("--samples", type=int, help=f"paths per pixel ({_THOROUGH[0]})")
    one.add_argument("--rounds", type=int, help=f"renderings of each variant ({_THOROUGH[1]})")
    one.add_argument("--side", type=int, help=f"pixels along the side of the square in the middle ({_THOROUGH[2]})")
    one.add_argument("--threads", type=int, default=1, help="of the renderings (1)")
    one.add_argument("--plan", action="store_true", help="print the plan first")
    one.add_argument("--markdown", action="store_true", help="print a Markdown table")
    one.add_argument("--csv", metavar="FILE", help="write all rows as comma-separated values")
    one.add_argument(
        "--progress", action=argparse.BooleanOptionalAction, default=sys.stderr.isatty(), help="in terminals"
    )
    one.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    plan = cost_case(options.case)
    given, usual = (options.samples, options.rounds, options.side), _QUICK if options.quick else _THOROUGH
    samples, rounds, side = (u if g is None else g for g, u in zip(given, usual, strict=True))
    assert plan.subject is not None
    rows, columns = plan.subject.camera.sensor.shape
    top, left = max(rows - side, 0) // 2, max(columns - side, 0) // 2
    table = cost_of(
        plan,
        samples=samples,
        rounds=rounds,
        region=np.s_[top : top + side, left : left + side],
        threads=options.threads,
        progress=options.progress,
    )
    if options.plan:
        print(f"{plan}\n")
    print(table.to_markdown() if options.markdown else table)
    if options.csv:
        table.to_csv(options.csv)
    return 0
