"""Writing data sets: frame by frame, each recorded when it is on the disk."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.core.engines.choice import cluster_of
from plenoptic.core.files.atomic_file import (
    check_folder,
    claim_folder,
    is_empty_folder,
    real_path,
    replace_folder,
    translate_errors,
)
from plenoptic.core.files.digest import bytes_of
from plenoptic.core.files.zarr_files import Store, zarr_module
from plenoptic.core.parallel import thread_count
from plenoptic.core.progress.bar import DELAY, Poller, load_tqdm
from plenoptic.core.progress.compiling import compiling_text
from plenoptic.core.values import check_kind, flag, seed_number
from plenoptic.dataset.contents import LOG, DataSet
from plenoptic.dataset.journal import SHARED, Journal
from plenoptic.dataset.tables import statistics_of, versions, write_contact_sheet, write_manifest, write_statistics
from plenoptic.dataset.task import (
    FrameOptions,
    Frames,
    Task,
    described_frame,
    frame_seed,
    inputs_of,
    named_cameras,
    tasks_of,
    times_of,
)
from plenoptic.errors import FileError, InvalidValueError
from plenoptic.rendering.exposure_files import MOTION_NAMES, create_store, layout_of
from plenoptic.rendering.exposure_metadata import pixels_of
from plenoptic.rendering.render import render
from plenoptic.rendering.schedule.budget import checked_budget
from plenoptic.rendering.settings import RenderSettings
from plenoptic.sequences.point_motion import motion_truth
from plenoptic.sequences.sequence import Frame, Sequence
from plenoptic.truth.channels import Truth
from plenoptic.truth.truth_arrays import valid_truth

if TYPE_CHECKING:
    import distributed

    from plenoptic.rendering.exposure import Exposure

_LONG = 1 << 28
"""Fewest paths of a render with a checkpoint: some minutes."""
_USUAL = 64
"""Samples that a target error takes, about."""


def write(  # noqa: PLR0913
    folder: str | os.PathLike[str],
    sequence: Sequence | list[Frame] | tuple[Frame, ...],
    *,
    cameras: Mapping[str, PlenopticCamera] | None = None,
    samples: int | None = None,
    target_error: float | None = None,
    truth: Truth = Truth.DEPTH,
    motion: bool = False,
    seed: int = 0,
    replicates: int = 2,
    settings: RenderSettings | None = None,
    threads: int | None = None,
    client: distributed.Client | None = None,
    progress: bool = True,
) -> DataSet:
    """Render all frames of a sequence into a folder, and continue after an earlier call.

    It may be killed at any time: rendered frames stay, and called again with the same arguments it renders the rest,
    with the same bits as without a break. A sequence may have become longer meanwhile. Ctrl-C ends it
    too, and the present frames are returned: `complete` is False then.

    Parameters
    ----------
    folder : path-like
        A new or empty folder, or that of the same data set.
    sequence : Sequence, or list of Frame
        Frames in a list may have scenes and cameras of their own; of cameras the sensors have the same shape.
    cameras : mapping from str to PlenopticCamera, optional
        Cameras that see the frames of a `Sequence`, each in place of its camera: posed as it is, and moved by
        `camera_motion`. Names are letters, digits, - and _. None: the one of the sequence, called "camera".
    samples, target_error, replicates, truth, threads, client
        As for `render`, of each frame.
    motion : bool
        True to compute the positions of the pixels' points in the next frame: see `motion_truth`.
    seed : int
        Seed from which those of all images are drawn; the manifest lists them.
    settings : RenderSettings, optional
        Further arguments of `render`.
    progress : bool
        True to show a progress bar.

    Returns
    -------
    DataSet

    Raises
    ------
    InvalidValueError
        If an argument is impossible, or a frame does not fit those before: colours after grey ones.
    FileError
        If the folder holds something else, or data of other inputs, or another program is writing to it.

    Notes
    -----
    docs/how_to/data_sets.md describes the files. Frames of more than 16 megapixels are rendered in bands of some
    multiple of 512 rows, so that memory is bounded, also by their numbers of bytes; with a `target_error` each band
    reaches it by itself. Needs the package zarr.

    Examples
    --------
    >>> import pathlib, tempfile, numpy as np, plenoptic as pl
    >>> camera = pl.PlenopticCamera(lens=pl.load_lens("double-gauss-100mm-f2"),
    ...     sensor=pl.Sensor(shape=(16, 16), pixel_pitch=0.5), stop_to_microlenses=130.0)
    >>> turn = pl.Motion.screw((0, 1), axis=(0, 1, 0), through=(0, 0, -404), angle_deg=90)
    >>> scene = pl.Scene([pl.box(8).translated(z=-404)], background=1.0)
    >>> sequence = pl.Sequence(scene, camera, np.linspace(0, 1, 3), motions={"Mesh 0": turn})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     made = pl.dataset.write(pathlib.Path(folder) / "turn", sequence, samples=4, motion=True, progress=False)
    ...     again = pl.dataset.read(made.path)
    ...     print(again, again.frame(1).image.shape, again.motion(0).shift.shape)
    DataSet(3 frames, camera camera) (16, 16, 1) (16, 16, 2)
    """
    zarr_module()
    if samples is None and target_error is None:
        raise InvalidValueError("samples and target_error are both None; give one of them, such as samples=64")
    budget = checked_budget(samples, None, target_error, replicates)
    settings = RenderSettings() if settings is None else settings
    check_kind(settings, "settings", RenderSettings, "pl.rendering.RenderSettings(max_bounces=2)")
    thread_count(threads)
    cluster_of(client, threads)
    shared = (budget.samples, budget.target_error, budget.replicates)
    options = FrameOptions(*shared, valid_truth(truth), flag(motion, "motion"), seed_number(seed), settings)
    sequences, show_bar = named_cameras(sequence, cameras), flag(progress, "progress")
    target = _folder(folder)
    with claim_folder(target):
        journal = Journal(target / LOG, options.identity(sequences), len(next(iter(sequences.values()))))
        try:
            _Writer(target, sequences, options, journal, {"threads": threads, "client": client}).run(show=show_bar)
        finally:
            journal.close()
        write_statistics(target, journal.done)
        manifest = write_manifest(target, sequences, options, journal)
        write_contact_sheet(target, manifest["images"])
    return DataSet(target, MappingProxyType(manifest))


def _folder(folder: str | os.PathLike[str]) -> Path:
    """A folder that is made if there is none; FileError if it holds something else than a data set."""
    target = real_path(folder)
    if not target.exists():
        check_folder(target)
    with translate_errors(target, "used"):
        target.mkdir(exist_ok=True)
        if not (target / LOG).is_file() and not is_empty_folder(target):
            raise FileError(f"{str(target)!r} is there and holds no data set; choose a new name, or remove it first")
    return target


@contextmanager
def _frame_bar(total: int, *, show: bool) -> Iterator[Any]:
    """Context manager of a bar over all tasks, with the time left; None if it is not to be shown."""
    if not show:
        yield None
        return
    bar = load_tqdm()(total=total, unit="part")
    with bar, Poller(lambda: bar.set_postfix_str(compiling_text("scene", after=DELAY))):
        yield bar


class _Writer:
    """Writer of missing frames."""

    def __init__(
        self,
        folder: Path,
        sequences: Mapping[str, Frames],
        options: FrameOptions,
        journal: Journal,
        workers: dict[str, Any],
    ) -> None:
        self._folder, self._sequences, self._options = folder, sequences, options
        self._journal, self._workers = journal, workers
        # Stores are opened as they are to look for chunks, and extended only when a frame is to be written.
        self._old_stores, self._stores = dict[str, Store](), dict[str, Store]()

    def run(self, *, show: bool) -> None:
        """Render frames until all are on the disk, or Ctrl-C."""
        tasks = list(tasks_of(self._sequences, motion=self._options.motion))
        frames: dict[int, dict[str, Frame]] = {}
        with _frame_bar(len(tasks), show=show) as bar:
            for task in tasks:
                frames = {k: frames.get(k) or self._frames(k) for k in task.frames}
                task_frames = [frames[k][task.camera] for k in task.frames]
                inputs = inputs_of(*task_frames)
                if self._is_done(task, task_frames[0].camera, self._journal.record_of(task, inputs)):
                    if bar is not None and not bar.disable:  # the time left is that of tasks to be done
                        bar.initial += 1
                        bar.n += 1
                    continue
                result = self._image(task, *task_frames) if task.image else self._motion(task, *task_frames)
                if result is None:
                    break
                self._save(task, inputs, *result)
                del result  # before the next one takes memory
                if bar is not None:
                    bar.update()

    def _is_done(self, task: Task, camera: PlenopticCamera, record: Mapping[str, Any] | None) -> bool:
        """True if a task is recorded, and its chunks have not been removed since."""
        if record is None or not self._path(task).exists():
            return False
        region = (*task.rows, 0, camera.sensor.shape[1])
        if task.camera not in self._old_stores:
            self._old_stores[task.camera] = Store(self._path(task))
        return self._old_stores[task.camera].has(region, record["arrays"], frame=task.frame)

    def _frames(self, k: int) -> dict[str, Frame]:
        """Frames of all cameras at a time, with one scene, which is compiled once."""
        frames = {name: sequence[k] for name, sequence in self._sequences.items()}
        scene = next(iter(frames.values())).scene
        return {name: Frame(scene, frame.camera, frame.time) for name, frame in frames.items()}

    def _save(self, task: Task, inputs: str, facts: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
        """Write arrays to the disk, and then the record of their task."""
        store, sha = self._stores[task.camera], hashlib.sha256()
        columns = next(iter(arrays.values())).shape[1]
        store.put((*task.rows, 0, columns), arrays, frame=task.frame)
        store.flush(task.frame)
        for name in sorted(arrays):
            sha.update(name.encode() + bytes_of(np.ascontiguousarray(arrays[name])))
        self._journal.add(task, {**facts, "inputs": inputs, "arrays": sorted(arrays), "sha256": sha.hexdigest()})
        if task.image:
            self._checkpoint(task).unlink(missing_ok=True)

    def _image(self, task: Task, frame: Frame) -> tuple[dict[str, Any], dict[str, NDArray[Any]]] | None:
        """Facts and arrays of a rendered image; None if it was interrupted."""
        options, (rows, columns), (first, end) = self._options, frame.camera.sensor.shape, task.rows
        about = {**described_frame(frame), "versions": versions()}
        paths = (end - first) * columns * (options.samples or _USUAL)
        seed = frame_seed(options.seed, task.frame, list(self._sequences).index(task.camera))
        shot = render(
            frame.scene,
            frame.camera,
            **{name: getattr(options, name) for name in ("samples", "target_error", "replicates", "truth")},
            **vars(options.settings),
            region=None if (first, end) == (0, rows) else np.s_[first:end, :],
            seed=seed,
            checkpoint=self._checkpoint(task) if paths >= _LONG else None,
            progress=False,
            **self._workers,
        )
        if shot.interrupted:
            return None
        facts = {"seed": seed, "replicates": shot.replicates, "samples": shot.samples, **statistics_of(shot), **about}
        facts |= {name: self._journal.share(about[name]) for name in SHARED}
        return facts, self._arrays(task, frame, shot)

    def _arrays(self, task: Task, frame: Frame, shot: Exposure) -> dict[str, NDArray[Any]]:
        """Arrays of an image as the store of its camera holds them; the store is made with the first image."""
        arrays = pixels_of(shot)
        if self._options.target_error is not None:
            arrays.setdefault("sample_counts", np.full(shot.image.shape[:2], shot.samples, dtype=np.int32))
        path = self._path(task)
        if not path.exists():
            frames = self._sequences[task.camera]
            cameras = (frames.camera,) if isinstance(frames, Sequence) else (each.camera for each in frames)
            microlenses = any(camera.microlenses is not None for camera in cameras)
            layout = layout_of(shot, self._options.truth, microlenses=microlenses)
            layout = layout._replace(shape=frame.camera.sensor.shape, corner=(0, 0))
            names = (*dict.fromkeys((*layout.names, *arrays)), *(MOTION_NAMES if self._options.motion else ()))
            with replace_folder(path) as new:
                create_store(new, layout._replace(names=names), {}, times=times_of(self._sequences[task.camera]))
        channels = self._store(task).array("image").shape[-1]
        for name in ("image", "standard_error"):
            if name in arrays and arrays[name].shape[2] < channels:
                arrays[name] = np.repeat(arrays[name], channels, axis=2)
        if shot.image.shape[2] > channels:
            raise InvalidValueError(
                f"frame {task.frame} of {task.camera!r} has colours, and the data set began with grey frames; "
                "begin with one that has something of a colour, however dark"
            )
        return arrays

    def _motion(self, task: Task, now: Frame, following: Frame) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        first, end = task.rows
        threads = self._workers["threads"]
        try:
            motion = motion_truth(now, following, region=np.s_[first:end, :], threads=threads, progress=False)
        except InvalidValueError as error:
            raise InvalidValueError(f"frames {task.frame} and {task.frame + 1} have no motion: {error}") from None
        self._store(task)
        arrays = dict(zip(MOTION_NAMES, (motion.position, motion.shift, motion.visible), strict=True))
        return {"visible": float(motion.visible.mean())}, arrays

    def _store(self, task: Task) -> Store:
        """The store of a camera, with room for all frames."""
        if task.camera not in self._stores:
            times = times_of(self._sequences[task.camera])
            self._stores[task.camera] = Store(self._path(task))
            self._stores[task.camera].extend(len(times), {"time": times})
        return self._stores[task.camera]

    def _path(self, task: Task) -> Path:
        return self._folder / f"{task.camera}.zarr"

    def _checkpoint(self, task: Task) -> Path:
        return self._folder / f"{task.camera}-{task.frame}-{task.rows[0]}.checkpoint"
