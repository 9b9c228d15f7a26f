"""The code on the how-to pages runs, page by page, with the camera of the first page."""

import base64
import json
import re
import struct
from pathlib import Path

import matplotlib
import pytest

import plenoptic as pl

DOCS = Path(__file__).parents[1] / "docs"
PAGES = sorted((DOCS / "how_to").glob("*.md"))

CORNERS = base64.b64encode(struct.pack("<9f", 0, 0, 0, 0.01, 0, 0, 0, 0.01, 0)).decode()
LIMITS = {"min": [0, 0, 0], "max": [0.01, 0.01, 0]}
SCENE = {
    "asset": {"version": "2.0"},
    "scene": 0,
    "scenes": [{"nodes": [0, 1]}],
    "nodes": [{"mesh": 0}, {"camera": 0, "translation": [0, 0, 0.4]}],
    "cameras": [{"type": "perspective", "perspective": {"yfov": 0.4, "znear": 0.01}}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}],
    "materials": [{"emissiveFactor": [1, 1, 1]}],
    "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"} | LIMITS],
    "bufferViews": [{"buffer": 0, "byteLength": 36}],
    "buffers": [{"byteLength": 36, "uri": f"data:application/octet-stream;base64,{CORNERS}"}],
}


def test_each_page_has_a_title_of_its_own():
    titles = [page.read_text(encoding="utf-8").splitlines()[0] for page in DOCS.rglob("*.md")]
    assert sorted(set(titles)) == sorted(titles)


def blocks(page, kind):
    return re.findall(rf"^```{kind}\n(.*?)^```", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)


def small(code):
    """The same, of a sensor that renders in a second."""
    return code.replace("(512, 512)", "(48, 48)").replace("(256, 256)", "(48, 48)").replace("20:60", "20:24")


@pytest.mark.slow
@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page, "python")], ids=lambda page: page.stem)
def test_the_code_of_a_page_runs(page, tmp_path, monkeypatch):
    if "xarray" in "".join(blocks(page, "python")):
        pytest.importorskip("xarray", reason="the extra `zarr` installs it")
    if "distributed" in "".join(blocks(page, "python")):
        pytest.importorskip("distributed", reason="the extra `cluster` installs it")
    monkeypatch.chdir(tmp_path)
    matplotlib.use("Agg")
    for table in blocks(page, "text"):
        Path("my_lens.csv").write_text(table, encoding="utf-8")
    Path("scene.gltf").write_text(json.dumps(SCENE), encoding="utf-8")
    known = {"pl": pl, "lens": pl.load_lens("double-gauss-100mm-f2")}
    exec(small(blocks(DOCS / "index.md", "python")[0]).split("shot =")[0], known)
    for code in blocks(page, "python"):
        exec(small(code).replace("scene.glb", "scene.gltf"), known)
