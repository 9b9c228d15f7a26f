"""Checkpoints: file in which a render stores the results of its tiles.

Each record is the result of some samples of a tile, with the sums of all its samples until then. Tiles are pure
functions, so that a resumed render takes from the file what it would have rendered next, and renders the rest: also
with more samples or a smaller error than before. Sums are in the file, not in memory.
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
_NUMBERS = {name: name for name in ("paths", "nonfinite", "light", "clamped")} | {"scene_hits": "met"}
"""Fields of `TileResult`, and their keys in the file."""


class Checkpoint:
    """Stores the results of tiles in a file."""

    def __init__(self, path: str | os.PathLike[str], interval: float, identity: Mapping[str, str]) -> None:
        """Open the file if it exists; raise FileError if it is another render's, or cannot be written."""
        self._path = file_path(path)
        self._interval = positive(interval, "checkpoint_interval", "s")
        self._identity = dict(identity)
        self._log: RecordLog | None = None
        self._flushed = time.perf_counter()
        self._tiles: dict[Tile, int] = {}
        self._records: dict[tuple[int, int], list[Entry]] = {}
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
        """Side of the tiles in the file; None without a file."""
        return None if self._log is None else self._log.header["tile_side"]

    @property
    def has_records(self) -> bool:
        """True if the file contains records."""
        return self._log is not None and bool(self._log.entries)

    def begin(self, progress: Progress, side: int) -> None:
        """Create the file if necessary, and look up its records of the tiles of a render."""
        if self._log is None:
            begin_log(self._path, KIND, {"identity": self._identity, "tile_side": side})
            self._open()
        assert self._log is not None
        self._tiles = {tile: i for i, tile in enumerate(progress.tiles)}
        processors: dict[str, None] = {}
        damaged = 0
        for entry in self._log.entries:
            facts, complete = entry.facts, has_facts(entry)
            i = self._tiles.get(Tile(*facts["tile"])) if complete else None
            if not complete or (i is not None and not has_arrays(entry, progress)):
                damaged += 1
            elif i is not None:
                self._records.setdefault((i, facts["first"]), []).append(entry)
                processors[facts["processor"]] = None
                progress.before = facts["seconds"], facts["cpu_seconds"]
        if damaged:
            self._warn_of_damage(damaged)
        processor = progress.film.processors[0]
        if other_processors := [kind for kind in processors if kind != processor]:
            progress.film.processors = (*other_processors, processor)
            warn(
                f"{str(self._path)!r} was begun on another kind of processor, {' and '.join(other_processors)}; this "
                f"is {processor}: the image is as good, but its bits are those of neither; stats.processors names both"
            )

    def longest_record(self, i: int, done: int, limit: int, replicates: int) -> Entry | None:
        """Record that takes a tile furthest from `done` samples, by at most `limit`; None without one.

        Shorter records must have as many samples of each replicate, or no batch could follow them.
        """
        records = [(int(entry.facts["samples"]), entry) for entry in self._records.get((i, done), ())]
        usable = [(n, entry) for n, entry in records if n == limit or (n < limit and n % replicates == 0)]
        return max(usable, key=lambda record: record[0], default=(0, None))[1]

    def result(self, i: int, entry: Entry, context: RenderContext) -> TileResult | None:
        """Result stored in a record; None if the record is damaged, which is then discarded."""
        assert self._log is not None
        facts, arrays = entry.facts, self._log.read(entry)
        if arrays is None or not are_sums(arrays, facts["paths"]):
            self._records[i, facts["first"]].remove(entry)
            self._warn_of_damage(1)
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
            **{name: facts[key] for name, key in _NUMBERS.items()},
        )

    def keep(self, i: int, result: TileResult, progress: Progress, entry: Entry | None) -> None:
        """Write the result of a tile, unless it is in the file. A failure is a warning, and the render continues."""
        if entry is None:
            try:
                entry = self._append(result, progress)
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
        """Flush the file to the disk if the interval has passed."""
        if self._log is None or not (at_once or time.perf_counter() - self._flushed >= self._interval):
            return
        try:
            self._log.flush()
        except FileError as error:
            warn(f"the checkpoint has not been written: {error}", FileWarning)
        self._flushed = time.perf_counter()

    def close(self) -> None:
        """Close the file."""
        if self._log is not None:
            self._log.close()

    def _open(self) -> None:
        self._log = log = RecordLog(self._path, KIND)
        stored, tile_side = log.header.get("identity"), log.header.get("tile_side")
        identity = {name: str(text) for name, text in stored.items()} if isinstance(stored, dict) else {}
        if identity != self._identity:
            difference = ", ".join(differences(identity, self._identity))
            raise FileError(f"{str(self._path)!r} belongs to another render, with {difference}; {_ELSEWHERE}")
        if type(tile_side) is not int or tile_side < 1:
            raise FileError(
                f"{str(self._path)!r} is a damaged checkpoint: its tile_side is {tile_side!r}; {_ELSEWHERE}"
            )
        if log.damaged:
            warn(
                f"{log.damaged} bytes of {str(self._path)!r} are damaged, or were being written when the program "
                "ended; their tiles are rendered again",
                FileWarning,
            )

    def _warn_of_damage(self, damaged: int) -> None:
        records = "a record of {} is" if damaged == 1 else f"{damaged} records of {{}} are"
        warn(f"{records.format(repr(str(self._path)))} damaged, and their tiles are rendered again", FileWarning)

    def _append(self, result: TileResult, progress: Progress) -> Entry:
        assert self._log is not None
        progress.update_time()
        batch = result.batch
        facts: dict[str, Any] = {"tile": result.tile, "first": int(batch.first), "samples": int(batch.samples)}
        facts |= {key: getattr(result, name) for name, key in _NUMBERS.items()} | {"lost_paths": result.lost_paths}
        facts |= {"seconds": progress.seconds, "cpu_seconds": progress.cpu_seconds}
        facts["processor"] = progress.film.processors[-1]
        optional = {"weights": result.weights}
        optional |= {f"{TRUTH}{name}": array for name, array in (result.truth or {}).items()}
        arrays = {"sums": result.sums, "counts": result.counts}
        return self._log.append(facts, arrays | {name: array for name, array in optional.items() if array is not None})
