"""Studies from the command line: ``python -m plenoptic.study stability``, ``error-against-time``, ``cost``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from plenoptic.errors import PlenopticError
from plenoptic.study.cost import command as cost_command
from plenoptic.study.error_time import command as error_command
from plenoptic.study.options import study_command
from plenoptic.study.rounding.table import QUICK, THOROUGH, stability

_INTERRUPTED = 130
"""128 and the number of SIGINT, as shells have it."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a study and print its table.

    Parameters
    ----------
    arguments : sequence of str, optional
        Those of the command line by default.

    Returns
    -------
    int
        0 where all is within its bounds, 1 where something is not, 2 where the study cannot run, 130 after Ctrl-C.

    Examples
    --------
    >>> from plenoptic.study.__main__ import main
    >>> main(["stability", "--rays", "2", "--only", "plane, in"])
    case ...
    plane, in reverse  2 ...
    <StabilityTable: 1 cases, all within their bounds>
    0
    """
    options = _parser().parse_args(arguments)
    try:
        return int(options.run(options))
    except PlenopticError as error:
        print(error, file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return _INTERRUPTED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m plenoptic.study", description="Studies that print a table.")
    studies = parser.add_subparsers(title="studies", required=True)
    text = "rounding errors of ray tracing against a trace with 50 digits"
    one = study_command(studies, "stability", text, run=_stability, quick=f"{QUICK} rays a case")
    one.add_argument("--rays", type=int, help=f"rays a case ({THOROUGH})")
    one.add_argument("--seed", type=int, default=0, help="of the random rays (0)")
    one.add_argument("--only", action="append", help="cases whose name begins so; may be given several times")
    error_command.add_command(studies)
    cost_command.add_command(studies)
    return parser


def _stability(options: argparse.Namespace) -> int:
    count = options.rays if options.rays is not None else QUICK if options.quick else THOROUGH
    table = stability(rays=count, seed=options.seed, only=options.only)
    print(table.to_markdown() if options.markdown else table)
    if not options.markdown:
        print(repr(table))
    elif not table.holds:
        print(repr(table), file=sys.stderr)
    return 0 if table.holds else 1


if __name__ == "__main__":
    sys.exit(main())
