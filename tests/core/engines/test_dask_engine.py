"""Orders on a cluster: all are carried out once, few at a time, in groups, by workers that have what is here."""

import sys
import time
import warnings
from pathlib import Path
from typing import NamedTuple

import pytest

import plenoptic as pl
from plenoptic.core.engines import dask_engine, dask_worker
from plenoptic.core.engines.dask_engine import DaskCluster
from plenoptic.errors import PlenopticWarning

sys.path.insert(0, str(Path(__file__).parent))
import fake_client


class Order(NamedTuple):
    number: int
    size: float = 1.0
    nbytes: int = 8


def adder(given, threads):
    """What carries out orders: adds a number that all have in common."""
    if given == "broken":
        raise ValueError("nothing can be made of this")

    def add(order):
        if order.number < 0:
            raise ZeroDivisionError("this order cannot be carried out")
        time.sleep(order.size * 1e-3)
        return order.number + given

    return add


@pytest.fixture
def client():
    made = fake_client.FakeClient(workers=3)
    yield made
    made.close()


def found(client, orders, *, given=100, late=None, given_up=lambda: False):
    with DaskCluster(client).engine(adder, given, late=late) as engine:
        return list(engine.results(iter(orders), left=len(orders), given_up=given_up))


def test_every_order_is_carried_out_once(client):
    orders = [Order(i) for i in range(200)]
    done = found(client, orders)
    assert {one.order.number: one.result for one in done} == {i: i + 100 for i in range(200)} and len(done) == 200
    assert [one.order.number for one in done] != list(range(200))  # in any order
    assert all(one.seconds >= 1e-3 for one in done)


def test_one_worker_of_each_host_gets_ready_first(client):
    found(client, [Order(i) for i in range(9)])
    assert client.calls[:4] == ["Job", *3 * ["prepared"]]
    client.addresses, client.calls[:] = ["tcp://10.0.0.1:1", "tcp://10.0.0.1:2"], []
    found(client, [Order(i) for i in range(9)])
    assert client.calls[:3] == ["Job", "prepared", "carry_out"]


def test_tasks_get_larger_once_it_is_known_how_long_orders_take(client, monkeypatch):
    found(client, [Order(i) for i in range(600)])
    tasks = client.calls.count("carry_out")
    assert 12 + 3 < tasks < 100  # single orders first, at most a sixth of what is left, and single ones in the end
    client.calls.clear()
    # Neither large ones nor where time is limited: each is a task of its own then.
    found(client, [Order(i, nbytes=5 << 20) for i in range(40)])
    found(client, [Order(i) for i in range(40)], late=lambda: False)
    assert client.calls.count("carry_out") == 80
    monkeypatch.setattr(dask_engine, "_SECONDS", 1e-3)
    found(client, [Order(i) for i in range(60)])
    assert client.calls.count("carry_out") == 140


def test_few_orders_are_drawn_before_results_are_taken(client):
    drawn = []

    def orders():
        for i in range(10_000):
            drawn.append(i)
            yield Order(i, size=0.0, nbytes=5 << 20)  # one in a task

    with DaskCluster(client).engine(adder, 1) as engine:
        results = engine.results(orders(), left=10_000, given_up=lambda: False)
        for taken in range(1, 21):
            next(results)
            assert len(drawn) <= taken + 4 * 3
        results.close()
    assert client.cancelled and not client.waiting


def test_what_is_no_longer_wanted_is_cancelled(client):
    asked = []
    with DaskCluster(client).engine(adder, 1) as engine:
        results = engine.results(map(Order, range(10_000)), left=10_000, given_up=lambda: bool(asked))
        next(results)
        asked.append(True)
        begin = time.perf_counter()
        assert len(list(results)) < 10_000 and time.perf_counter() - begin < 5
    assert client.cancelled and not client.waiting


def test_errors_of_workers_are_those_of_the_call(client):
    with pytest.raises(ZeroDivisionError, match="cannot be carried out"):
        found(client, [Order(1), Order(-1), Order(2)])
    with pytest.raises(ValueError, match="nothing can be made"):
        found(client, [Order(1)], given="broken")


def test_a_job_is_made_once_in_a_worker(client, monkeypatch):
    dask_worker._made.clear()
    found(client, [Order(i) for i in range(30)], given=7)
    found(client, [Order(i) for i in range(30)], given=7)
    assert len(dask_worker._made) == 1
    for given in (8, 9, 10):
        found(client, [Order(0)], given=given)
    assert len(dask_worker._made) == 2


def test_workers_that_cannot_take_part_are_refused():
    here, missing = dask_worker.surroundings(), ModuleNotFoundError("No module named 'plenoptic'")
    for surroundings, workers, said in (
        ({**here, "plenoptic": "0.0"}, 2, r"worker tcp://10.0.0.0:8000 with plenoptic 0.0, not"),
        ({**here, "kernels": "0.0"}, 2, r"worker tcp://10.0.0.0:8000 with other kernels; install"),
        ({**here, "numba": "0.0"}, 2, r"with numba 0.0, not"),
        ({**here, "numpy": "0.0"}, 2, r"with numpy 0.0, not"),
        (missing, 2, r"cannot render \(ModuleNotFoundError: No module"),
        (here, 0, "no workers; start some"),
    ):
        client = fake_client.FakeClient(workers, surroundings=surroundings)
        with pytest.raises(pl.errors.InvalidValueError, match=said):
            DaskCluster(client)
        client.close()
        assert not client.calls, said
    with pytest.raises(pl.errors.InvalidValueError, match=r"client is a str; it must be a distributed.Client"):
        DaskCluster("tcp://10.0.0.1:8786")


def test_workers_that_come_later_are_asked_too(client, monkeypatch):
    cluster = DaskCluster(client)
    cluster.surroundings["numpy"] = "0.0"  # what the client has
    with pytest.raises(pl.errors.InvalidValueError, match="a worker with numpy"), cluster.engine(adder, -3):
        pass


def test_processors_of_different_kinds_are_told(client):
    kinds = iter(("one (fma)", "other (neon)", "other (neon)"))
    client.run = lambda function, on_error: {
        address: {**function(), dask_worker.PROCESSOR: next(kinds)} for address in client.addresses
    }
    with pytest.warns(PlenopticWarning, match=r"different kinds, one \(fma\) and other \(neon\)"):
        cluster = DaskCluster(client)
    assert cluster.processors == ("one (fma)", "other (neon)")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        cluster.note_processor("one (fma)")
