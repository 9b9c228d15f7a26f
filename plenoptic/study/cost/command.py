"""What parts of a render cost, from the command line: ``python -m plenoptic.study cost``."""

from __future__ import annotations

import argparse
from typing import Any

from plenoptic.study.cost.cases import cost_case, cost_cases
from plenoptic.study.cost.measurement import cost_of
from plenoptic.study.exposures import central_region
from plenoptic.study.options import add_render_options, study_command

_QUICK = (4, 2, 16)
_THOROUGH = (32, 9, 128)
"""Samples, rounds and pixels along the side."""


def add_command(subparsers: Any) -> None:
    """Add ``cost`` to the studies of a parser."""
    text = "what each part of a render costs, by leaving it out"
    one = study_command(subparsers, "cost", text, run=_run, quick="few pixels, samples and rounds")
    add_render_options(one)
    one.add_argument("--case", choices=cost_cases(), default="check", help="which case (check)")
    one.add_argument("--samples", type=int, help=f"paths per pixel ({_THOROUGH[0]})")
    one.add_argument("--rounds", type=int, help=f"renders of each variant ({_THOROUGH[1]})")
    one.add_argument("--side", type=int, help=f"pixels along the side of the square in the middle ({_THOROUGH[2]})")
    one.add_argument("--plan", action="store_true", help="print the plan first")


def _run(options: argparse.Namespace) -> int:
    plan = cost_case(options.case)
    given, usual = (options.samples, options.rounds, options.side), _QUICK if options.quick else _THOROUGH
    samples, rounds, side = (u if g is None else g for g, u in zip(given, usual, strict=True))
    assert plan.subject is not None
    table = cost_of(
        plan,
        samples=samples,
        rounds=rounds,
        region=central_region(plan.subject.camera.sensor.shape, side),
        threads=options.threads,
        progress=options.progress,
    )
    if options.plan:
        print(f"{plan}\n")
    print(table.to_markdown() if options.markdown else table)
    if options.csv:
        table.to_csv(options.csv)
    return 0
