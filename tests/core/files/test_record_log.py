"""Logs: every bit comes back, and damage loses no other record."""

import errno
import hashlib
import itertools
import json
import multiprocessing
import os
import pickle
import struct
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays_of

import plenoptic as pl
from plenoptic.core.files import record_log
from plenoptic.core.files.record_log import LogKind, RecordLog, begin_log, log_exists

KIND = LogKind("diary", 2, "give another path")
PREAMBLE = len(KIND.first_line) + 64 + 1 + 16 + 1
MARK = b"\x93plenoptic rec\r\n"
NONE = [b"[]", b"7", b"[" * 100_000, b'{"owner": ', b"\xff\xfe", b"9" * 5000]
"""What is no description."""
TYPES = ["?", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "f2", "f4", "f8", "c8", "c16"]


@contextmanager
def opened(path, kind=KIND):
    log = RecordLog(path, kind)
    try:
        yield log
    finally:
        log.close()


def same_bits(one, other):
    return one.dtype == other.dtype and one.shape == other.shape and one.tobytes() == other.tobytes()


def numbers_in(path):
    """Facts of records, with the arrays that `read` returns, and the number of bytes that belong to none."""
    with opened(path) as log:
        records = {}
        for entry in log.entries:
            arrays = log.read(entry)
            records[entry.facts["n"]] = None if arrays is None else arrays["a"].tolist()
        return records, log.damaged


def record(n):
    return {"n": n}, {"a": np.full(4 + n, n)}


WHOLE = {n: [n] * (4 + n) for n in range(3)}


@pytest.fixture
def path(tmp_path):
    """A log of three records."""
    begin_log(tmp_path / "log", KIND, {"owner": "me"})
    with opened(tmp_path / "log") as log:
        for n in range(3):
            log.append(*record(n))
    return tmp_path / "log"


@pytest.fixture
def ends(path):
    """End of the header and of each record."""
    with opened(path) as log:
        starts = path.read_bytes().index(MARK)
        return [starts, *(entry.position + entry.length for entry in log.entries)]


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(arrays_of.arrays(st.sampled_from(TYPES), arrays_of.array_shapes(min_dims=0, min_side=0)), max_size=4))
def test_arrays_come_back_bit_by_bit(tmp_path, given_arrays):
    path, arrays = tmp_path / "log", {f"array {i}": a for i, a in enumerate(given_arrays)}
    path.unlink(missing_ok=True)
    begin_log(path, KIND, {})
    with opened(path) as log:
        written = log.append({}, arrays)
        assert log.entries == []  # those that were there
    with opened(path) as log:
        assert log.entries == [written] and log.damaged == 0 and written.names == list(arrays)
        read = log.read(log.entries[0])
    assert list(read) == list(arrays)
    assert all(same_bits(read[name], array) and read[name].flags.writeable for name, array in arrays.items())


def test_how_numbers_lie_in_memory_does_not_matter(path):
    array = np.random.default_rng(1).normal(size=(5, 7))
    with opened(path) as log:
        for one in (array.astype(">f8"), array.T, array[:, ::-2], np.asfortranarray(array)):
            read = log.read(log.append({}, {"a": one}))["a"]
            assert same_bits(read, np.ascontiguousarray(one, dtype=float)), one.strides


def test_header_and_facts_come_back(tmp_path):
    facts = {"n": 1 << 70, "x": 0.1, "far": np.inf, "text": 'é"\n\ud800', "lost": [["vignetted", None, 3]], "on": True}
    begin_log(tmp_path / "log", KIND, facts)
    with opened(tmp_path / "log") as log:
        assert log.header == facts
        log.append(facts, {})
        log.append({"n": np.int64(3), "x": np.float32(0.5), "on": np.bool_(True), "pair": (1, 2)}, {})
    with opened(tmp_path / "log") as log:
        assert [entry.facts for entry in log.entries] == [facts, {"n": 3, "x": 0.5, "on": True, "pair": [1, 2]}]


def test_what_is_no_fact_is_refused(path):
    content = path.read_bytes()
    with opened(path) as log, pytest.raises(TypeError):
        log.append({"camera": object()}, {})
    assert path.read_bytes() == content


def test_files_cut_off_at_any_byte_lose_that_record_only_and_grow_again(path, ends):
    content = path.read_bytes()
    for length in range(ends[0], len(content)):
        path.write_bytes(content[:length])
        whole = sum(end <= length for end in ends) - 1
        assert numbers_in(path) == ({n: WHOLE[n] for n in range(whole)}, length - ends[whole])
        # The body that is missing is not taken from what is written after it.
        with opened(path) as log:
            for n in (7, 8):
                log.append(*record(n))
        after = {n: [n] * (4 + n) for n in (7, 8)}
        assert numbers_in(path)[0] == {n: WHOLE[n] for n in range(whole)} | after, length


def test_flipped_bits_lose_their_record_only(path, ends):
    content = path.read_bytes()
    for place in range(ends[0], len(content)):
        changed = bytearray(content)
        changed[place] ^= 1 << place % 8
        path.write_bytes(changed)
        hit = sum(end <= place for end in ends) - 1
        records, damaged = numbers_in(path)
        # Bodies are looked at when they are read.
        in_body = ends[hit + 1] - place <= 8 * len(WHOLE[hit])
        assert records == {**WHOLE, hit: None} if in_body else records == {n: WHOLE[n] for n in WHOLE if n != hit}
        assert damaged == (0 if in_body else ends[hit + 1] - ends[hit])


@settings(max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(garbage=st.lists(st.binary(max_size=40) | st.just(MARK) | st.just(MARK[:9]), min_size=4, max_size=4))
def test_garbage_between_records_is_passed_over(path, ends, garbage):
    content, damaged = path.read_bytes(), path.with_name("damaged")
    parts = [content[: ends[0]], *(content[begin:end] for begin, end in itertools.pairwise(ends))]
    damaged.write_bytes(b"".join(part + more for part, more in zip(parts, garbage, strict=True)))
    assert numbers_in(damaged) == (WHOLE, sum(map(len, garbage)))


def framed(head, length, body=b""):
    """A record whose head is as it should be by its digest, whatever it says."""
    digest = hashlib.blake2b(body, digest_size=16).digest()
    sizes = struct.pack("<IQ", len(head), length)
    return MARK + sizes + hashlib.blake2b(sizes + digest + head, digest_size=16).digest() + digest + head + body


def test_heads_that_lie_or_are_none_are_passed_over_before_any_memory_is_taken(path):
    content = path.read_bytes()
    for array in (
        ["a", "<f8", [1 << 45]],  # would be 280 TB: numpy could not allocate them
        ["a", "<f8", [1 << 61, 1 << 61]],
        ["a", "<f8", [10**400]],
        ["a", "<f8", [-1, -1]],
        ["a", "<f8", [False]],
        ["a", "<f8", 3],
        ["a", "|O", [0]],
        ["a", [["f", "|O"]], [0]],
        ["a", "<f8"],
        None,
    ):
        head = json.dumps({"facts": {"n": 9}, "arrays": [array]}).encode()
        lies = framed(head, 0) + framed(head, 8 << 45)
        path.write_bytes(content + lies)
        assert numbers_in(path) == (WHOLE, len(lies)), array
    for head in NONE:
        path.write_bytes(content + framed(head, 0))
        assert numbers_in(path)[0] == WHOLE, head
    head = json.dumps({"facts": {}, "arrays": [["a", "<f8", [0, 1 << 61, 1 << 61]]]}).encode()
    path.write_bytes(content + framed(head, 0))
    with opened(path) as log, pytest.raises(pl.errors.FileError, match="cannot be read"):
        log.read(log.entries[-1])


def refused(path, content):
    """Message of the error when `content` is opened; the file must not change."""
    path.write_bytes(content)
    with pytest.raises(pl.errors.FileError) as caught:
        RecordLog(path, KIND)
    assert path.read_bytes() == content
    return str(caught.value)


def test_every_damage_to_the_header_is_refused(path, ends):
    content = path.read_bytes()
    for length in range(1, ends[0]):
        assert ("damaged diary" in refused(path, content[:length])) == (length >= len(KIND.first_line))
    assert "is an empty file; give another path" in refused(path, b"")
    for place in range(ends[0]):
        changed = bytearray(content)
        changed[place] ^= 1 << place % 8
        refused(path, bytes(changed))
    assert "cut off" in refused(path, content[: PREAMBLE - 17] + b"9" * 16 + b"\n" + content[PREAMBLE:])
    assert "remove it to begin anew" in refused(path, content[: PREAMBLE + 3])
    for header in NONE:
        start = KIND.first_line + b"%s %016d\n" % (hashlib.sha256(header).hexdigest().encode(), len(header))
        assert "its header cannot be understood" in refused(path, start + header), header


def test_other_kinds_and_versions_are_told_apart(path):
    content = path.read_bytes()
    for number in (1, 12):
        other = content.replace(b"diary 2\n", b"diary %d\n" % number, 1)
        assert f"has version {number} of the format, not 2, of another plenoptic; give" in refused(path, other)
    for foreign in (b"plenoptic diaries are elsewhere\n" * 9, pickle.dumps(KIND), content.replace(b"diary", b"novel")):
        assert "log' is not a diary; give another path" in refused(path, foreign)


def test_what_is_no_file_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "file").touch()
    for path, message in (
        (tmp_path, "is a folder; give the path of a file"),
        (tmp_path / "pipe", "is no file"),
        (tmp_path / "file" / "log", "cannot be read .Not a directory"),
        (tmp_path / "none" / "log", "does not exist; make it first"),
        (tmp_path / ("n" * 300), "cannot be read .File name too long"),
        (tmp_path / "zero\0byte", "null byte"),
        (7, "is not a path"),
    ):
        for action in (log_exists, lambda path: begin_log(path, KIND, {}), lambda path: RecordLog(path, KIND)):
            with pytest.raises(pl.errors.FileError, match=message):
                action(path)
    assert sorted(os.listdir(tmp_path)) == ["file", "pipe"]


def test_a_log_is_begun_once_and_under_the_longest_name(tmp_path):
    path = tmp_path / ("n" * 255)
    assert not log_exists(path) and not os.listdir(tmp_path)
    with pytest.raises(pl.errors.FileError, match="has been removed just now"):
        RecordLog(path, KIND)
    begin_log(path, KIND, {})
    assert log_exists(path)
    with pytest.raises(pl.errors.FileError, match="has been made by another program just now; try again"):
        begin_log(path, KIND, {"other": 1})
    with opened(path) as log:
        assert log.header == {} and log.entries == []


def full(monkeypatch, room):
    """The disk has room for so many bytes more; the function returned makes it large again."""
    write_all = record_log._write_all

    def limited(file, part):
        nonlocal room
        write_all(file, memoryview(part)[:room])
        room -= len(part)
        if room < 0:
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(record_log, "_write_all", limited)
    return lambda: monkeypatch.setattr(record_log, "_write_all", write_all)


def test_a_write_that_fails_leaves_the_file_as_it_was(path, monkeypatch):
    content = path.read_bytes()
    for room in (0, 20, 60, 400):
        path.write_bytes(content)
        with opened(path) as log:
            again = full(monkeypatch, room)
            with pytest.raises(pl.errors.FileError, match=r"No space left on device.; check .* space"):
                log.append({"n": 9}, {"a": np.zeros(900)})
            assert path.read_bytes() == content, room
            again()
            log.append(*record(6))
        assert numbers_in(path) == ({**WHOLE, 6: [6] * 10}, 0), room


def test_a_file_that_has_been_replaced_or_removed_gets_nothing_more(path):
    other = path.with_name("other")
    begin_log(other, KIND, {})
    content = other.read_bytes()
    with opened(path) as log:
        os.replace(other, path)
        with pytest.raises(pl.errors.FileError, match="has been replaced just now"):
            log.append(*record(6))
        assert path.read_bytes() == content
        path.unlink()
        with pytest.raises(pl.errors.FileError, match="has been removed just now"):
            log.append(*record(6))


def append_many(path, first):
    with opened(path) as log:
        for n in range(first, first + 20):
            log.append(*record(n))


def test_two_processes_lose_nothing(path, monkeypatch):
    pytest.importorskip("fcntl")
    write_all = record_log._write_all

    def slow(file, part):
        time.sleep(0.001)  # without locks the other process writes into this record
        write_all(file, part)

    monkeypatch.setattr(record_log, "_write_all", slow)
    other = multiprocessing.get_context("fork").Process(target=append_many, args=(path, 100))
    other.start()
    append_many(path, 200)
    other.join()
    assert other.exitcode == 0
    records, damaged = numbers_in(path)
    assert records == {n: [n] * (4 + n) for n in (*range(3), *range(100, 120), *range(200, 220))} and damaged == 0


def test_threads_write_and_read_one_log(path):
    with opened(path) as log, ThreadPoolExecutor(2) as pool:
        read = list(pool.map(lambda n: log.read(log.append(*record(n)))["a"].tolist(), range(100, 180)))
    assert read == [[n] * (4 + n) for n in range(100, 180)] and len(numbers_in(path)[0]) == 83


def test_file_systems_without_locks_will_do(path, monkeypatch):
    fcntl = pytest.importorskip("fcntl")

    def without(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", without)
    with opened(path) as log:
        log.append(*record(5))
    assert numbers_in(path)[0] == {**WHOLE, 5: [5] * 9}
