"""Checkpoints: the file in which a render keeps the results of its tiles.

Each record holds the result of some samples of a tile, with the sums of all its samples until then. Tiles are pure
functions, so that a render that goes on takes the results of its next tiles from the file, and renders the rest:
with more samples or a smaller error than last time, too. Sums live in the file, and not in memory.
"""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from plenoptic.core.files.record_log import Entry, LogKind, RecordLog, begin_log, log_exists
from plenoptic.core.values import Floats, file_path, positive
from plenoptic.core.warn import warn
from plenoptic.errors import FileError, FileWarning
from plenoptic.rendering.context import RenderContext, batch_of
from plenoptic.rendering.schedule.identity import differences
from plenoptic.rendering.schedule.progress import Progress
from plenoptic.rendering.schedule.sums import SumsInMemory
from plenoptic.rendering.schedule.tile_records import TRUTH, are_sums, has_arrays, has_facts
from plenoptic.rendering.tile import Tile, TileResult

_ELSEWHERE = "give checkpoint= another path, or remove the file"
KIND = LogKind("checkpoint", 2, _ELSEWHERE)
_NUMBERS = ("paths", "nonfinite", "met", "light", "clamped")


class Checkpoint:
    """Checkpoint file with the results of tiles."""

    def __init__(self, path: str | os.PathLike[str], interval: float, identity: Mapping[str, str]) -> None:
        """Look at the file, if there is one: a FileError where it is another render's, or none could be written."""
        self._path = file_path(path)
        self._interval = positive(interval, "checkpoint_interval", "s")
        self._identity = dict(identity)
        self._log: RecordLog | None = None
        self._flushed = time.perf_counter()
        self._tiles: dict[Tile, int] = {}
        self._found: dict[tuple[int, int], list[Entry]] = {}
        """Records by tile and first sample."""
        self._last: dict[int, Entry] = {}
        self._unwritten = SumsInMemory()
        if log_exists(self._path):
            try:
                self._open()
            except BaseException:
                self.close()
                raise

    @property
    def tile_side(self) -> int | None:
        """Side of the tiles in the file; None where there is none yet."""
        return None if self._log is None else self._log.header["tile_side"]

    @property
    def holds(self) -> bool:
        """True if the file holds records."""
        return self._log is not None and bool(self._log.entries)

    def begin(self, progress: Progress, side: int) -> None:
        """Begin the file if there is none, and read its records of the tiles of a render."""
        if self._log is None:
            begin_log(self._path, KIND, {"identity": self._identity, "tile_side": side})
            self._open()
        assert self._log is not None
        self._tiles = {tile: i for i, tile in enumerate(progress.tiles)}
        processors: dict[str, None] = {}
        damaged = 0
        for entry in self._log.entries:
            facts, whole = entry.facts, has_facts(entry)
            i = self._tiles.get(Tile(*facts["tile"])) if whole else None
            if not whole or (i is not None and not has_arrays(entry, progress)):
                damaged += 1
            elif i is not None:
                self._found.setdefault((i, facts["first"]), []).append(entry)
                processors[facts["processor"]] = None
                progress.before = facts["seconds"], facts["cpu_seconds"]
        if damaged:
            self._warn_of(damaged)
        here = progress.film.processors[0]
        if others := [kind for kind in processors if kind != here]:
            progress.film.processors = (*others, here)
            warn(
                f"{str(self._path)!r} was begun on another kind of processor, {' and '.join(others)}; this is {here}: "
                "the image is as good, but its bits are those of neither; stats.processors names both"
            )

    def recorded(self, i: int, done: int, most: int, replicates: int) -> Entry | None:
        """The record that takes a tile furthest from `done` samples, by `most` more at most; None without one.

        A tile with fewer samples has as many of each replicate, or no batch could follow it.
        """
        here = [(int(entry.facts["samples"]), entry) for entry in self._found.get((i, done), ())]
        fitting = [(n, entry) for n, entry in here if n == most or (n < most and n % replicates == 0)]
        return max(fitting, key=lambda found: found[0], default=(0, None))[1]

    def result(self, i: int, entry: Entry, context: RenderContext) -> TileResult | None:
        """Result of a record; None where it is damaged, as if it had never been written."""
        assert self._log is not None
        facts, arrays = entry.facts, self._log.read(entry)
        if arrays is None or not are_sums(arrays, facts["paths"]):
            self._found[i, facts["first"]].remove(entry)
            self._warn_of(1)
            return None
        truth = {name.removeprefix(TRUTH): array for name, array in arrays.items() if name.startswith(TRUTH)}
        return TileResult(
            tile=Tile(*facts["tile"]),
            batch=batch_of(context, facts["first"], 1)._replace(samples=facts["samples"]),  # its points are not needed
            sums=arrays["sums"],
            weights=arrays.get("weights"),
            counts=arrays["counts"],
            truth=truth or None,
            lost_paths=tuple((row, column, sample) for row, column, sample in facts["lost_paths"]),
            **{name: facts[name] for name in _NUMBERS},
        )

    def keep(self, i: int, result: TileResult, progress: Progress, entry: Entry | None) -> None:
        """Write the result of a tile, unless it is present. Where that fails, the render goes on, with a warning."""
        if entry is None:
            try:
                entry = self._written(result, progress)
            except FileError as error:
                warn(f"the checkpoint has not been written: {error}", FileWarning)
        if entry is None:
            self._last.pop(i, None)
            self._unwritten.keep(i, result, progress, None)
        else:
            self._last[i] = entry
            self._unwritten.drop(i)

    def of(self, i: int) -> Floats | None:
        """See `Sums`."""
        entry = self._last.get(i)
        if entry is None:
            return self._unwritten.of(i)
        assert self._log is not None
        arrays = self._log.read(entry)
        if arrays is None:
            raise FileError(f"{str(self._path)!r} has been damaged while it was used; {_ELSEWHERE}")
        return np.asarray(arrays["sums"])

    def flush(self, *, at_once: bool = False) -> None:
        """Put the file on the disk, if it is time."""
        if self._log is None or not (at_once or time.perf_counter() - self._flushed >= self._interval):
            return
        try:
            self._log.flush()
        except FileError as error:
            warn(f"the checkpoint has not been written: {error}", FileWarning)
        self._flushed = time.perf_counter()

    def close(self) -> None:
        """Let go of the file."""
        if self._log is not None:
            self._log.close()

    def _open(self) -> None:
        self._log = log = RecordLog(self._path, KIND)
        theirs, side = log.header.get("identity"), log.header.get("tile_side")
        told = {name: str(text) for name, text in theirs.items()} if isinstance(theirs, dict) else {}
        if told != self._identity:
            what = ", ".join(differences(told, self._identity))
            raise FileError(f"{str(self._path)!r} belongs to another render, with {what}; {_ELSEWHERE}")
        if type(side) is not int or side < 1:
            raise FileError(f"{str(self._path)!r} is a damaged checkpoint: its tile_side is {side!r}; {_ELSEWHERE}")
        if log.damaged:
            warn(
                f"{log.damaged} bytes of {str(self._path)!r} are damaged, or were being written when the program "
                "ended; what they held is rendered again",
                FileWarning,
            )

    def _warn_of(self, damaged: int) -> None:
        records = "a record of {} is" if damaged == 1 else f"{damaged} records of {{}} are"
        warn(f"{records.format(repr(str(self._path)))} damaged, and what was held is rendered again", FileWarning)

    def _written(self, result: TileResult, progress: Progress) -> Entry:
        assert self._log is not None
        progress.note_time()
        batch = result.batch
        facts: dict[str, Any] = {"tile": result.tile, "first": int(batch.first), "samples": int(batch.samples)}
        facts |= {name: getattr(result, name) for name in (*_NUMBERS, "lost_paths")}
        facts |= {"seconds": progress.seconds, "cpu_seconds": progress.cpu_seconds}
        facts["processor"] = progress.film.processors[-1]
        optional = {"weights": result.weights}
        optional |= {f"{TRUTH}{name}": array for name, array in (result.truth or {}).items()}
        arrays = {"sums": result.sums, "counts": result.counts}
        return self._log.append(facts, arrays | {name: array for name, array in optional.items() if array is not None})
