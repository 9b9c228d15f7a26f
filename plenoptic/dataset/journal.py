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
KEPT = ("camera_value", "object_names", "versions")
"""What records of images name, and `Journal.kept` keeps."""
_KIND = LogKind("data set", 1, _ELSEWHERE)


class Journal:
    """The log of a data set, which is begun if there is none; a FileError where it is that of another one."""

    def __init__(self, path: Path, identity: Mapping[str, str], frames: int) -> None:
        if not log_exists(path):
            begin_log(path, _KIND, {"identity": dict(identity)})
        self._path, self._log = path, RecordLog(path, _KIND)
        facts = [entry.facts for entry in self._log.entries]
        self.items = {of["item"]: of["value"] for of in facts if {"item", "value"} <= of.keys()}
        """What `kept` has kept."""
        self.done = {task: of for of in facts if (task := _task(of)) and self._has_items_of(task, of)}
        """What is noted of each task."""
        try:
            self._check(identity, frames)
        except BaseException:
            self._log.close()
            raise

    def _has_items_of(self, task: Task, facts: Mapping[str, Any]) -> bool:
        """True if all files that a record names are present: the journal may have been damaged."""
        return not task.image or all(facts.get(name) in self.items for name in KEPT)

    def _check(self, identity: Mapping[str, str], frames: int) -> None:
        theirs = self._log.header.get("identity")
        if theirs != identity:
            what = ", ".join(differences(theirs if isinstance(theirs, dict) else {}, identity))
            raise FileError(f"{str(self._path.parent)!r} holds another data set, with {what}; {_ELSEWHERE}")
        if (last := max((task.frame for task in self.done), default=-1)) >= frames:
            raise FileError(
                f"frame {last} is in {str(self._path.parent)!r}, and the sequence has {frames} frames; it may only "
                f"become longer: {_ELSEWHERE}"
            )
        if self._log.damaged:
            warn(
                f"{self._log.damaged} bytes of {str(self._path)!r} are damaged; what they noted is rendered again",
                FileWarning,
            )

    def of(self, task: Task, inputs: str) -> dict[str, Any] | None:
        """Record of a task; None where it is not done, and an error where it was done with other inputs."""
        record = self.done.get(task)
        if record is not None and record["inputs"] != inputs:
            raise FileError(
                f"frame {task.frame} in {str(self._path.parent)!r} was {'rendered' if task.image else 'followed'} with "
                f"another scene, camera or time than frame {task.frame} of {task.camera!r}"
                f"{'' if task.image else ', or the one after it,'} has now; {_ELSEWHERE}"
            )
        return record

    def note(self, task: Task, facts: Mapping[str, Any]) -> None:
        """A task is done, and all that it made is on the disk."""
        self._log.append({**task._asdict(), **facts}, {})
        self._log.flush()
        self.done[task] = {**task._asdict(), **facts}

    def kept(self, value: Any) -> str:
        """Store a value, as JSON, that many tasks share, and return the name by which they refer to it."""
        name = hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()
        if name not in self.items:
            self._log.append({"item": name, "value": value}, {})
            self.items[name] = value
        return name

    def close(self) -> None:
        """Let go of the file."""
        self._log.close()


def _task(facts: Mapping[str, Any]) -> Task | None:
    """The task of a record; None where it is that of none."""
    try:
        first, end = facts["rows"]
        task = Task(facts["camera"], facts["frame"], (first, end), facts["image"])
        valid = isinstance(facts["inputs"], str) and isinstance(facts["arrays"], list)
        return task if valid and hash(task) else None
    except (KeyError, TypeError, ValueError):
        return None
