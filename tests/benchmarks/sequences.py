"""Sequences: what the next frame costs before it is rendered, and what moving while the shutter is open does."""

import dataclasses
import time

import numpy as np
from large_scenes import terrain
from table import Table

import plenoptic as pl
from plenoptic.camera.cache import prepared_camera
from plenoptic.scene.cache import prepared_scene
from plenoptic.study.cameras import reference_camera


def tables(*, quick):
    rows = [(name, *prepared(scene, moves)) for name, (scene, moves) in scenes(quick=quick).items()]
    remark = (
        "Frame, camera, tables and trees, in one thread of Python; the best of 5 next frames. The camera and one "
        "object move. With copies: the mesh transformed, in a scene and a camera of their own."
    )
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
    camera = dataclasses.replace(reference_camera(), shutter=shutter)
    turn = pl.Motion.screw((0, 1), axis=(0, 1, 0), through=(0, 0, -404), angle_deg=90)
    past = pl.Motion((0, 1), [pl.Pose.look_at((x, 0, 0), (0, 0, -404)) for x in (-5, 5)])
    return pl.Sequence(scene, camera, np.linspace(0, 1, 7), motions={name: turn}, camera_motion=past)


def prepared(scene, name):
    """Triangles in all and moving; CPU-ms of the first frame, the next ones, and a frame made of copies."""
    frames, spent = sequence(scene, name), []
    for k in range(6):
        begin = time.process_time()
        frame = frames[k]
        prepare(frame.scene, frame.camera)
        spent.append(1e3 * (time.process_time() - begin))
    number = scene.object_names.index(name)
    begin = time.process_time()
    meshes = [mesh.rotated_deg((0, 1, 0), 5) if k == number else mesh for k, mesh in enumerate(scene.meshes)]
    prepare(dataclasses.replace(scene, meshes=tuple(meshes)), reference_camera())
    copied = 1e3 * (time.process_time() - begin)
    triangles = sum(len(mesh.faces) for mesh in scene.meshes)
    return [triangles, len(scene.meshes[number].faces), spent[0], min(spent[1:]), copied]


def prepare(scene, camera):
    assert prepared_scene(scene).intersector is not None
    prepared_camera(camera)


def blurred(samples):
    life, region = named(pl.still_life()), np.s_[192:320, 192:320]
    open_ = sequence(life, "red", shutter=pl.sequences.Shutter(0.1))
    moving, still = open_[3], sequence(life, "red")[3]
    unmoved = dataclasses.replace(open_, camera_motion=None)[3]
    held = dataclasses.replace(open_, motions={})[3]
    cases = {
        "no sequence": (life, still.camera),
        "a frame without a shutter": (still.scene, still.camera),
        "the camera": (held.scene, held.camera),
        "an object": (unmoved.scene, unmoved.camera),
        "both": (moving.scene, moving.camera),
    }
    for name, (scene, camera) in cases.items():
        times = []
        for _ in range(4):  # the first one compiles
            begin = time.process_time()
            how = {"samples": samples, "region": region, "threads": 1, "truth": pl.Truth.NONE}
            shot = pl.render(scene, camera, progress=False, **how)
            times.append(time.process_time() - begin)
        yield name, min(times[1:]), 100 * shot.relative_error
