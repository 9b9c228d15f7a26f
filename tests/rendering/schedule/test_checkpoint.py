"""Checkpoints: every bit comes back, what is not whole or not ours is refused, and a file is never half written."""

import hashlib
import json
import os
import pickle
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays_of
from PIL import Image

import plenoptic as pl
from plenoptic.rendering.schedule.checkpoint import load_checkpoint, save_checkpoint

OURS = {"seed": "2", "scene": "sha256:abc"}
PREAMBLE = len("plenoptic checkpoint 1\n") + 64 + 1 + 16 + 1
TYPES = ["?", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "f2", "f4", "f8", "c8", "c16"]


def same_bits(one, other):
    return one.dtype == other.dtype and one.shape == other.shape and one.tobytes() == other.tobytes()


def parts_beside(path):
    return sorted(p.name for p in Path(path).parent.iterdir() if p.name.endswith(".part"))


@pytest.fixture
def state(tmp_path):
    """A small checkpoint."""
    path = tmp_path / "state"
    save_checkpoint(path, OURS, {"sums": np.arange(6.0).reshape(2, 3), "counts": np.arange(3)}, {"samples": 4})
    return path


# ---- what is saved comes back ----


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(arrays_of.arrays(st.sampled_from(TYPES), arrays_of.array_shapes(min_dims=0, min_side=0)), max_size=4))
def test_arrays_come_back_bit_by_bit(tmp_path, given_arrays):
    path, named = tmp_path / "state", {f"array {i}": a for i, a in enumerate(given_arrays)}
    save_checkpoint(path, OURS, named, {})
    found, facts = load_checkpoint(path, OURS)
    assert list(found) == list(named) and facts == {}
    assert all(same_bits(found[name], array) and found[name].flags.writeable for name, array in named.items())


def test_every_nan_and_zero_keeps_its_bits(tmp_path):
    # Quiet and signalling nans with payloads, infinities, zeros of both signs, subnormals.
    bits = np.array([0x7FF8000000000123, 0xFFF0000000000001, 0x7FF << 52, 0xFFF << 52, 1 << 63, 0, 1], dtype=np.uint64)
    save_checkpoint(tmp_path / "state", OURS, {"odd": bits.view(np.float64)}, {})
    np.testing.assert_array_equal(load_checkpoint(tmp_path / "state", OURS)[0]["odd"].view(np.uint64), bits)


@pytest.mark.parametrize("make", [lambda a: a.astype(">f8"), lambda a: a.T, lambda a: a[:, ::-2], np.asfortranarray])
def test_how_numbers_lie_in_memory_does_not_matter(tmp_path, make):
    array = make(np.random.default_rng(1).normal(size=(5, 7)))
    save_checkpoint(tmp_path / "state", OURS, {"a": array}, {})
    assert same_bits(load_checkpoint(tmp_path / "state", OURS)[0]["a"], np.ascontiguousarray(array, dtype=float))


def test_facts_come_back(tmp_path):
    facts = {"n": 1 << 70, "x": 0.1, "far": np.inf, "text": 'é"\n\ud800', "lost": [["vignetted", None, 3]], "on": True}
    save_checkpoint(tmp_path / "state", OURS, {}, facts)
    assert load_checkpoint(tmp_path / "state", OURS) == ({}, facts)
    numbers = {"n": np.int64(3), "x": np.float32(0.5), "on": np.bool_(True), "pair": (1, 2)}
    save_checkpoint(tmp_path / "state", OURS, {}, numbers)
    assert load_checkpoint(tmp_path / "state", OURS)[1] == {"n": 3, "x": 0.5, "on": True, "pair": [1, 2]}


@pytest.mark.parametrize("array", [np.array([None]), np.array(["a"]), np.array([1.0], dtype=np.longdouble)])
def test_arrays_of_other_kinds_are_refused(tmp_path, array):
    if array.dtype == np.float64:
        pytest.skip("long doubles are doubles here")
    with pytest.raises(pl.errors.InvalidValueError, match="booleans and numbers only"):
        save_checkpoint(tmp_path / "state", OURS, {"a": array}, {})
    assert not os.listdir(tmp_path)


def test_facts_of_other_kinds_are_refused(tmp_path):
    with pytest.raises(TypeError):
        save_checkpoint(tmp_path / "state", OURS, {}, {"camera": object()})
    assert not os.listdir(tmp_path)


def test_a_file_is_text_that_says_what_it_is_before_its_numbers(state):
    first, second, header, _ = state.read_bytes().split(b"\n", 3)
    assert first == b"plenoptic checkpoint 1"
    assert second == b"%s %016d" % (hashlib.sha256(header + b"\n").hexdigest().encode(), len(header) + 1)
    assert json.loads(header)["identity"] == OURS


def test_a_link_stays_a_link(tmp_path, state):
    link = tmp_path / "link"
    link.symlink_to(state)
    save_checkpoint(link, OURS, {}, {"samples": 5})
    assert link.is_symlink() and load_checkpoint(state, OURS) == load_checkpoint(link, OURS) == ({}, {"samples": 5})


# ---- what is damaged or foreign is refused ----


def refused(path, content, *, save=True):
    """Whether `content` is refused, by loading always and by saving unless `save` is false; and stays as it is."""
    path.unlink(missing_ok=True)  # to write over a file may wait for the disk
    path.write_bytes(content)
    with pytest.raises(pl.errors.FileError) as loading:
        load_checkpoint(path, OURS)
    if save:
        with pytest.raises(pl.errors.FileError):
            save_checkpoint(path, OURS, {}, {})
    assert path.read_bytes() == content and not parts_beside(path)
    return str(loading.value)


def test_every_shorter_file_is_refused(state):
    whole = state.read_bytes()
    for length in range(len(whole)):
        refused(state, whole[:length])
    assert "cut off" in refused(state, whole[:200]) and "damaged" in refused(state, whole[:-1])
    assert "empty file" in refused(state, b"")


def test_every_longer_file_is_refused(state):
    whole = state.read_bytes()
    assert f"{len(whole) + 1} bytes and should have {len(whole)}" in refused(state, whole + b"\0")


def test_every_flipped_bit_is_refused(state):
    whole = state.read_bytes()
    end_of_header = PREAMBLE + int(whole[PREAMBLE - 17 : PREAMBLE - 1])
    for place in range(len(whole)):
        for bit in range(8):
            changed = bytearray(whole)
            changed[place] ^= 1 << bit
            # Saving looks at the header only; a render has loaded the file before.
            refused(state, bytes(changed), save=bit == place % 8 and place < end_of_header)


@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.binary(max_size=300), start=st.sampled_from([0, 23, PREAMBLE]))
def test_any_bytes_are_refused(state, content, start):
    refused(state.with_name("any"), state.read_bytes()[:start] + content)


FOREIGN = {
    "text": lambda path: path.write_text("plenoptic checkpoints are elsewhere\n" * 9),
    "json": lambda path: path.write_text(json.dumps({"identity": OURS})),
    "png": lambda path: Image.new("L", (9, 9)).save(path, format="png"),
    "pickle": lambda path: path.write_bytes(pickle.dumps(OURS)),
    "npz": lambda path: path.write_bytes(npz_bytes()),
}


def npz_bytes():
    import io

    stream = io.BytesIO()
    np.savez(stream, sums=np.arange(6.0))
    return stream.getvalue()


@pytest.mark.parametrize("kind", FOREIGN)
def test_foreign_files_are_refused(tmp_path, kind):
    path = tmp_path / "mine"
    FOREIGN[kind](path)
    message = refused(path, path.read_bytes())
    assert re.search(r"mine' is not a checkpoint; give checkpoint= another path, or remove the file$", message)


def test_what_is_no_file_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "file").touch()
    for path, message in (
        (tmp_path, "is a folder; give the path of a file"),
        (tmp_path / "pipe", "is no file"),
        (tmp_path / "file" / "state", "cannot be read .Not a directory"),
        (tmp_path / "none" / "state", "does not exist; make it first"),
        (tmp_path / ("n" * 300), "cannot be read .File name too long"),
        (tmp_path / "zero\0byte", "null byte"),
        (7, "is not a path"),
    ):
        for action in (load_checkpoint, lambda path, ours: save_checkpoint(path, ours, {}, {})):
            with pytest.raises(pl.errors.FileError, match=message):
                action(path, OURS)
    assert sorted(os.listdir(tmp_path)) == ["file", "pipe"]


def test_longest_names_can_be_saved(tmp_path):
    path = tmp_path / ("n" * 255)
    save_checkpoint(path, OURS, {}, {})
    assert load_checkpoint(path, OURS) == ({}, {})


def test_none_where_there_is_no_file_yet(tmp_path):
    assert load_checkpoint(tmp_path / "state", OURS) is None
    assert not os.listdir(tmp_path)


def with_header(header):
    """A file whose header is as it should be by its digest, whatever it says."""
    text = json.dumps(header).encode() if not isinstance(header, bytes) else header
    return b"plenoptic checkpoint 1\n%s %016d\n%s" % (hashlib.sha256(text).hexdigest().encode(), len(text), text)


EMPTY = hashlib.sha256().hexdigest()


@pytest.mark.parametrize(
    "array",
    [
        {"name": "a", "dtype": "<f8", "shape": [1 << 45]},
        {"name": "a", "dtype": "<f8", "shape": [1 << 61, 1 << 61]},
        {"name": "a", "dtype": "<f8", "shape": [0, 1 << 61, 1 << 61]},
        {"name": "a", "dtype": "<f8", "shape": [10**400]},
        {"name": "a", "dtype": "<f8", "shape": [-1, -1]},
        {"name": "a", "dtype": "<f8", "shape": [0] * 100},
        {"name": "a", "dtype": "<f8", "shape": [False]},
        {"name": "a", "dtype": "<f8", "shape": 3},
        {"name": "a", "dtype": "|O", "shape": [0]},
        {"name": "a", "dtype": [["f", "|O"]], "shape": [0]},
        {"name": "a", "shape": [0]},
        None,
    ],
)
def test_headers_that_lie_are_refused_before_any_memory_is_taken(tmp_path, array):
    # 2^45 numbers would be 280 TB: numpy could not allocate them, and its MemoryError is no FileError.
    header = {"identity": OURS, "facts": {}, "arrays": [array], "sha256": EMPTY}
    refused(tmp_path / "lies", with_header(header), save=False)


@pytest.mark.parametrize("header", [[], {}, 7, None, b"[" * 100_000, b'{"identity": ', b"\xff\xfe", b"9" * 5000])
def test_headers_that_are_none_are_refused(tmp_path, header):
    assert "header" in refused(tmp_path / "state", with_header(header))


def test_a_header_longer_than_the_file_is_refused_unread(state):
    whole = state.read_bytes()
    assert "cut off" in refused(state, whole[: PREAMBLE - 17] + b"9" * 16 + b"\n" + whole[PREAMBLE:])


def test_other_versions_of_the_format_are_named(state):
    message = refused(state, state.read_bytes().replace(b"checkpoint 1\n", b"checkpoint 12\n", 1))
    assert "version 12 of the format, not 1" in message


def test_checkpoints_of_another_rendering_are_refused_and_told_apart(state):
    content = state.read_bytes()
    for theirs, words in (
        ({"seed": "1", "scene": "sha256:abc"}, "with seed 2, not 1; give"),
        ({"seed": "1", "scene": "sha256:ab"}, "with seed 2, not 1, another scene; give"),
        ({"seed": "2", "scene": "None"}, "with another scene; give"),
        ({"seed": "2", "scene": "sha256:abc", "clamp": "3.0"}, "with no clamp; give"),
        ({"scene": "sha256:abc"}, "with seed 2; give"),
    ):
        for action in (load_checkpoint, lambda path, ours: save_checkpoint(path, ours, {}, {})):
            with pytest.raises(
                pl.errors.FileError, match=f"belongs to another render, {words} checkpoint= another path"
            ):
                action(state, theirs)
    assert state.read_bytes() == content and os.listdir(state.parent) == ["state"]
