"""Cache of the result that was made last, for repeated calls with the same object."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Generic, TypeVar

_Object = TypeVar("_Object")
_Result = TypeVar("_Result")


class LastResult(Generic[_Object, _Result]):
    """Caches a function's result for one immutable object as long as that object exists.

    There is no lock, which a process forked at that moment would wait for forever: two threads may both compute the
    result.
    """

    def __init__(self, compute: Callable[[_Object], _Result]) -> None:
        self._compute = compute
        self._last: tuple[weakref.ref[_Object], _Result] | None = None

    def __call__(self, key: _Object) -> _Result:
        """Result for an object: cached if it is the object of the last call, else computed."""
        last = self._last
        if last is not None and last[0]() is key:
            return last[1]
        del last
        self._last = None  # free memory before the next result
        result = self._compute(key)
        self._last = (weakref.ref(key, self._forget), result)
        return result

    def _forget(self, gone: weakref.ref[_Object]) -> None:
        """Release the result of an object that no longer exists."""
        last = self._last
        if last is not None and last[0] is gone:
            self._last = None
