"""Cache of the result of the last call, for the next call with the same object."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Generic, TypeVar

_Object = TypeVar("_Object")
_Result = TypeVar("_Result")


class LastResultCache(Generic[_Object, _Result]):
    """A function of an immutable object that keeps its last result while that object exists.

    There is no lock, since a process forked off while it is held would wait for ever. Two threads may both compute a
    result.
    """

    def __init__(self, function: Callable[[_Object], _Result]) -> None:
        self._function = function
        self._last: tuple[weakref.ref[_Object], _Result] | None = None

    def __call__(self, key: _Object) -> _Result:
        """Result for an object, from the cache if it is the object of the last call."""
        last = self._last
        if last is not None and last[0]() is key:
            return last[1]
        del last
        self._last = None  # before the next one takes memory
        result = self._function(key)
        self._last = (weakref.ref(key, self._forget), result)
        return result

    def _forget(self, gone: weakref.ref[_Object]) -> None:
        """Discard the result for an object that no longer exists."""
        last = self._last
        if last is not None and last[0] is gone:
            self._last = None
