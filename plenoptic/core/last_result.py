"""What was made of the object that was used last, for the next call with the same one."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Generic, TypeVar

_Object = TypeVar("_Object")
_Made = TypeVar("_Made")


class LastResult(Generic[_Object, _Made]):
    """Keeps what a function makes of one object, while that object exists: objects do not change.

    There is no lock, for which a process that is forked off meanwhile would wait for ever: two threads may both
    make it.
    """

    def __init__(self, make: Callable[[_Object], _Made]) -> None:
        self._make = make
        self._last: tuple[weakref.ref[_Object], _Made] | None = None

    def __call__(self, key: _Object) -> _Made:
        """What is made of an object, anew unless it is the very one of the last call."""
        last = self._last
        if last is not None and last[0]() is key:
            return last[1]
        del last
        self._last = None  # before the next one takes memory
        found = self._make(key)
        self._last = (weakref.ref(key, self._forget), found)
        return found

    def _forget(self, gone: weakref.ref[_Object]) -> None:
        """Let go of what was made of an object that no longer exists."""
        last = self._last
        if last is not None and last[0] is gone:
            self._last = None
