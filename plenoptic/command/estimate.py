"""Estimate time, memory and files of a render."""

from __future__ import annotations

import argparse
import json

from plenoptic.command.render_options import fill_render_options, request_of


def fill_parser(parser: argparse.ArgumentParser) -> None:
    """Add the arguments, those of `render`."""
    fill_render_options(parser)
    parser.add_argument("-o", "--output", metavar="OUT", help="nothing is written")
    parser.add_argument("--json", action="store_true", help="print JSON: value, low and high of each, in s and bytes")
    parser.epilog = "Arguments are those of `render`; time limit, seed, checkpoint and output change nothing here."


def run(options: argparse.Namespace) -> None:
    """Print the estimate."""
    from plenoptic.rendering.estimation.estimate import estimate
    from plenoptic.rendering.estimation.estimated import Estimated

    request = request_of(options)
    arguments = request.arguments("samples", "target_error", "replicates", "threads", "progress")
    estimated = estimate(request.scene, request.camera, **arguments)
    if options.json:
        numbers = {name: n._asdict() for name, n in vars(estimated).items() if isinstance(n, Estimated)}
        print(json.dumps(numbers, indent=1))
    else:
        print(estimated)
