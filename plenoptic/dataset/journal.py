"""Journal of a data set: a record for each task, written when its results are on the disk."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from plenoptic.core.files.record_log import LogKind, RecordLog, begin_log, log_exists
from plenoptic.core.warn import warn
from plenoptic.dataset.task import Task
from plenoptic.errors import FileError, FileWarning
from plenoptic.rendering.schedule.identity import differences

_ELSEWHERE = "give another folder, or remove it"
SHARED = ("camera_value", "object_names", "versions")
"""Facts of an image that are stored once for all records, which name them by their hash."""
_KIND = LogKind("data set", 1, _ELSEWHERE)


class Journal:
    """The log of a data set, which is begun if there is none; FileError if it is that of another one."""

    def __init__(self, path: Path, identity: Mapping[str, str], n_frames: int) -> None:
        if not log_exists(path):
            begin_log(path, _KIND, {"identity": dict(identity)})
        self._path, self._log = path, RecordLog(path, _KIND)
        records = [entry.facts for entry in self._log.entries]
        self.values = {record["item"]: record["value"] for record in records if {"item", "value"} <= record.keys()}
        """Shared facts by their hashes."""
        # Shared facts may be missing, since the journal may have been damaged: then images are rendered again.
        self.done = {
            Task(record["camera"], record["frame"], (record["rows"][0], record["rows"][1]), record["image"]): record
            for record in records
            if "inputs" in record and (not record["image"] or all(record[name] in self.values for name in SHARED))
        }
        """Records of finished tasks."""
        try:
            self._check(identity, n_frames)
        except BaseException:
            self._log.close()
            raise

    def _check(self, identity: Mapping[str, str], n_frames: int) -> None:
        recorded, folder = self._log.header.get("identity"), str(self._path.parent)
        if recorded != identity:
            what = ", ".join(differences(recorded if isinstance(recorded, dict) else {}, identity))
            raise FileError(f"{folder!r} holds another data set, with {what}; {_ELSEWHERE}")
        if (last := max((task.frame for task in self.done), default=-1)) >= n_frames:
            raise FileError(
                f"frame {last} is in {folder!r}, and the sequence has {n_frames} frames; it may only become longer: "
                f"{_ELSEWHERE}"
            )
        if self._log.damaged:
            warn(
                f"{self._log.damaged} bytes of {str(self._path)!r} are damaged; what they noted is rendered again",
                FileWarning,
            )

    def record_of(self, task: Task, inputs: str) -> dict[str, Any] | None:
        """Record of a task; None if it is not done, and an error if it was done with other inputs."""
        record = self.done.get(task)
        if record is not None and record["inputs"] != inputs:
            raise FileError(
                f"frame {task.frame} in {str(self._path.parent)!r} was {'rendered' if task.image else 'followed'} with "
                f"another scene, camera or time than frame {task.frame} of {task.camera!r}"
                f"{'' if task.image else ', or the one after it,'} has now; {_ELSEWHERE}"
            )
        return record

    def add(self, task: Task, facts: Mapping[str, Any]) -> None:
        """Record a task whose results are on the disk."""
        self.done[task] = {**task._asdict(), **facts}
        self._log.append(self.done[task], {})
        self._log.flush()

    def share(self, value: Any) -> str:
        """Store a value, as JSON, that many records share, and return the hash by which they name it."""
        name = hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()
        if name not in self.values:
            self._log.append({"item": name, "value": value}, {})
            self.values[name] = value
        return name

    def close(self) -> None:
        """Close the file."""
        self._log.close()
