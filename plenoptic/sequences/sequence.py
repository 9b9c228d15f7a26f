"""Frames of a scene in which things move: before a camera that moves, under lights that change."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.checks import check_scene_and_camera
from plenoptic.core.motions.motion import Motion, ascending
from plenoptic.core.motions.pose import Pose
from plenoptic.core.values import Floats, Given, check_kind, finite, set_field, value, whole
from plenoptic.errors import InvalidValueError
from plenoptic.scene.geometry.instance import Instances
from plenoptic.scene.lights.registry import Light
from plenoptic.scene.points import Points
from plenoptic.scene.scene import Scene, items_of


@value
class Frame:
    """Scene and camera of a sequence at one time, for `render`, `ground_truth` and `motion_truth`.

    Parameters
    ----------
    scene : Scene
    camera : PlenopticCamera
    time : float
        Seconds, as in `Sequence.times`.

    Examples
    --------
    See `Sequence`.
    """

    scene: Scene
    camera: PlenopticCamera
    time: float

    def __post_init__(self) -> None:
        check_scene_and_camera(self.scene, self.camera)
        set_field(self, "time", finite(self.time, "time"))


@value
class Sequence:
    """Frames of a scene: objects and the camera move rigidly, lights change.

    Frames are made on access. A moving mesh becomes an `Instances` of it, so that frames share all triangles, and
    rendering the next one neither compiles nor builds trees again. With a `Shutter` of the camera, the times of frames
    are the middles of their exposures, and motion during the exposure blurs them.

    Parameters
    ----------
    scene : Scene
        The scene with its objects at their initial positions.
    camera : PlenopticCamera
    times : (n,) array
        Times of the frames, in s, ascending.
    motions : mapping from str to Motion, optional
        Motions of objects relative to their positions in the scene, by their names in `scene.object_names`.
    camera_motion : Motion, optional
        Motion relative to the camera's pose; of a camera without a pose, its poses in the world.
    lights : sequence of n sequences of lights, optional
        Lights of each frame, in place of `scene.lights`. None: the scene's, in all frames.
    points : sequence of n Points, optional
        Particles of each frame, in place of `scene.points`, as by `Points.moved`. None: the scene's, in all frames.

    Raises
    ------
    InvalidValueError
        If no mesh or several have a name, the numbers of lights or points and of times differ, or an argument is
        invalid.

    Examples
    --------
    A camera flies past a box that turns once about its own axis:

    >>> import numpy as np, plenoptic as pl
    >>> scene = pl.Scene([pl.box(8).translated(z=-404)], background=1.0)
    >>> sensor = pl.Sensor(shape=(16, 16), pixel_pitch=0.5)
    >>> camera = pl.PlenopticCamera(pl.load_lens("double-gauss-100mm-f2"), sensor, stop_to_microlenses=130.0)
    >>> past = [pl.Pose.look_at((x, 0, 0), target=(0, 0, -404)) for x in (-50, 50)]
    >>> sequence = pl.Sequence(scene, camera, np.linspace(0, 2, 200),
    ...     motions={"Mesh 0": pl.Motion.screw((0, 2), axis=(0, 1, 0), through=(0, 0, -404), angle_deg=360)},
    ...     camera_motion=pl.Motion((0, 2), past))
    >>> len(sequence), sequence[0].camera.pose.position.tolist(), sequence[-1].time
    (200, [-50.0, 0.0, 0.0], 2.0)
    >>> shot = pl.render(sequence[0].scene, sequence[0].camera, samples=2, progress=False)
    """

    scene: Scene
    camera: PlenopticCamera
    times: Given[Floats, ArrayLike]
    _: dataclasses.KW_ONLY
    motions: Given[tuple[tuple[str, Motion], ...], Mapping[str, Motion]] = Given(default=())
    camera_motion: Motion | None = None
    lights: Given[tuple[tuple[Light, ...], ...] | None, Iterable[Iterable[Light]] | None] = Given(default=None)
    points: Given[tuple[Points, ...] | None, Iterable[Points] | None] = Given(default=None)

    def __post_init__(self) -> None:
        check_kind(self.scene, "scene", Scene, "pl.Scene([pl.box(4)])")
        check_kind(self.camera, "camera", PlenopticCamera, "pl.PlenopticCamera(...)")
        set_field(self, "times", ascending(self.times, "times"))
        set_field(self, "motions", self._check_motions(self.motions))
        if self.camera_motion is not None:
            check_kind(self.camera_motion, "camera_motion", Motion, "pl.Motion((0, 1), [first_pose, last_pose])")
        if self.lights is not None:
            lights = tuple(self.scene.with_lights(each).lights for each in self.lights)
            if len(lights) != len(self.times):
                raise InvalidValueError(f"there are lights for {len(lights)} frames of {len(self.times)}")
            set_field(self, "lights", lights)
        if self.points is not None:
            points = items_of(self.points, Points, "points")
            if len(points) != len(self.times):
                raise InvalidValueError(f"there are points for {len(points)} frames of {len(self.times)}")
            set_field(self, "points", points)

    def _check_motions(self, motions: object) -> tuple[tuple[str, Motion], ...]:
        """Motions by names that a single mesh has."""
        pairs = tuple(motions.items()) if isinstance(motions, Mapping) else motions
        if not isinstance(pairs, tuple) or not all(isinstance(pair, tuple) and len(pair) == 2 for pair in pairs):
            raise InvalidValueError(f'motions is {motions!r:.80}; give a mapping, such as {{"Mesh 0": pl.Motion(...)}}')
        names = self.scene.object_names[: len(self.scene.meshes)]
        for name, motion in pairs:
            check_kind(motion, f"the motion of {name!r}", Motion, "pl.Motion.screw((0, 1), axis=(0, 1, 0))")
            if names.count(name) != 1:
                raise InvalidValueError(
                    f"motions names {name!r}, which {names.count(name)} meshes of the scene have; it must be one of "
                    f"scene.object_names, {', '.join(names)[:200]}: name meshes apart, and move lights by `lights`"
                )
        return tuple(sorted(pairs, key=lambda pair: names.index(pair[0])))

    def __len__(self) -> int:
        return len(self.times)

    def __iter__(self) -> Iterator[Frame]:
        return (self[k] for k in range(len(self)))

    def __getitem__(self, number: int) -> Frame:
        """A frame, the first one being 0 and the last one -1."""
        k = whole(number, "the number of a frame", at_least=-len(self)) % (len(self) or 1)
        if number >= len(self):
            raise IndexError(f"frame {number} of {len(self)}")
        time = float(self.times[k])
        return Frame(self._scene_at(k, time), self._camera_at(time), time)

    def __repr__(self) -> str:
        names = [name for name, _ in self.motions] + ["the camera"] * (self.camera_motion is not None)
        moving = ", ".join(names) or "nothing"
        return f"Sequence({len(self)} frames from {self.times[0]:g} to {self.times[-1]:g} s, moving: {moving})"

    @cached_property
    def _objects(self) -> dict[int, tuple[Instances, Motion]]:
        """Moving objects by their index in `scene.meshes`: as instances at their initial pose, named as the mesh is."""
        names, moving = self.scene.object_names, {}
        for name, motion in self.motions:
            k = names.index(name)
            part = self.scene.meshes[k]
            if not isinstance(part, Instances):
                part = Instances(dataclasses.replace(part, name=name), np.eye(4)[None])
            moving[k] = part, motion
        return moving

    def _scene_at(self, k: int, time: float) -> Scene:
        if not self.motions and self.lights is None and self.points is None:
            return self.scene
        meshes = list(self.scene.meshes)
        for place, (part, motion) in self._objects.items():
            matrix = np.concatenate([motion.matrices([time])[0], [[0.0, 0.0, 0.0, 1.0]]])
            meshes[place] = Instances(part.mesh, matrix @ part.matrices, motion.seen_from(time))
        lights = self.scene.lights if self.lights is None else self.lights[k]
        points = self.scene.points if self.points is None else self.points[k]
        return dataclasses.replace(self.scene, meshes=tuple(meshes), lights=lights, points=points)

    def _camera_at(self, time: float) -> PlenopticCamera:
        camera, motion = self.camera, self.camera_motion
        if motion is None:
            return camera
        pose, stands, shutter = motion.at(time), camera.pose, camera.shutter
        if stands is not None:
            pose = Pose(pose.rotation @ stands.rotation, pose.to_world(stands.position))
        if shutter is not None:
            shutter = dataclasses.replace(shutter, motion=motion.seen_from(time))
        return dataclasses.replace(camera, pose=pose, shutter=shutter)
