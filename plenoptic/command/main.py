"""The command line: one file for each subcommand, and one line here."""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Sequence
from typing import Any, Protocol

from plenoptic import __version__
from plenoptic.command import estimate, info, merge, render, study, view, warm_up
from plenoptic.core.files.atomic_file import utf8_path
from plenoptic.errors import PlenopticError

REFUSED = 1
INTERRUPTED = 130
"""128 and the number of SIGINT, as shells have it. 2 is argparse's: wrong usage."""


class Command(Protocol):
    """Subcommand: a module. The first line of its docstring is its description, without a full stop."""

    def fill_parser(self, parser: argparse.ArgumentParser) -> None:
        """Add its arguments."""

    def run(self, options: argparse.Namespace) -> int | None:
        """Run the command, and return the exit code, if any; a PlenopticError is a refusal."""


COMMANDS: dict[str, Any] = {
    "render": render,
    "estimate": estimate,
    "merge": merge,
    "info": info,
    "view": view,
    "warm-up": warm_up,
    "study": study,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a subcommand; 0: done, 1: refused, with one line on stderr, 2: wrong usage, 130: after Ctrl-C."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    options = _parser(words).parse_args(words)
    command: Command = COMMANDS[options.command]
    with warnings.catch_warnings():
        warnings.showwarning = _show_warning
        try:
            for argument in words:
                utf8_path(argument)  # also what is no file is printed
            code = command.run(options)
            if sys.stdout is not None:  # closed by the shell
                sys.stdout.flush()
        except PlenopticError as error:
            return _refuse(options.command, error)
        except BrokenPipeError:  # whoever reads the output has seen enough
            sys.stderr.close()
            return REFUSED
        except OSError as error:
            return _refuse(options.command, error)
        except KeyboardInterrupt:
            print("interrupted", file=sys.stderr)
            return INTERRUPTED
    return 0 if code is None else code


def _parser(given: Sequence[str]) -> argparse.ArgumentParser:
    """Parser of all commands, with the arguments of those that may be meant: some import slow modules."""
    text = "Plenoptic cameras, simulated physically: what there is to do without writing a program."
    parser = argparse.ArgumentParser(prog="plenoptic", description=text)
    parser.add_argument("--version", action="version", version=f"plenoptic {__version__}")
    parts = parser.add_subparsers(title="commands", dest="command", required=True, metavar="COMMAND")
    for name, command in COMMANDS.items():
        what = (command.__doc__ or "").strip().splitlines()[0].rstrip(".")
        one = parts.add_parser(name, help=what[0].lower() + what[1:], description=f"{what}.")
        if name in given:
            command.fill_parser(one)
    return parser


def _refuse(name: str, error: BaseException) -> int:
    print(f"plenoptic {name}: {' '.join(str(error).split())}", file=sys.stderr)
    return REFUSED


def _show_warning(message: Warning | str, *where: Any, **also: Any) -> None:
    """In one line, without the place in the code."""
    print(f"warning: {' '.join(str(message).split())}", file=sys.stderr)
