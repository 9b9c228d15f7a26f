"""Renders on a cluster have the bits of threads, whatever is killed on the way."""

import functools
import os
import random
import signal

import fake_client
import numpy as np
import pytest
from test_resuming import assert_same, render

import plenoptic as pl
from plenoptic.rendering.schedule.progress import Progress


@pytest.fixture
def fake():
    client = fake_client.FakeClient(seed=3)
    yield client
    client.close()


small = functools.partial(render, threads=None)


def test_any_order_of_results_gives_the_same_bits(fake):
    for budget in ({"samples": 16}, {"target_error": 0.2}, {"samples": 512, "replicates": 8}):
        fake.calls.clear()
        one, other = small(**budget), small(client=fake, **budget)
        assert_same(one, other)
        assert other.stats.threads == 2 and fake.calls.count("run_jobs") >= 3, budget
    options = {"samples": 16, "region": np.s_[240:264, 240:264], "tile_side": 8, "progress": False}
    one, other = (pl.render_white(pl.camera.example_camera(), client=client, **options) for client in (None, fake))
    assert one.image.tobytes() == other.image.tobytes()
    with pytest.raises(pl.errors.InvalidValueError, match="threads is 2 and client is given"):
        small(client=fake, samples=16, threads=2)


def test_checkpoints_are_those_of_threads(fake, tmp_path):
    small(client=fake, samples=16, checkpoint=tmp_path / "state")
    calls = len(fake.calls)
    more = small(client=fake, samples=32, checkpoint=tmp_path / "state")
    assert len(fake.calls) > calls
    assert_same(small(samples=32), more)
    assert_same(small(samples=32, checkpoint=tmp_path / "state"), more)


def test_a_time_limit_ends_it(fake):
    shot = small(client=fake, time_limit=1.0)
    assert shot.stats.stopped_by is pl.rendering.StopReason.TIME_LIMIT and shot.samples >= 2
    assert shot.stats.seconds < 5  # roughly


def test_what_was_done_before_the_client_was_closed_is_kept(fake, tmp_path, monkeypatch):
    submit = fake.submit

    def closing(function, *arguments, **options):
        if fake.calls.count("run_jobs") >= 2:
            fake.status = "closed"
            raise RuntimeError("no comm")
        return submit(function, *arguments, **options)

    with monkeypatch.context() as patch, pytest.warns(pl.errors.PlenopticWarning, match="client was closed"):
        patch.setattr(fake, "submit", closing)
        shot = small(client=fake, samples=16, checkpoint=tmp_path / "state")
    assert shot.interrupted and shot.sample_counts.any() and not shot.sample_counts.all()
    assert_same(small(samples=16), small(samples=16, checkpoint=tmp_path / "state"))
    with pytest.raises(pl.PlenopticError, match="client was closed"), monkeypatch.context() as patch:
        patch.setattr(fake, "submit", closing)
        pl.render(pl.objects_scene(), pl.camera.example_camera(), samples=4, client=fake, progress=False)


def test_an_interrupt_ends_it(fake, monkeypatch):
    take = Progress.take

    def interrupting(self, i, result):
        take(self, i, result)
        os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(Progress, "take", interrupting)
    with pytest.warns(pl.errors.BudgetWarning, match="interrupted"):
        shot = small(client=fake, samples=16)
    assert shot.stats.stopped_by is pl.rendering.StopReason.INTERRUPTED
    assert 0 < (shot.image[..., 0] > 0).sum() < shot.image[..., 0].size / 2
    assert fake.cancelled


def test_ground_truth_has_the_same_bits(fake, monkeypatch):
    monkeypatch.setattr("plenoptic.truth.ground_truth._STRIP", 64)  # two rows and a bit
    options = {"region": np.s_[240:264, 240:264], "progress": False}
    one = pl.ground_truth(pl.objects_scene(), pl.camera.example_camera(), **options)
    other = pl.ground_truth(pl.objects_scene(), pl.camera.example_camera(), client=fake, **options)
    assert fake.calls.count("run_jobs") >= 3
    for name in one.__dataclass_fields__:
        a, b = getattr(one, name), getattr(other, name)
        assert (a is None and b is None) or a.tobytes() == b.tobytes(), name


@pytest.mark.slow
def test_two_workers_may_be_killed(monkeypatch):
    distributed = pytest.importorskip("distributed", reason="the extra `cluster` installs it")
    import dask

    chance, take, killed, results = random.Random(1), Progress.take, [], iter(range(1 << 20))
    moments = {chance.randrange(1, 12), chance.randrange(12, 24)}  # of 36 tiles and more
    options = {"region": np.s_[208:304, 208:304], "tile_side": 16, "target_error": 0.08, "progress": False}
    scene, camera = pl.objects_scene(), pl.camera.example_camera()
    expected = pl.render(scene, camera, **options)
    with (
        # A LocalCluster does without a worker that is not back within 15 s, which a busy machine may need.
        dask.config.set({"distributed.deploy.lost-worker-timeout": "600s"}),
        distributed.LocalCluster(n_workers=3, threads_per_worker=1, dashboard_address=":0") as cluster,
        distributed.Client(cluster) as client,
    ):
        client.wait_for_workers(3)

        def killing(self, i, result):
            take(self, i, result)
            if next(results) in moments:
                alive = sorted(set(client.run(os.getpid, on_error="ignore").values()) - set(killed))
                killed.append(chance.choice(alive))
                os.kill(killed[-1], signal.SIGKILL)

        monkeypatch.setattr(Progress, "take", killing)
        shot = pl.render(scene, camera, client=client, **options)
    assert len(killed) == 2
    assert_same(expected, shot)
