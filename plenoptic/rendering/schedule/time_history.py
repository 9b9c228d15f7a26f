"""Estimated render times in this process, used by the progress bars of equal renders."""

from __future__ import annotations

import weakref
from typing import TYPE_CHECKING, NamedTuple

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.rendering.plan.stages import Subject

if TYPE_CHECKING:
    from plenoptic.scene.scene import Scene

_MAX_ESTIMATES = 16
"""Number of stored estimates: any of several compared settings may be rendered."""


class _EstimatedTime(NamedTuple):
    """Estimated time in s, and its subject."""

    scene: weakref.ref[Scene] | None
    camera: weakref.ref[PlenopticCamera]
    facts: tuple[object, ...]
    seconds: float

    def is_of(self, subject: Subject, facts: tuple[object, ...]) -> bool:
        """True if scene and camera are the same objects, which are immutable, and the facts are equal."""
        same_scene = subject.scene is None if self.scene is None else self.scene() is subject.scene is not None
        return same_scene and self.camera() is subject.camera and self.facts == facts


class TimeHistory:
    """Render times of the last estimates; scenes and cameras are referenced weakly."""

    def __init__(self) -> None:
        self._estimates: tuple[_EstimatedTime, ...] = ()

    def record(self, subject: Subject, *facts: object, seconds: float) -> None:
        """Store the estimated time of a render."""
        scene = None if subject.scene is None else weakref.ref(subject.scene)
        estimate = _EstimatedTime(scene, weakref.ref(subject.camera), _all_facts(subject, facts), seconds)
        self._estimates = (estimate, *self._estimates[: _MAX_ESTIMATES - 1])

    def seconds_of(self, subject: Subject, *facts: object) -> float | None:
        """Estimated time of a render in s, by the last estimate of the same; None without one."""
        all_facts = _all_facts(subject, facts)
        return next((estimate.seconds for estimate in self._estimates if estimate.is_of(subject, all_facts)), None)


def _all_facts(subject: Subject, others: tuple[object, ...]) -> tuple[object, ...]:
    return subject.truth, subject.settings, *others


time_history = TimeHistory()
