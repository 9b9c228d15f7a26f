"""Protocol between the code that divides work into orders and engines that run them; each engine is a file here."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from typing import Generic, NamedTuple, Protocol, TypeVar

from plenoptic.core.parallel import run_in_order


class Order(Protocol):
    """Unit of work: a value that pickles, with its size for engines."""

    @property
    def size(self) -> float:
        """In any unit of work: orders of twice the size take about twice as long."""

    @property
    def nbytes(self) -> int:
        """Approximate number of bytes that it needs or returns."""


OrderT = TypeVar("OrderT", bound=Order)
ResultT = TypeVar("ResultT")
GivenUp = Callable[[], bool]


class Done(NamedTuple, Generic[OrderT, ResultT]):
    """An order that has been carried out."""

    order: OrderT
    result: ResultT
    seconds: float
    """How long it took."""
    elsewhere: float
    """Seconds of processors that it took in other processes than this one."""


class Engine(Protocol[OrderT, ResultT]):
    """Engine that runs orders, pure functions of their members, and returns their results in any order."""

    @property
    def threads(self) -> int:
        """Orders that are carried out at a time."""

    def results(self, orders: Iterable[OrderT], *, left: int, given_up: GivenUp) -> Iterator[Done[OrderT, ResultT]]:
        """Carry out at most `left` orders. Few are drawn before their results are taken, however many there are.

        Where the iterator is closed or `given_up` says so, those that have not begun never begin.
        """


class ThreadEngine(Generic[OrderT, ResultT]):
    """The threads of this process; results come in the order of the orders."""

    def __init__(self, function: Callable[[OrderT, GivenUp], ResultT], threads: int, *, ahead: int = 4) -> None:
        """`function` is told with an order whether its result is no longer wanted; `ahead`: see `run_in_order`."""
        self._function, self._ahead, self.threads = function, ahead, threads

    def results(self, orders: Iterable[OrderT], *, left: int, given_up: GivenUp) -> Iterator[Done[OrderT, ResultT]]:
        """See `Engine`."""

        def work(order: OrderT) -> Done[OrderT, ResultT]:
            begin = time.perf_counter()
            result = self._function(order, given_up)
            return Done(order, result, time.perf_counter() - begin, 0.0)

        return run_in_order(work, orders, threads=min(self.threads, left), ahead=self._ahead, given_up=given_up)
