"""The cache of compiled kernels, each time in processes of their own, with a kernel of one line."""

import ast
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import plenoptic

KERNEL = """
from plenoptic.core.jit import device, kernel

@device
def twice(x):
    return 2.0 * x

@kernel
def fill_twice(x, out):
    for i in range(x.size):
        out[i] = twice(x[i])
"""
USE = """
import numpy as np
from one_kernel import fill_twice
from plenoptic.core.jit import cache_folder
out = np.empty(3)
fill_twice(np.arange(3.0), out)
assert out.tolist() == [0.0, 2.0, 4.0], out
hits = sum(fill_twice.stats.cache_hits.values()) if getattr(fill_twice, "_cache", None) else 0
print(hits, cache_folder())
"""


@pytest.fixture
def run(tmp_path):
    """Run USE in a new process; returns the number of cache hits and the folder of the cache."""
    (tmp_path / "one_kernel.py").write_text(KERNEL)

    def use(cache, code=USE):
        paths = [str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])]
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": os.pathsep.join(paths)}
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)
        assert done.returncode == 0, done.stderr
        hits, folder = done.stdout.strip().split(" ", 1)
        return int(hits), folder

    return use


def cached_files(folder, ending):
    return [path for path in folder.rglob(f"*{ending}")]


def test_a_second_process_loads_what_the_first_compiled(run, tmp_path):
    cache = tmp_path / "cache"
    hits, folder = run(cache)
    assert hits == 0
    assert folder.startswith(str(cache))
    assert len(cached_files(cache, ".nbi")) == 1
    assert run(cache) == (1, folder)


def test_an_edited_kernel_is_compiled_anew(run, tmp_path):
    cache = tmp_path / "cache"
    run(cache)
    (tmp_path / "one_kernel.py").write_text(KERNEL.replace("2.0", "(1.0 + 1.0)"))
    assert run(cache)[0] == 0


def test_where_no_cache_can_be_written_kernels_still_compile(run, tmp_path):
    # A path below a regular file: nobody, whatever his rights, can make a folder there.
    (tmp_path / "file").write_text("")
    assert run(tmp_path / "file" / "cache") == (0, "None")


PICKLES = (b"", b"\x80\x04", b"\x80\x04cno_such_module\nThing\n.")
DAMAGES = [b"garbage", *(pytest.param(damage, marks=pytest.mark.slow) for damage in PICKLES)]


@pytest.mark.parametrize("ending", [".nbi", ".nbc"])
@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_cache_is_survived_and_repaired(run, tmp_path, ending, damage):
    cache = tmp_path / "cache"
    run(cache)
    for path in cached_files(cache, ending):
        path.write_bytes(damage)
    assert run(cache)[0] == 0
    assert run(cache)[0] == 1


def test_two_processes_never_write_the_same_file(run, tmp_path):
    cache = tmp_path / "cache"
    run(cache)
    (index,) = cached_files(cache, ".nbi")
    index.unlink()  # as a process sees it that began before the first one ended
    run(cache)
    assert len(cached_files(cache, ".nbc")) == 2


def test_kernels_release_the_gil_divide_as_ieee_and_contract():
    from plenoptic.core.jit import kernel

    @kernel
    def ratio(x, y):
        return x / y

    assert ratio.targetoptions["nogil"] is True
    assert ratio.targetoptions["fastmath"] == {"contract"}
    assert ratio(1.0, 0.0) == float("inf")


def test_a_number_that_is_written_in_a_call_makes_no_variant():
    from plenoptic.core.jit import device, kernel

    @device
    def picked(values, i):
        return values[i]

    @kernel
    def fill_sum(values, i):
        values[0] = picked(values, 1) + picked(values, 2) + picked(values, i)

    values = np.array([0.0, 1.0, 2.0])
    fill_sum(values, 2)
    assert values[0] == 5.0
    assert len(picked.signatures) == 1


def test_vectors_are_as_wide_as_registers_where_that_pays():
    from plenoptic.core.jit import device, processor

    @device
    def fill_roots(x):
        for i in range(256):
            x[i] = math.sqrt(x[i])

    fill_roots.compile("(f8[::1],)")
    (code,) = fill_roots.inspect_asm().values()
    assert ("zmm" in code) == ("avx512vbmi2" in processor())


def test_what_kernels_are_compiled_from_is_hashed():
    # A constant of a file that is not hashed would stay in compiled code when it changes.
    root = Path(plenoptic.__file__).parent
    patterns = ("**/kernels/*.py", "**/record.py", "**/registry.py", "core/*.py", "optics/surfaces/*.py")
    hashed = {path for pattern in patterns for path in root.glob(pattern)}
    for path in root.rglob("kernels/*.py"):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ImportFrom) and node.module.startswith("plenoptic.") and path.name != "embree.py":
                source = root.parent.joinpath(*node.module.split("."))
                files = [source.with_suffix(".py"), *(source / f"{alias.name}.py" for alias in node.names)]
                assert hashed.intersection(files), f"{path.name} compiles from {node.module}, which is not hashed"


TWO = (
    KERNEL
    + """
@kernel
def fill_sum(x, y, out):
    for i in range(x.size):
        out[i] = x[i] + y[i]
"""
)
USE_TWO = USE.replace(
    "hits =", "from one_kernel import fill_sum\nfill_sum(out, out, out)\nassert out[2] == 8.0\nhits ="
)


def test_code_of_another_kernel_is_compiled_anew(run, tmp_path):
    # Files that changed places: the arguments of the one do not fit the other.
    cache = tmp_path / "cache"
    (tmp_path / "one_kernel.py").write_text(TWO)
    assert run(cache, USE_TWO)[0] == 0
    one, other = cached_files(cache, ".nbc")
    content = one.read_bytes()
    one.write_bytes(other.read_bytes())
    other.write_bytes(content)
    assert run(cache, USE_TWO)[0] == 0
    assert run(cache, USE_TWO)[0] == 1


def test_a_flipped_bit_in_compiled_code_is_noticed(run, tmp_path):
    cache = tmp_path / "cache"
    run(cache)
    (code,) = cached_files(cache, ".nbc")
    content = bytearray(code.read_bytes())
    content[len(content) // 4] ^= 1  # without the digest, this one ended the process
    code.write_bytes(content)
    assert run(cache)[0] == 0
    assert run(cache)[0] == 1


def test_processors_have_their_own_code_and_say_so(run, tmp_path, monkeypatch):
    # Whoever loads the other's code finds no fused multiplication, or one that his processor has not.
    cache, kind = tmp_path / "cache", USE + "from plenoptic.core.jit import processor\nprint(processor())\n"
    kind = kind.replace("print(hits, cache_folder())\n", "").replace("print(processor())", "print(hits, processor())")
    hits, native = run(cache, kind)
    monkeypatch.setenv("NUMBA_CPU_NAME", "generic")
    other, generic = run(cache, kind)
    assert (hits, other) == (0, 0)
    assert generic.startswith("generic on " + native.split()[0])
    assert run(cache, kind) == (1, generic)
    monkeypatch.delenv("NUMBA_CPU_NAME")
    assert run(cache, kind) == (1, native)
