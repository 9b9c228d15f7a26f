"""Options that the commands of several studies share."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from typing import Any


def study_command(
    subparsers: Any, name: str, text: str, *, run: Callable[[argparse.Namespace], int], quick: str
) -> argparse.ArgumentParser:
    """The parser of one more study, with the options ``--quick`` and ``--markdown``.

    Examples
    --------
    >>> import argparse
    >>> from plenoptic.study.options import study_command
    >>> parser = argparse.ArgumentParser()
    >>> one = study_command(parser.add_subparsers(), "depth", "how deep", run=lambda options: 0, quick="few pixels")
    >>> parser.parse_args(["depth", "--quick"]).quick
    True
    """
    one: argparse.ArgumentParser = subparsers.add_parser(name, help=text, description=text)
    one.set_defaults(run=run)
    one.add_argument("--quick", action="store_true", help=f"{quick}: to see that all works")
    one.add_argument("--markdown", action="store_true", help="print Markdown alone")
    return one


def add_render_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of studies that time renders.

    Examples
    --------
    >>> import argparse
    >>> from plenoptic.study.options import add_render_options
    >>> parser = argparse.ArgumentParser()
    >>> add_render_options(parser)
    >>> parser.parse_args([]).threads
    1
    """
    parser.add_argument("--threads", type=int, default=1, help="of the renders that are timed (1)")
    parser.add_argument("--csv", metavar="FILE", help="write all rows as comma-separated values")
    show = argparse.BooleanOptionalAction
    parser.add_argument("--progress", action=show, default=sys.stderr.isatty(), help="in terminals")
