"""The files of compiled kernels, each time in processes of their own, with kernels of one line."""

import os
import subprocess
import sys
import time

import pytest

KERNELS = """
from plenoptic.core.numba.jit import device, kernel

@device
def twice(x):
    return 2.0 * x

@kernel
def fill_twice(x, out):
    for i in range(x.size):
        out[i] = twice(x[i])

@kernel
def fill_sum(x, y, out):
    for i in range(x.size):
        out[i] = x[i] + y[i]
"""
USE = """
import warnings
import numpy as np
warnings.simplefilter("error")
from some_kernels import fill_sum, fill_twice
out = np.empty(3)
try:
    fill_twice(np.arange(3.0), out)
except UserWarning as warning:
    print(warning)
    fill_twice(np.arange(3.0), out)
assert out.tolist() == [0.0, 2.0, 4.0], out
fill_sum(out, out, out)
assert out[2] == 8.0
import sys
hits = [sum(one.stats.cache_hits.values()) for one in (fill_twice, fill_sum)]
assert 0 in hits or "numba.np.linalg" not in sys.modules  # which compiling needs, and which takes a quarter of a second
print(hits)
"""


@pytest.fixture
def run(tmp_path):
    """Run USE in a new process; return its output."""
    (tmp_path / "some_kernels.py").write_text(KERNELS)

    def use(code=USE, **variables):
        paths = [str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
        environment = {name: value for name, value in (environment | variables).items() if value is not None}
        process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)
        assert process.returncode == 0, process.stderr
        return process.stdout.strip()

    return use


def files(tmp_path):
    return sorted((tmp_path / "cache" / "plenoptic").iterdir())


def test_compiled_code_is_loaded_until_the_kernel_changes(run, tmp_path):
    assert run() == "[0, 0]"
    assert [path.name.split(".")[1] for path in files(tmp_path)] == ["fill_sum", "fill_twice"]
    assert run() == "[1, 1]"
    (tmp_path / "some_kernels.py").write_text("# moved down\n" + KERNELS.replace("2.0", "(1.0 + 1.0)"))
    assert run() == "[1, 1]"  # the bytecode has 2.0, too
    (tmp_path / "some_kernels.py").write_text(KERNELS.replace("2.0 * x", "x + x"))
    assert run() == "[0, 1]"
    assert len(files(tmp_path)) == 3


@pytest.mark.slow
def test_damaged_files_are_compiled_again(run, tmp_path):
    run()
    for damage in ("flipped bit", "empty", "half", "renamed"):
        one, other = files(tmp_path)
        content = bytearray(one.read_bytes())
        if damage == "flipped bit":
            content[len(content) // 4] ^= 1  # without the digest, this one ended the process
        one.write_bytes({"empty": b"", "half": content[: len(content) // 2]}.get(damage, content))
        if damage == "renamed":
            one.write_bytes(other.read_bytes())
        assert run() == "[1, 0]", damage
        assert run() == "[1, 1]", damage


@pytest.mark.slow
def test_files_that_are_not_used_are_removed(run, tmp_path):
    run()
    month, week = time.time() - 31 * 86400, time.time() - 7 * 86400
    folder = tmp_path / "cache" / "plenoptic"
    for name in ("0123456789abcdef0123", "another-folder-here!x"):  # of an earlier version; of somebody else
        (folder / name).mkdir()
        os.utime(folder / name, (month, month))
    for name in ("old.kernel.0.nbc", "notes.txt"):
        (folder / name).write_text("")
        os.utime(folder / name, (month, month))
    one, other = folder.glob("some_kernels.*")
    os.utime(one, (month, month))
    os.utime(other, (week, week))
    assert run() == "[1, 1]"  # nothing compiled, nothing removed; use is noted
    assert min(path.stat().st_mtime for path in (one, other)) > time.time() - 3600
    (tmp_path / "some_kernels.py").write_text(KERNELS.replace("2.0 * x", "x + x"))
    run()
    left = {path.name for path in files(tmp_path)}
    assert {one.name, other.name, "another-folder-here!x", "notes.txt"} < left and len(left) == 5


def test_where_no_file_can_be_written_kernels_compile_with_one_warning(run, tmp_path):
    (tmp_path / "file").write_text("")  # a path below a regular file: nobody can make a folder there
    warning, hits = run(NUMBA_CACHE_DIR=str(tmp_path / "file" / "cache")).splitlines()
    assert "kernels cannot be kept" in warning and "set NUMBA_CACHE_DIR" in warning and hits == "[0, 0]"
    # No home folder: the user of a container without an entry in the list of users.
    homeless = "import pathlib\ndef home(): raise RuntimeError('no home')\npathlib.Path.home = home\n" + USE
    warning, hits = run(homeless, NUMBA_CACHE_DIR=None, XDG_CACHE_HOME=None, LOCALAPPDATA=None).splitlines()
    assert "there is no home folder" in warning and hits == "[0, 0]"


def test_a_folder_that_cannot_be_written_is_read(run, tmp_path):
    run()
    read_only = "import tempfile\ndef refuse(**_): raise OSError('read-only')\ntempfile.TemporaryFile = refuse\n" + USE
    assert run(read_only) == "[1, 1]"


@pytest.mark.slow
def test_processors_and_numbas_pipelines_have_their_own_code(run):
    # Whoever loads the other's code finds no fused multiplication, or an instruction that the processor lacks.
    kind = USE + "from plenoptic.core.numba.jit import processor\nprint(processor())\n"
    hits, native = run(kind).splitlines()
    other, generic = run(kind, NUMBA_CPU_NAME="generic").splitlines()
    assert hits == other == "[0, 0]" and generic.startswith("generic on " + native.split()[0])
    assert run(PLENOPTIC_PLAIN_NUMBA="1") == "[0, 0]"
    assert run(kind, NUMBA_CPU_NAME="generic") == f"[1, 1]\n{generic}"
    assert run(kind) == f"[1, 1]\n{native}"
