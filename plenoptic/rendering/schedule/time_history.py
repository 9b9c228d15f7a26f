"""What has been estimated in this process, for the bars of renders of the same."""

from __future__ import annotations

import weakref
from typing import TYPE_CHECKING, NamedTuple

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.rendering.plan.stages import Subject

if TYPE_CHECKING:
    from plenoptic.scene.scene import Scene

_KEPT = 16
"""Estimates: of several that are compared any may be rendered."""


class _Expected(NamedTuple):
    """A time in s, and of what."""

    scene: weakref.ref[Scene] | None
    camera: weakref.ref[PlenopticCamera]
    facts: tuple[object, ...]
    seconds: float

    def is_of(self, subject: Subject, facts: tuple[object, ...]) -> bool:
        """Whether scene and camera are the very ones, since they do not change, and facts are equal."""
        here = subject.scene is None if self.scene is None else self.scene() is subject.scene is not None
        return here and self.camera() is subject.camera and self.facts == facts


class TimeHistory:
    """Those of the last estimates, without keeping scenes and cameras."""

    def __init__(self) -> None:
        self._found: tuple[_Expected, ...] = ()

    def note(self, subject: Subject, *facts: object, seconds: float) -> None:
        """A render of this takes about so long."""
        scene = None if subject.scene is None else weakref.ref(subject.scene)
        found = _Expected(scene, weakref.ref(subject.camera), _all_facts(subject, facts), seconds)
        self._found = (found, *self._found[: _KEPT - 1])

    def of(self, subject: Subject, *facts: object) -> float | None:
        """How long a render takes, in s, by the last estimate of the same; None where there is none."""
        wanted = _all_facts(subject, facts)
        return next((found.seconds for found in self._found if found.is_of(subject, wanted)), None)


def _all_facts(subject: Subject, others: tuple[object, ...]) -> tuple[object, ...]:
    return subject.truth, subject.settings, *others


time_history = TimeHistory()
