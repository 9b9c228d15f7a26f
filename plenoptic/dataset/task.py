"""Tasks of a data set, the inputs of each, and the description of frames."""

from __future__ import annotations

import collections.abc
import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from plenoptic import __version__
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.core.files.digest import digest
from plenoptic.core.files.serialization import to_tree
from plenoptic.core.files.zarr_files import CHUNK
from plenoptic.core.values import Floats, check_kind, seed_number, wrong_kind
from plenoptic.dataset.contents import NAME
from plenoptic.errors import InvalidValueError
from plenoptic.rendering.schedule.identity import identity
from plenoptic.rendering.settings import RenderSettings
from plenoptic.scene.geometry.instance import Instances
from plenoptic.sequences.sequence import Frame, Sequence
from plenoptic.truth.channels import Truth

_PART = 1 << 24
"""Pixels of a frame that are rendered at once, about: larger ones go band by band, so that memory is bounded."""
Frames = collections.abc.Sequence[Frame] | Sequence


class FrameOptions(NamedTuple):
    """Options with which all frames are rendered; see `write`."""

    samples: int | None
    target_error: float | None
    replicates: int
    truth: Truth
    motion: bool
    seed: int
    settings: RenderSettings

    def to_tree(self) -> dict[str, Any]:
        """Options as JSON."""
        return {**self._asdict(), "truth": self.truth_names, "settings": to_tree(self.settings)}

    def identity(self, sequences: Mapping[str, Frames]) -> dict[str, str]:
        """Values that must be the same when writing goes on, in texts."""
        facts = {**self._asdict(), **self.settings.__dict__, "truth": "|".join(self.truth_names)}
        facts = {"plenoptic": __version__, "cameras": ", ".join(sequences), **facts}
        del facts["settings"]
        return {name: str(fact) for name, fact in facts.items()}

    @property
    def truth_names(self) -> list[str]:
        """Names of the channels, one by one: the channels of a joint name such as ALL may become more."""
        return [str(flag.name) for flag in Truth if flag.value.bit_count() == 1 and flag in self.truth]


class Task(NamedTuple):
    """Task for a band of rows of a frame: its image, or the positions of its points in the next frame."""

    camera: str
    frame: int
    rows: tuple[int, int]
    image: bool

    @property
    def frames(self) -> tuple[int, ...]:
        """Frames that are needed for the task."""
        return (self.frame,) if self.image else (self.frame, self.frame + 1)


def tasks_of(sequences: Mapping[str, Frames], *, motion: bool) -> Iterator[Task]:
    """Frame after frame, all cameras of each."""
    frames = len(next(iter(sequences.values())))
    bands = {name: list(_bands(*sequence[0].camera.sensor.shape)) for name, sequence in sequences.items()}
    for k in range(frames):
        for image in (True, False) if motion and k + 1 < frames else (True,):
            for name, parts in bands.items():
                yield from (Task(name, k, rows, image) for rows in parts)


def _bands(rows: int, columns: int) -> Iterator[tuple[int, int]]:
    """First and end rows of the parts that are rendered at once: whole chunks of a store."""
    high = max(_PART // columns // CHUNK, 1) * CHUNK if rows * columns > _PART else rows
    for first in range(0, rows, high):
        yield first, min(first + high, rows)


def named_cameras(sequence: Any, cameras: Any) -> dict[str, Frames]:
    """Frames by the names of cameras."""
    if not isinstance(sequence, Sequence):
        if cameras is not None:
            raise InvalidValueError("cameras is given, and the frames of a list have their own; leave it out")
        if not isinstance(sequence, list | tuple) or not all(isinstance(frame, Frame) for frame in sequence):
            raise wrong_kind(
                sequence, "sequence", "Sequence or list of Frame", "pl.Sequence(scene, camera, [0.0, 0.1])"
            )
        if not sequence:
            raise InvalidValueError("sequence is empty; give it a frame or more")
        if len({frame.camera.sensor.shape for frame in sequence}) > 1:
            raise InvalidValueError(
                "the cameras of the frames have sensors of different shapes; make a data set of each"
            )
        return {"camera": sequence}
    if cameras is None:
        return {"camera": sequence}
    if not isinstance(cameras, Mapping) or not cameras:
        raise InvalidValueError(f'cameras is {cameras!r:.80}; give a mapping, such as {{"left": left, "right": right}}')
    for name, camera in cameras.items():
        if not isinstance(name, str) or not NAME.fullmatch(name):
            raise InvalidValueError(f"{name!r:.80} is no name of a camera; take up to 60 letters, digits, - and _")
        check_kind(camera, f"cameras[{name!r}]", PlenopticCamera, "pl.PlenopticCamera(...)")
    if len({name.lower() for name in cameras}) < len(cameras):
        raise InvalidValueError("names of cameras differ in capital letters only; file systems may not tell them apart")
    return {name: dataclasses.replace(sequence, camera=camera) for name, camera in cameras.items()}


def times_of(frames: Frames) -> Floats:
    """(n,): s."""
    return frames.times if isinstance(frames, Sequence) else np.array([frame.time for frame in frames])


def frame_seed(seed: int, frame: int, camera: int) -> int:
    """The seed of an image: images of different frames and cameras are independent."""
    drawn = np.random.SeedSequence(seed_number(seed), spawn_key=(frame, camera)).generate_state(1, np.uint64)
    return int(drawn[0])


def inputs_of(*frames: Frame) -> str:
    """Inputs that identify these frames, in any process."""
    return digest(tuple((tuple(sorted(identity(None, f.camera).items())), f.scene, f.time) for f in frames))


def described_frame(frame: Frame) -> dict[str, Any]:
    """Description of a frame for the manifest, as JSON."""
    pose = frame.camera.pose
    names = frame.scene.object_names
    placed = zip(names, frame.scene.meshes, strict=False)  # behind those of meshes there are names of lights
    single = {
        name: mesh for name, mesh in placed if isinstance(mesh, Instances) and len(mesh) == 1 and names.count(name) == 1
    }
    return {
        "time": frame.time,
        "camera_value": to_tree(dataclasses.replace(frame.camera, pose=None, shutter=None)),
        "pose": to_tree(pose),
        "shutter": to_tree(frame.camera.shutter),
        "object_names": list(names),
        "object_to_world": {name: mesh.matrices[0, :3].tolist() for name, mesh in single.items()},
    }
