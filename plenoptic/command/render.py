"""Render the raw image of a scene, or a part of it."""

from __future__ import annotations

import argparse

from plenoptic.command.render_options import fill_render_options, request_of


def fill_parser(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    fill_render_options(parser)
    text = "image to write: .exr or .zarr keep everything, .tif and .png the picture"
    parser.add_argument("-o", "--output", metavar="OUT", required=True, help=text)
    parser.epilog = "Interrupted once (Ctrl-C, SIGINT), it saves what there is and ends with exit code 130."


def run(options: argparse.Namespace) -> None:
    """Render, save, and print a summary; KeyboardInterrupt where it was interrupted, after saving."""
    from plenoptic.rendering.exposure_files import check_target
    from plenoptic.rendering.render import render, render_white

    check_target(options.output)
    request = request_of(options)
    names = ("samples", "target_error", "time_limit", "seed", "replicates", "checkpoint", "threads", "progress")
    arguments = request.arguments(*names)
    if request.scene is None:
        shot = render_white(request.camera, **arguments)
    else:
        shot = render(request.scene, request.camera, **arguments)
    shot.save(options.output)
    print(f"{options.output}: {shot}\n{shot.stats}", flush=True)
    if shot.interrupted:
        raise KeyboardInterrupt
