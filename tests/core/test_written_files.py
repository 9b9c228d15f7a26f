"""Files that are written: whole or not at all, whatever happens meanwhile, and all by one writer."""

import ast
import itertools
import os
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.core.files import atomic_file, images
from plenoptic.core.files.atomic_file import recover_folder, replace_folder, temporary_folder, write_file

HARNESS = Path(__file__).with_name("kinds_of_saves.py")
FORKS = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
ROOT = Path(pl.__file__).parent
WRITERS = {"write_text", "write_bytes", "tofile", "savetxt", "touch", "mkstemp"}


def run(folder, times, ends):
    """Check that for each end and kind as many saves were met as required."""
    command = [sys.executable, str(HARNESS), str(folder), str(times), ends]
    process = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert process.returncode == 0, process.stderr
    results = [line.split() for line in process.stdout.splitlines()]
    assert len(results) == 2 * len(ends.split(","))
    for ending, kind, n_met, tried in results:
        assert int(n_met) == (times if ending.startswith("SIG") else int(tried)) > 0, (ending, kind)


@FORKS
def test_a_signal_or_no_room_leaves_the_old_file_or_the_new_one(tmp_path):
    run(tmp_path, 1, "SIGKILL,SIGINT,limit")


@FORKS
@pytest.mark.slow
def test_no_end_of_any_save_leaves_anything_else(tmp_path):
    # One writer writes both kinds: of 44 saves that are met, one in 16 that goes wrong is seen in 94 runs of 100.
    run(tmp_path, 22, "SIGKILL,SIGINT,limit")


def test_an_image_that_does_not_come_back_is_not_put_in_place(tmp_path, monkeypatch):
    shot = pl.Exposure(np.random.default_rng(1).random((40, 50, 3)))
    for ending, place in itertools.product((".exr", ".tif", ".png"), (0.1, 0.5, 0.9)):
        path = tmp_path / f"shot{ending}"
        shot.save(path)
        before = path.read_bytes()
        middle = int(place * len(before))

        def damage(file, at=middle):
            file.seek(at)
            file.write(bytes(64))
            file.flush()

        with monkeypatch.context() as patch:
            patch.setattr(images, "check_room", damage)  # stands for a disk that was full for a while
            with pytest.raises(pl.errors.FileError, match="cannot be written: the file does not hold the pixels"):
                shot.save(path)
        assert path.read_bytes() == before and os.listdir(tmp_path) == [path.name], (ending, place)
        path.unlink()


def test_a_file_keeps_its_rights_and_a_protected_one_stays(tmp_path, monkeypatch):
    path, lens = tmp_path / "mine.json", pl.load_lens("singlet-100mm-f4")
    pl.save_lens(lens, path)
    path.chmod(0o640)
    pl.save_lens(lens.with_stop(pl.CircularStop(semi_diameter=2.0)), path)
    assert path.stat().st_mode & 0o777 == 0o640
    before, access = path.read_bytes(), os.access
    monkeypatch.setattr(os, "access", lambda file, mode: Path(file) != path and access(file, mode))
    with pytest.raises(pl.errors.FileError, match=r"mine.json' is write-protected; choose another name"):
        pl.save_lens(lens, path)
    assert path.read_bytes() == before


def test_what_others_left_behind_goes_after_a_day(tmp_path):
    fresh, old = (tmp_path / f".{'0' * 16}-{n:016x}.part" for n in (1, 2))
    for file in (fresh, old):
        file.touch()
    os.utime(old, (time.time() - 90_000,) * 2)
    write_file(tmp_path / "text", b"new")
    assert fresh.exists() and not old.exists()


def test_all_that_is_written_goes_through_one_writer():
    writers = set()
    for path in ROOT.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call):
                name = getattr(node.func, "attr", getattr(node.func, "id", ""))
                texts = [part.value for part in ast.walk(node) if isinstance(part, ast.Constant)]
                modes = {text for text in texts if isinstance(text, str) and set(text) <= set("wxabrt+")}
                if name in WRITERS or (name == "open" and any(set(mode) & set("wxa+") for mode in modes)):
                    writers.add(path.relative_to(ROOT).as_posix())
                if name in ("savefig", "savez", "savez_compressed"):
                    assert isinstance(node.args[0], ast.Name) and node.args[0].id == "file", path
    assert writers == {"core/files/atomic_file.py", "core/files/record_log.py"}  # logs grow in place


@pytest.mark.parametrize("error", [OSError(28, "no room"), KeyboardInterrupt()])
def test_a_folder_that_cannot_be_replaced_stays(tmp_path, monkeypatch, error):
    target, replace = tmp_path / "store", os.replace
    target.mkdir()
    (target / "data").write_text("old", encoding="utf-8")

    def fail_for_new(source, destination):
        if Path(source).suffix == ".part":
            raise error
        replace(source, destination)

    monkeypatch.setattr(os, "replace", fail_for_new)
    monkeypatch.setattr(atomic_file, "_exchange", lambda new, target: False)  # a system that cannot
    with pytest.raises((pl.errors.FileError, KeyboardInterrupt)), replace_folder(target) as folder:
        (folder / "data").write_text("new", encoding="utf-8")
    assert [path.name for path in tmp_path.iterdir()] == ["store"]
    assert (target / "data").read_text(encoding="utf-8") == "old"


KILLED = """
import os, sys
from plenoptic.core.files import atomic_file
replace, target = os.replace, sys.argv[1]
calls = []
def killed(source, destination):
    calls.append(source)
    if len(calls) == int(sys.argv[2]):
        os._exit(9)
    replace(source, destination)
atomic_file._exchange = lambda new, target: False
with atomic_file.replace_folder(target) as folder:
    (folder / "data").write_text("new")
    os.replace = killed
"""


def test_a_folder_whose_writer_was_killed_between_two_names_is_found(tmp_path):
    """Where the system cannot exchange them; while the writer lives, its copy stays where it is."""
    target = tmp_path / "store"
    for step in (1, 2):
        target.mkdir(exist_ok=True)
        (target / "data").write_text("old", encoding="utf-8")
        done = subprocess.run([sys.executable, "-c", KILLED, str(target), str(step)], check=False)
        assert done.returncode == 9 and target.exists() == (step == 1)
        if step == 2:
            (left,) = tmp_path.glob(".*.part")
            with atomic_file.lock_path(left):
                recover_folder(target)
                assert not target.exists()
        recover_folder(target)
        assert (target / "data").read_text(encoding="utf-8") == "old"
    with replace_folder(target) as folder:
        (folder / "data").write_text("new", encoding="utf-8")
    assert [path.name for path in tmp_path.iterdir()] == ["store"]


@pytest.mark.skipif(sys.platform != "linux", reason="renameat2 is a call of Linux")
def test_readers_of_a_folder_that_is_replaced_always_find_it(tmp_path):
    target = tmp_path / "store"
    target.mkdir()
    (target / "data").touch()
    with ThreadPoolExecutor(1) as pool:

        def write():
            for _ in range(50):
                with replace_folder(target) as folder:
                    (folder / "data").touch()

        writer = pool.submit(write)
        while not writer.done():
            assert target.is_dir()
        writer.result()


def test_temporary_folders_of_killed_processes_are_removed(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with temporary_folder() as living:
        dead, young = (tmp_path / f"plenoptic-work-{name}" for name in ("dead", "young"))
        for folder in (dead, young):
            folder.mkdir()
        for folder in (dead, living):
            os.utime(folder, (0, 0))
        with temporary_folder():
            assert living.exists() and young.exists() and not dead.exists()
    assert list(tmp_path.iterdir()) == [young]
