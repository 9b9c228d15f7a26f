"""Jobs on a cluster: each runs once, few at a time, in groups, on workers of the same environment."""

import time
import warnings
from typing import NamedTuple

import fake_client
import pytest

import plenoptic as pl
from plenoptic.core.engines import dask_engine, dask_worker
from plenoptic.core.engines.dask_engine import DaskCluster
from plenoptic.errors import PlenopticWarning


class Job(NamedTuple):
    number: int
    size: float = 1.0
    nbytes: int = 8


def adder(given, threads):
    """Function that runs jobs: adds a number that all have in common."""
    if given == "broken":
        raise ValueError("nothing can be made of this")

    def add(job):
        if job.number < 0:
            raise ZeroDivisionError("this job cannot be run")
        time.sleep(job.size * 1e-3)
        return job.number + given

    return add


@pytest.fixture
def client():
    fake = fake_client.FakeClient(workers=3)
    yield fake
    fake.close()


def run(client, jobs, *, given=100, out_of_time=None):
    with DaskCluster(client).engine(adder, given, out_of_time=out_of_time) as engine:
        return list(engine.results(iter(jobs), n_jobs=len(jobs), is_cancelled=lambda: False))


def test_every_job_runs_once(client):
    jobs = [Job(i) for i in range(200)]
    results = run(client, jobs)
    assert {one.job.number: one.result for one in results} == {i: i + 100 for i in range(200)} and len(results) == 200
    assert [one.job.number for one in results] != list(range(200))  # in any order
    assert all(one.seconds >= 1e-3 for one in results)


def test_one_worker_of_each_host_gets_ready_first(client):
    run(client, [Job(i) for i in range(9)])
    assert client.calls[:4] == ["SharedState", *3 * ["prepare_worker"]]
    client.addresses, client.calls[:] = ["tcp://10.0.0.1:1", "tcp://10.0.0.1:2"], []
    run(client, [Job(i) for i in range(9)])
    assert client.calls[:3] == ["SharedState", "prepare_worker", "run_jobs"]


def test_tasks_get_larger_once_it_is_known_how_long_jobs_take(client, monkeypatch):
    run(client, [Job(i) for i in range(600)])
    tasks = client.calls.count("run_jobs")
    assert 12 + 3 < tasks < 100  # single jobs first, at most a sixth of what is left, and single ones in the end
    client.calls.clear()
    # Neither large ones nor where time is limited: each is a task of its own then.
    run(client, [Job(i, nbytes=5 << 20) for i in range(40)])
    run(client, [Job(i) for i in range(40)], out_of_time=lambda: False)
    assert client.calls.count("run_jobs") == 80
    monkeypatch.setattr(dask_engine, "_SECONDS", 1e-3)
    run(client, [Job(i) for i in range(60)])
    assert client.calls.count("run_jobs") == 140


def test_few_jobs_are_drawn_before_results_are_taken(client):
    drawn = []

    def jobs():
        for i in range(10_000):
            drawn.append(i)
            yield Job(i, size=0.0, nbytes=5 << 20)  # one in a task

    with DaskCluster(client).engine(adder, 1) as engine:
        results = engine.results(jobs(), n_jobs=10_000, is_cancelled=lambda: False)
        for n_results in range(1, 21):
            next(results)
            assert len(drawn) <= n_results + 4 * 3
        results.close()
    assert client.cancelled and not client.waiting


def test_what_is_no_longer_wanted_is_cancelled(client):
    asked = []
    with DaskCluster(client).engine(adder, 1) as engine:
        results = engine.results(map(Job, range(10_000)), n_jobs=10_000, is_cancelled=lambda: bool(asked))
        next(results)
        asked.append(True)
        assert len(list(results)) < 10_000
    assert client.cancelled and not client.waiting


def test_errors_of_workers_are_those_of_the_call(client):
    with pytest.raises(ZeroDivisionError, match="cannot be run"):
        run(client, [Job(1), Job(-1), Job(2)])
    with pytest.raises(ValueError, match="nothing can be made"):
        run(client, [Job(1)], given="broken")


def test_shared_state_is_prepared_once_in_a_worker(client, monkeypatch):
    dask_worker._run_functions.clear()
    run(client, [Job(i) for i in range(30)], given=7)
    run(client, [Job(i) for i in range(30)], given=7)
    assert len(dask_worker._run_functions) == 1
    for content in (8, 9, 10):
        run(client, [Job(0)], given=content)
    assert len(dask_worker._run_functions) == 2


def test_workers_that_cannot_take_part_are_refused():
    client_environment, missing = dask_worker.environment(), ModuleNotFoundError("No module named 'plenoptic'")
    for worker_environment, workers, said in (
        ({**client_environment, "plenoptic": "0.0"}, 2, r"worker tcp://10.0.0.0:8000 with plenoptic 0.0, not"),
        ({**client_environment, "kernels": "0.0"}, 2, r"worker tcp://10.0.0.0:8000 with other kernels; install"),
        ({**client_environment, "numba": "0.0"}, 2, r"with numba 0.0, not"),
        ({**client_environment, "numpy": "0.0"}, 2, r"with numpy 0.0, not"),
        (missing, 2, r"cannot render \(ModuleNotFoundError: No module"),
        (client_environment, 0, "no workers; start some"),
    ):
        client = fake_client.FakeClient(workers, surroundings=worker_environment)
        with pytest.raises(pl.errors.InvalidValueError, match=said):
            DaskCluster(client)
        client.close()
        assert not client.calls, said
    with pytest.raises(pl.errors.InvalidValueError, match=r"client is a str; it must be a distributed.Client"):
        DaskCluster("tcp://10.0.0.1:8786")


def test_workers_that_come_later_are_asked_too(client, monkeypatch):
    cluster = DaskCluster(client)
    cluster.environment["numpy"] = "0.0"  # what the client has
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
        cluster.add_processor("one (fma)")
