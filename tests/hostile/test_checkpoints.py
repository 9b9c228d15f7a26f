"""Checkpoints of right digests and wrong records: what these held is rendered again, or the file is refused."""

import math

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.core.files.record_log import RecordLog, begin_log
from plenoptic.rendering.schedule import budget as budgets
from plenoptic.rendering.schedule import tile_jobs
from plenoptic.rendering.schedule.checkpoint import KIND

CAMERA = pl.camera.example_camera()
SCENE = pl.Scene([pl.quad((-9, -9, -404), (18, 0, 0), (0, 18, 0), material=pl.Emissive(1.0))], background=0.5)
BITS = ("image", "standard_error", "depth")
COUNTS = ("paths", "paths_through_lens", "nonfinite", "lost", "clamped")
JUNK = (None, True, "a", {}, -1, 0.5, [], [1, 2], [[1]], [-1, 0, 1, 2], 1 << 62, 10**400, -0.5, math.nan, math.inf)


@pytest.fixture(scope="module")
def render():
    """Nine tiles, in two passes."""

    def rendered(**given):
        region = np.s_[240:264, 240:264]
        return pl.render(SCENE, CAMERA, samples=48, region=region, tile_side=8, threads=1, progress=False, **given)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(budgets, "_PASSES", 48)
        yield rendered


@pytest.fixture(scope="module")
def whole(render, tmp_path_factory):
    """An exposure, the header of its checkpoint, and the records: facts and arrays."""
    path = tmp_path_factory.mktemp("checkpoint") / "whole"
    shot = render(checkpoint=path)
    log = RecordLog(path, KIND)
    records = [(entry.facts, log.read(entry)) for entry in log.entries]
    log.close()
    assert [facts["first"] for facts, _ in records] == 9 * [0] + 9 * [2]
    return shot, log.header, records


def write(path, header, records):
    path.unlink(missing_ok=True)
    begin_log(path, KIND, header)
    log = RecordLog(path, KIND)
    for facts, arrays in records:
        log.append(facts, arrays)
    log.close()


def harmless(name, fact):
    """What might be true of a render, though it is not of this one."""
    if name in ("light", "clamped", "seconds", "cpu_seconds"):
        return fact == 0.5
    return fact == {"processor": "a", "lost_paths": []}.get(name, "nothing is")


def wrong_facts(facts):
    """A record's facts, each with one fault."""
    for name in facts:
        yield {other: fact for other, fact in facts.items() if other != name}
        yield from ({**facts, name: fact} for fact in JUNK if not harmless(name, fact))
    yield {}
    yield {**facts, "nonfinite": facts["paths"] + 1}
    yield {**facts, "clamped": 2.0, "light": 1.0}


def wrong_arrays(arrays):
    """A record's arrays, each time with one fault."""
    for name, array in arrays.items():
        yield {other: kept for other, kept in arrays.items() if other != name}
        for changed in (array[:0], array[1:], array[..., None], array.ravel()[:1], array.astype(complex)):
            yield {**arrays, name: changed}
    yield {}
    yield {**arrays, "truth.nothing": arrays["counts"]}
    for name, value in (("sums", math.nan), ("sums", -math.inf), ("counts", -1), ("counts", 1 << 60)):
        yield {**arrays, name: np.where(np.arange(arrays[name].size).reshape(arrays[name].shape), arrays[name], value)}


# 13, 7 and the number of wrong values of a fact have no common divisor: the sample has each kind of fault.
@pytest.mark.parametrize("each", [13, pytest.param(7, marks=pytest.mark.slow)])
def test_records_that_are_none_are_rendered_again(render, whole, tmp_path, monkeypatch, each):
    shot, header, records = whole
    rendered, original = [], tile_jobs.render_tile

    def watched(context, tile, *others, **named):
        if tile.pixels:
            rendered.append((tile, others[0].first))
        return original(context, tile, *others, **named)

    monkeypatch.setattr(tile_jobs, "render_tile", watched)
    faults = [
        (k, fault)
        for k in (4, 13)  # of the first pass, with truth, and of the second
        for fault in (
            *((facts, records[k][1]) for facts in wrong_facts(records[k][0])),
            *((records[k][0], arrays) for arrays in wrong_arrays(records[k][1])),
        )
    ]
    assert len(faults) > 400
    path = tmp_path / "state"
    for k, fault in faults[::each]:
        write(path, header, [*records[:k], fault, *records[k + 1 :]])
        rendered.clear()
        with pytest.warns(pl.errors.FileWarning, match="damaged, and their tiles are rendered again"):
            again = render(checkpoint=path)
        assert rendered == [(tuple(records[k][0]["tile"]), records[k][0]["first"])], fault[0]
        for name in BITS:
            assert getattr(again, name).tobytes() == getattr(shot, name).tobytes(), (name, fault[0])
        for name in COUNTS:
            assert getattr(again.stats, name) == getattr(shot.stats, name), (name, fault[0])


def test_a_header_without_a_side_of_tiles_or_with_another_identity_is_refused(render, whole, tmp_path):
    sides = (None, 0, -8, 8.0, True, "8", [8])
    others = (None, [], "a", 3, {}, {"seed": None}, {"seed": [1]}, {"scene": {}})
    for name, values, said in (
        ("tile_side", sides, "is a damaged checkpoint: its tile_side is .*; give checkpoint="),
        ("identity", others, "belongs to another render, with "),
    ):
        for value in values:
            write(tmp_path / "state", {**whole[1], name: value}, [])
            with pytest.raises(pl.errors.FileError, match=said):
                render(checkpoint=tmp_path / "state")
