"""Keeping the state of a rendering in a file while it goes on."""

from __future__ import annotations

import os
import time
import warnings
from collections.abc import Mapping

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.core.values import file_path, positive
from plenoptic.errors import FileError
from plenoptic.rendering.schedule.progress import Progress
from plenoptic.scene.compile import SceneRecord


class Keeper:
    """Keeps the state of a rendering in a file, every so often."""

    def __init__(self, path: str | os.PathLike[str], interval: float) -> None:
        self._path = file_path(path)
        self._interval = positive(interval, "checkpoint_interval", "s")
        self._identity: dict[str, str] = {}
        self._saved = self._begin = time.perf_counter()
        self._begin_cpu = time.process_time()
        self._before = (0.0, 0.0)
        self._kept = -1
        """Samples of all tiles in the file."""

    def resume(
        self, progress: Progress, scene: SceneRecord | None, camera: PlenopticCamera, facts: Mapping[str, object]
    ) -> None:
        """Put into `progress` what the file holds, if there is one of a rendering with the same facts."""
        from plenoptic.rendering.schedule.checkpoint import identity, load_checkpoint

        self._identity = identity(scene, camera, **facts)
        found = load_checkpoint(self._path, self._identity)
        if found is not None:
            progress.restore(*found)
            self._before = (progress.seconds, progress.cpu_seconds)
            self._kept = int(progress.done.sum())
        else:
            self._write(progress)  # a file that cannot be written is better known now

    def save_if_due(self, progress: Progress) -> None:
        """Write the file if it is time. Where that fails, the rendering goes on, with a warning."""
        if time.perf_counter() - self._saved >= self._interval:
            self.save(progress)

    def save(self, progress: Progress) -> None:
        """Write the file unless it is up to date; a failure is a warning, since what is rendered is still there."""
        self._time(progress)
        if self._kept == progress.done.sum():
            return
        try:
            self._write(progress)
        except FileError as error:
            self._saved = time.perf_counter()
            warnings.warn(f"the checkpoint has not been written: {error}", stacklevel=2)

    def _write(self, progress: Progress) -> None:
        from plenoptic.rendering.schedule.checkpoint import save_checkpoint

        self._time(progress)
        save_checkpoint(self._path, self._identity, progress.arrays(), progress.facts())
        self._kept, self._saved = int(progress.done.sum()), time.perf_counter()

    def _time(self, progress: Progress) -> None:
        progress.seconds = self._before[0] + time.perf_counter() - self._begin
        progress.cpu_seconds = self._before[1] + time.process_time() - self._begin_cpu
