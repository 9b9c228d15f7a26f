"""Render the raw image of a scene, or a part of it."""

from __future__ import annotations

import argparse

from plenoptic.command.render_options import add_output, fill_render_options, request_of


def fill_parser(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    fill_render_options(parser)
    add_output(parser)
    parser.epilog = "Interrupted once (Ctrl-C, SIGINT), it saves the unfinished image and ends with exit code 130."


def run(options: argparse.Namespace) -> None:
    """Render, save and print the exposure; KeyboardInterrupt after saving if the render was interrupted."""
    from plenoptic.rendering.exposure_files import check_target
    from plenoptic.rendering.render import render, render_white

    check_target(options.output)
    request = request_of(options)
    names = ("samples", "target_error", "time_limit", "seed", "replicates", "checkpoint", "threads", "progress")
    arguments = request.arguments(*names)
    if request.scene is None:
        exposure = render_white(request.camera, **arguments)
    else:
        exposure = render(request.scene, request.camera, **arguments)
    exposure.save(options.output)
    print(f"{options.output}: {exposure}\n{exposure.stats}", flush=True)
    if exposure.interrupted:
        raise KeyboardInterrupt
