"""Sequences: what the next frame costs before it is rendered, and what moving while the shutter is open does."""

import dataclasses

import numpy as np
from large_scenes import terrain
from table import Table
from timing import timed

import plenoptic as pl
from plenoptic.camera.cache import prepared_camera
from plenoptic.scene.cache import prepared_scene


def tables(*, quick):
    rows = [(name, *prepared(scene, moves)) for name, (scene, moves) in scenes(quick=quick).items()]
    remark = "Frame, camera, tables and trees, in one thread of Python; the best of 5 next frames. The camera and one "
    remark += "object move. With copies: the mesh transformed, in a scene and a camera of their own."
    columns = "scene | triangles | moving | frame 0 | the next ones | with copies instead"
    yield Table("What stands before the rays of a frame, in CPU-ms", columns, rows, [remark])
    remark = "128 x 128 pixels of the reference camera; the best of 3."
    title, rows = "Renders of the still life with a shutter, in CPU-s, with one thread", blurred(4 if quick else 64)
    yield Table(title, "what moves while it is open | CPU-s | relative error / %", list(rows), [remark])


def scenes(*, quick):
    """With the name of an object that moves."""
    ball = dataclasses.replace(pl.sphere(10.0, center=(0, 0, -380)), name="ball")
    found = {"still life": (named(pl.still_life()), "red")}
    for side in (20,) if quick else (158, 707):
        land = terrain(side)
        found[f"terrain of {side} x {side}"] = dataclasses.replace(land, meshes=(*land.meshes, ball)), "ball"
    return found


def named(life):
    """The still life whose matt red ball has a name."""
    meshes = list(life.meshes)
    meshes[5] = dataclasses.replace(meshes[5], name="red")
    return dataclasses.replace(life, meshes=tuple(meshes))


def sequence(scene, name, *, shutter=None):
    camera = dataclasses.replace(pl.camera.example_camera(), shutter=shutter)
    turn = pl.Motion.screw((0, 1), axis=(0, 1, 0), through=(0, 0, -404), angle_deg=90)
    past = pl.Motion((0, 1), [pl.Pose.look_at((x, 0, 0), (0, 0, -404)) for x in (-5, 5)])
    return pl.Sequence(scene, camera, np.linspace(0, 1, 7), motions={name: turn}, camera_motion=past)


def prepared(scene, name):
    """Triangles in all and moving; CPU-ms of the first frame, the next ones, and a frame made of copies."""
    frames, number = sequence(scene, name), scene.object_names.index(name)

    def prepare(scene, camera):
        assert prepared_scene(scene).intersector is not None
        prepared_camera(camera)

    def of_frame(k):
        frame = frames[k]
        prepare(frame.scene, frame.camera)

    def of_copies():
        meshes = [mesh.rotated_deg((0, 1, 0), 5) if k == number else mesh for k, mesh in enumerate(scene.meshes)]
        prepare(dataclasses.replace(scene, meshes=tuple(meshes)), pl.camera.example_camera())

    first, *more, copied = (1e3 * cost.cpu for cost, _ in (*(timed(of_frame, k) for k in range(6)), timed(of_copies)))
    triangles = [len(mesh.faces) for mesh in scene.meshes]
    return [sum(triangles), triangles[number], first, min(more), copied]


def blurred(samples):
    life, region = named(pl.still_life()), np.s_[192:320, 192:320]
    open_ = sequence(life, "red", shutter=pl.sequences.Shutter(0.1))
    moving, still = open_[3], sequence(life, "red")[3]
    unmoved = dataclasses.replace(open_, camera_motion=None)[3]
    held = dataclasses.replace(open_, motions={})[3]
    cases = {"no sequence": (life, still.camera), "a frame without a shutter": (still.scene, still.camera)}
    cases |= {"the camera": (held.scene, held.camera), "an object": (unmoved.scene, unmoved.camera)}
    cases |= {"both": (moving.scene, moving.camera)}
    how = {"samples": samples, "region": region, "threads": 1, "truth": pl.Truth.NONE, "progress": False}
    for name, shown in cases.items():
        _, *costs = (timed(pl.render, *shown, **how) for _ in range(4))  # the first one compiles
        yield name, min(cost.cpu for cost, _ in costs), 100 * costs[-1][1].relative_error
