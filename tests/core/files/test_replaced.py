"""Files are replaced as a whole, or not at all, whatever happens meanwhile."""

import errno
import hashlib
import itertools
import os
from concurrent.futures import ThreadPoolExecutor

import pytest

import plenoptic as pl
from plenoptic.core.files.atomic_file import _temporary, write_file


@pytest.fixture
def state(tmp_path):
    """A small file."""
    path = tmp_path / "state"
    write_file(path, b"old")
    return path


def fails(monkeypatch, name, error):
    def failing(*_):
        raise error

    monkeypatch.setattr(os, name, failing)


def test_a_save_that_fails_changes_nothing(state, monkeypatch):
    full, text = OSError(errno.ENOSPC, "No space left on device"), r"cannot be written .No space left on device.; check"
    for name, path in itertools.product(("fsync", "replace"), (state, state.with_name("new"))):
        for error, said, match in ((full, pl.errors.FileError, text), (KeyboardInterrupt(), KeyboardInterrupt, None)):
            with monkeypatch.context() as patch:
                fails(patch, name, error)
                with pytest.raises(said, match=match):
                    write_file(path, b"new")
            assert state.read_bytes() == b"old" and os.listdir(state.parent) == ["state"], (name, path, error)


def test_folders_that_cannot_be_flushed(state, monkeypatch):
    # Some file systems cannot: then the file is as safe as can be. A failing disk is an error.
    fsync, calls = os.fsync, []

    def for_files(descriptor):
        calls.append(descriptor)
        if len(calls) % 2 == 0:
            raise OSError(code, os.strerror(code))
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", for_files)
    code = errno.EINVAL
    write_file(state, b"new")
    assert len(calls) == 2 and state.read_bytes() == b"new"
    code = errno.EIO
    with pytest.raises(pl.errors.FileError, match="error"):
        write_file(state, b"newer")
    assert len(calls) == 4 and state.read_bytes() == b"newer"


def test_it_is_flushed_before_it_is_renamed(state, monkeypatch):
    calls, fsync, replace = [], os.fsync, os.replace
    monkeypatch.setattr(os, "fsync", lambda descriptor: (calls.append("fsync"), fsync(descriptor)))
    monkeypatch.setattr(os, "replace", lambda one, other: (calls.append("replace"), replace(one, other)))
    write_file(state, b"new")
    assert calls == ["fsync", "replace", "fsync"]


def test_left_over_files_go_and_those_that_are_being_written_stay(state):
    with _temporary(state) as (living, _):
        dead = living.with_name(living.name[:-10] + "00000.part")  # another one of the same target
        stale = [living.with_name(f".{'0' * 16}-{'0' * 16}.part"), state.with_name("mine.part")]
        for path in (dead, *stale):
            path.touch()
        write_file(state, b"new")
        assert living.exists() and not dead.exists() and all(path.exists() for path in stale)
    assert not living.exists()


def test_a_temporary_file_that_is_taken_for_left_behind_is_made_again(state, monkeypatch):
    # Between its creation and its lock, another process may remove it.
    import fcntl

    flock, removed = fcntl.flock, []

    def late(file, how):
        if not removed:
            removed.append(file.name)
            os.unlink(file.name)
        flock(file, how)

    monkeypatch.setattr(fcntl, "flock", late)
    write_file(state, b"new")
    assert removed and state.read_bytes() == b"new" and os.listdir(state.parent) == ["state"]


def test_file_systems_without_locks_will_do(state, monkeypatch):
    import fcntl

    def without(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", without)
    left = state.with_name(f".{hashlib.sha256(b'state').hexdigest()[:16]}-{'0' * 16}.part")
    left.touch()
    write_file(state, b"new")
    # Without locks nobody knows whether it lives.
    assert state.read_bytes() == b"new" and left.exists()


def test_two_writers_and_a_reader_always_see_whole_files(state):
    write_file(state, bytes(40_000))

    def written(first):
        for n in range(first, 40, 2):
            write_file(state, bytes([n]) * 40_000)

    with ThreadPoolExecutor(2) as pool:
        writers = [pool.submit(written, first) for first in (0, 1)]
        while not all(writer.done() for writer in writers):
            content = state.read_bytes()
            assert content == content[:1] * 40_000
        assert [writer.result() for writer in writers] == [None, None]
    assert state.read_bytes()[0] in (38, 39) and os.listdir(state.parent) == ["state"]
