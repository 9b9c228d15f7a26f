"""Data sets: what a frame costs beside its rendering."""

import dataclasses
import tempfile
from pathlib import Path

import numpy as np
from table import Table
from timing import apart, count_peak_anew, memory, timed

import plenoptic as pl

DIE = pl.Mesh(pl.box(2.4).vertices, pl.box(2.4).faces, name="die").translated(z=-404)
WALL = pl.quad((-80, -80, -420), (160, 0, 0), (0, 160, 0))


def sequence(frames):
    turn = pl.Motion.screw((0, 1), axis=(1, 2, 0.5), through=(0, 0, -404), angle_deg=90, advance=1.5)
    camera = dataclasses.replace(pl.camera.example_camera(), sensor=pl.Sensor(shape=(64, 64), pixel_pitch=0.05))
    return pl.Sequence(pl.Scene([WALL, DIE], background=0.3), camera, np.linspace(0, 1, frames), motions={"die": turn})


HOW = {"samples": 16, "truth": pl.Truth.DEPTH | pl.Truth.OBJECT, "progress": False}


def tables(*, quick):
    frames = 4 if quick else 200
    with tempfile.TemporaryDirectory() as folder:
        remark, title = "In one process, kernels compiled, on all processors.", "frames of 64 x 64 pixels, 16 samples"
        rows = list(costs(Path(folder), frames))
        yield Table(f"{frames} {title}, with motion", "what | wall s | CPU-s | CPU-ms a frame | MB", rows, [remark])
        side = 600 if quick else 6400
        title = "A frame of `objects` in colour, with error and depth, 2 samples, in bands of 16 megapixels"
        columns = (
            "megapixels | wall s | CPU-s | MB on the disk | MB of memory beside what was there | a chunk read in s"
        )
        yield Table(title, columns, [(side**2 / 1e6, *apart(banded, folder, side))])


def costs(folder, frames):
    pl.dataset.write(folder / "warm", sequence(2), motion=True, **HOW)

    whole = folder / "whole"

    def rendered():
        found = list(sequence(frames))
        for k, frame in enumerate(found):
            pl.render(frame.scene, frame.camera, seed=k, **HOW)
            if k:
                pl.sequences.motion_truth(found[k - 1], frame, progress=False)

    def written():
        pl.dataset.write(whole, sequence(frames), motion=True, **HOW)

    for what, work in (
        ("`render` and `motion_truth`", rendered),
        ("`dataset.write`", written),
        ("called again", written),
    ):
        cost, _ = timed(work)
        yield what, *cost, 1e3 * cost.cpu / frames, size_of(whole) if what == "`dataset.write`" else None


def size_of(folder):
    """MB on the disk."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) / 1e6


def banded(folder, side):
    """Of a large frame in a process of its own: seconds, MB on the disk and of memory, seconds to read a chunk."""
    scene, folder = pl.objects_scene(), Path(folder)

    def frame(side):
        sensor = pl.Sensor(shape=(side, side), pixel_pitch=5.12 / side)
        return pl.Sequence(scene, dataclasses.replace(pl.camera.example_camera(), sensor=sensor), [0.0])

    pl.dataset.write(folder / "small", frame(64), samples=2, progress=False)
    count_peak_anew()
    before = memory()
    spent, made = timed(pl.dataset.write, folder / "large", frame(side), samples=2, progress=False)
    peak = (memory("VmHWM") - before) / 1e6
    chunk, values = timed(lambda: made.open().image[0, -512:, -512:].values)
    assert values.any()
    return [*spent, size_of(folder / "large"), peak, chunk.wall]
