"""What finds disparities: functions from a package to an array, which `algorithms` lists by their names.

Of a focused camera, disparities are those of the raw image's pixels, as `GroundTruth.chord_disparity`. Of a plenoptic
1.0 camera they are those of the central view of `views(package)`: pixels by which it moves from view to view, positive
for what is near. nan stands for what is not known. An algorithm may look at all of a package but its exposure, which
has no noise, and its truth.
"""

import functools
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

import plenoptic as pl

SURE = 0.5  # confidence


class Algorithm(NamedTuple):
    """How disparities are found; `scaled`: only up to a straight line, which the judge then fits to the truth."""

    find: Callable[[pl.package.Package], np.ndarray]
    scaled: bool = False


def is_focused(camera):
    return camera.report().focus[0].kind is not pl.CameraKind.PLENOPTIC_1


def picture(package):
    """What the sensor saw, in colour."""
    return package.raw.demosaic(pl.DemosaicMethod.MHC)


def views(package):
    """The light field of a plenoptic 1.0 camera."""
    return pl.lightfield.decode(picture(package), package.white)


def plane_in_focus(package):
    """Does not look: says everywhere what the camera is focused on."""
    disparity = np.median([focus.disparity for focus in package.camera.report().focus])
    seen = picture(package).image if is_focused(package.camera) else views(package).centre
    return np.full(seen.shape[:2], disparity)


def depth_map(package):
    """This library's, by matching the images of microlenses or views."""
    if is_focused(package.camera):
        return pl.lightfield.depth(picture(package), package.white)
    return pl.lightfield.depth(views(package))


def matched(package):
    """All that it finds."""
    return depth_map(package).disparity


def sure(package):
    """What it finds where it is confident."""
    found = depth_map(package)
    return np.where(found.confidence > SURE, found.disparity, np.nan)


def plenopticam(package, *, programs):
    """The epipolar depth of PlenoptiCam, whose command is in the folder `programs`; it is given the exact centres.

    It makes a pixel of every microlens wholly in the picture, and disparities from 0 to 1.
    """
    field = views(package)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        pl.export.plenopticam(folder, picture(package), package.white)
        said = (folder / "README.txt").read_text().splitlines()
        command = next(line.split(":")[1].split() for line in said if line.startswith("with these centres"))
        arguments = [Path(programs, command[0]), *command[1:], "--dpth"]
        surroundings = {**os.environ, "MPLBACKEND": "Agg"}
        done = subprocess.run(arguments, cwd=folder, env=surroundings, capture_output=True, text=True)
        depth = folder / "shot" / "depth.pfm"
        if not depth.exists():  # it cannot do with very small pictures
            print(f"PlenoptiCam fails: {done.stderr[-500:]}", file=sys.stderr)
            return np.full(field.centre.shape[:2], np.nan)
        found = read_pfm(depth)
        lenses = np.array(json.loads((folder / "shot_centres.json").read_text())["mic_list"])
    apart = np.linalg.norm(field.pixel[:, :, None] - lenses[:, :2], axis=-1)
    row, place = lenses[apart.argmin(axis=-1), 2:].astype(int).transpose(2, 0, 1)
    return np.where(apart.min(axis=-1) < 1.0, found[row, place], np.nan)


def read_pfm(path):
    _, size, scale, data = path.read_bytes().split(b"\n", 3)
    columns, rows = map(int, size.split())
    return np.frombuffer(data, "<f4" if float(scale) < 0 else ">f4").reshape(rows, columns)[::-1]


OURS = {
    "plane in focus": Algorithm(plane_in_focus),
    "plenoptic": Algorithm(matched),
    "plenoptic, sure": Algorithm(sure),
}


def algorithms(camera, programs=None):
    """Those for a camera, by name; None for one that is not there."""
    if is_focused(camera):
        return OURS
    there = programs and Algorithm(functools.partial(plenopticam, programs=programs), scaled=True)
    return {**OURS, "PlenoptiCam": there}
