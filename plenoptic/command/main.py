"""The command line: one file for each subcommand, and one line here."""

from __future__ import annotations

import argparse
import re
import sys
import warnings
from collections.abc import Sequence
from typing import Any

from plenoptic import __version__
from plenoptic.command import estimate, info, merge, render, study, view, warm_up
from plenoptic.core.files.atomic_file import utf8_path
from plenoptic.errors import PlenopticError

REFUSED = 1
INTERRUPTED = 130
"""128 and the number of SIGINT, as shells have it. 2 is argparse's: wrong usage."""


_OPTIONS = {
    r"lights=\[\.\.\.\] above 0 or a background=": "--background 1",
    r'pl\.Scene\.load\(path, unit="(\w+)"\)': r"--unit \1",
    r"samples, time_limit and target_error are all None": "--samples, --time-limit and --target-error are missing",
    r"samples and target_error are both None": "--samples and --target-error are missing",
    r"such as samples=64": "such as --samples 64",
}
"""Patterns of remedies in Python, and the options to type instead."""

COMMANDS: dict[str, Any] = {
    "render": render,
    "estimate": estimate,
    "merge": merge,
    "info": info,
    "view": view,
    "warm-up": warm_up,
    "study": study,
}
"""Modules of the subcommands, described by the first line of their docstrings.

`fill_parser(parser)` adds the arguments; `run(options)` returns the exit code, None for 0, or raises a PlenopticError.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a subcommand; 0: done, 1: refused, with one line on stderr, 2: wrong usage, 130: after Ctrl-C."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    options = _parser(words).parse_args(words)
    command = COMMANDS[options.command]
    with warnings.catch_warnings():
        warnings.showwarning = _show_warning
        try:
            for word in words:
                utf8_path(word)  # words that are no files are printed, too
            code = command.run(options)
            if sys.stdout is not None:  # closed by the shell
                sys.stdout.flush()
        except BrokenPipeError:  # the reader of the output has closed it
            sys.stderr.close()
            return REFUSED
        except (PlenopticError, OSError) as error:
            print(f"plenoptic {options.command}: {_text(error)}", file=sys.stderr)
            return REFUSED
        except Exception as error:
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            print(f"plenoptic {options.command}: {reason}; please report this error", file=sys.stderr)
            return REFUSED
        except KeyboardInterrupt:
            print("interrupted", file=sys.stderr)
            return INTERRUPTED
    return 0 if code is None else code


def _parser(words: Sequence[str]) -> argparse.ArgumentParser:
    """The parser of all commands, with the arguments of the commands in `words` only: some imports take long."""
    text = "Plenoptic cameras, simulated physically: tasks that need no program of one's own."
    parser = argparse.ArgumentParser(prog="plenoptic", description=text)
    parser.add_argument("--version", action="version", version=f"plenoptic {__version__}")
    parts = parser.add_subparsers(title="commands", dest="command", required=True, metavar="COMMAND")
    for name, command in COMMANDS.items():
        text = (command.__doc__ or "").strip().splitlines()[0].rstrip(".")
        subparser = parts.add_parser(name, help=text[0].lower() + text[1:], description=f"{text}.")
        if name in words:
            command.fill_parser(subparser)
    return parser


def _show_warning(message: Warning | str, *where: Any, **also: Any) -> None:
    """Print a warning in one line, without the place in the code."""
    print(f"warning: {_text(message)}", file=sys.stderr)


def _text(message: object) -> str:
    """A message in one line, with options in place of arguments in Python."""
    text = " ".join(str(message).split())
    for pattern, option in _OPTIONS.items():
        text = re.sub(pattern, option, text)
    return text
