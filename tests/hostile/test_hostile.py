"""No file reads what lies outside of its folder, hangs, fills memory, or raises what is no error of the package."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from corpus import CASES, chosen
from hostile_gltf import TRIANGLE, header
from hostile_images import png

import plenoptic as pl
from plenoptic.scene.files.gltf.nodes import compose_matrices

MOST_SECONDS = 5.0
"""s of CPU for one file; what the system takes to hand out memory is bounded by the next one."""
MOST_MEMORY = 1 << 30
"""Bytes beside those of the libraries."""


def run(script, *arguments):
    """What a script of this folder prints at its end, in a process of its own."""
    command = [sys.executable, str(Path(__file__).with_name(script)), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, env={**os.environ, "LC_ALL": "C.UTF-8"})
    assert done.returncode == 0, done.stderr[-3000:]
    return json.loads(done.stdout.splitlines()[-1])


# What is damaged is read in some two of ten cases; of 28 x 10 that share has a standard deviation of 0.027.
@pytest.mark.parametrize("count", [10, pytest.param(40, marks=pytest.mark.slow)])
def test_damaged_files_are_read_or_refused(tmp_path, count):
    found = run("mutations.py", tmp_path, count, count)
    assert found["wrong"] == []
    assert found["of"] >= 28 * count and 0.1 * found["of"] < found["read"] < 0.5 * found["of"]
    assert found["memory"] < MOST_MEMORY


@pytest.mark.parametrize("each", [11, pytest.param(1, marks=pytest.mark.slow)])
def test_hostile_files(tmp_path, each):
    report = run("corpus.py", tmp_path, each)
    assert list(report["cases"]) == chosen(each) and len(chosen(1)) == len(CASES) >= 170
    for name, found in report["cases"].items():
        said, error = CASES[name][1], found["error"]
        if said is None:
            assert error is None, name
        else:
            assert re.search(said, error or "nothing"), (name, error)
        assert not (error or "").startswith("FOREIGN"), (name, error)
        assert found["strays"] == [] and found["seconds"] < MOST_SECONDS, name
    assert report["peak"] - report["start"] < MOST_MEMORY


def test_limits_can_be_raised(tmp_path):
    folder, limits = tmp_path / "files", pl.images.FileLimits
    folder.mkdir()
    (tmp_path / "secret.bin").write_bytes(TRIANGLE)
    for name, loads in (("../secret.bin", True), (str(tmp_path / "secret.bin"), True), ("/dev/null", False)):
        described = header()
        described["buffers"].append({"uri": name, "byteLength": 36})
        (folder / "a.gltf").write_text(json.dumps(described))
        with pytest.raises(pl.errors.FileError, match=r"lies outside of .*FileLimits\(folder"):
            pl.load_meshes(folder / "a.gltf")
        if loads:
            assert len(pl.load_meshes(folder / "a.gltf", limits=limits(folder=tmp_path))) == 1
            assert pl.Scene.load(folder / "a.gltf", limits=limits(folder="/")).meshes
        else:
            with pytest.raises(pl.errors.FileError, match="is no file"):
                pl.load_meshes(folder / "a.gltf", limits=limits(folder="/"))
    (tmp_path / "a.png").write_bytes(png(64, 64))
    assert pl.Texture.load(tmp_path / "a.png", limits=limits(memory=64 * 64 * 24)).texels.shape == (64, 64, 3)
    with pytest.raises(pl.errors.FileError, match=r"would take 98304 bytes.*give limits=.*memory=98304"):
        pl.Texture.load(tmp_path / "a.png", limits=limits(memory=64 * 64 * 24 - 1))
    size = (tmp_path / "a.png").stat().st_size
    with pytest.raises(pl.errors.FileError, match=f"has {size} bytes; the limit is {size - 1}: raise it"):
        pl.images.read_linear(tmp_path / "a.png", limits=limits(file_size=size - 1))
    with pytest.raises(pl.errors.InvalidValueError, match="memory is 0; it must be at least 1"):
        limits(memory=0)


def test_nodes_stand_where_each_alone_would():
    random = np.random.default_rng(3)
    parts = [random.normal(size=(100, count)) for count in (3, 4, 3)]
    alone = [compose_matrices(*(part[k : k + 1] for part in parts))[0] for k in range(100)]
    np.testing.assert_array_equal(compose_matrices(*parts), alone)
