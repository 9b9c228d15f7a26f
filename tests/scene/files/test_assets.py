"""Well-known meshes: their textures are the right way up, whatever the conventions of their formats."""

import os
from pathlib import Path

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.scene.files.load import load_file

ASSETS = Path(os.environ["PLENOPTIC_SHARED"]) / "assets"


def asset(name):
    path = ASSETS / name
    if not path.exists():
        pytest.skip(f"{name} is not there")
    return path


def test_the_duck_stands_where_the_file_says_and_its_camera_looks_at_it():
    contents = load_file(asset("Duck.glb"), unit="cm")
    # What the file says of its positions, in cm: the node scales by a float32 of 0.01, whose eps is 6e-8.
    low, high = [-69.298500, 9.929370, -61.328197], [96.179901, 163.970001, 53.925198]
    np.testing.assert_allclose(contents.meshes[0].bounds, np.array([low, high]) * 0.1, rtol=2e-7)
    (view,) = contents.views
    np.testing.assert_allclose(view.position, np.array([400.1130, 463.2640, -431.0780]) * 0.1, rtol=1e-6)
    ahead = view.look_at - view.position
    middle = contents.meshes[0].bounds.mean(axis=0) - view.position
    # The middle of the duck lies well inside the picture, 0.66 rad high.
    assert ahead @ middle / np.linalg.norm(ahead) / np.linalg.norm(middle) > np.cos(0.15)


def test_spot_keeps_its_seams_and_the_bunny_is_all_there():
    path = asset("spot_triangulated.obj")
    (mesh,) = pl.load_meshes(path, unit="m", material=pl.Lambertian(pl.Texture.load(asset("spot_texture.png"))))
    assert mesh.uv.min() > -0.1 and mesh.uv.max() < 1.01  # the head's chart ends beyond the image
    words = [line.split() for line in path.read_text().splitlines()]
    v = np.array([w[1:] for w in words if w[:1] == ["v"]], dtype=float) * 1000
    vt = np.array([w[1:] for w in words if w[:1] == ["vt"]], dtype=float)
    corners = np.array([[c.split("/")[:2] for c in w[1:]] for w in words if w[:1] == ["f"]], dtype=int) - 1
    expected = np.concatenate([v[corners[..., 0]], vt[corners[..., 1]]], axis=-1)
    found = np.concatenate([mesh.vertices, mesh.uv], axis=1)[mesh.faces]
    np.testing.assert_allclose(found, expected, rtol=1e-15)
    (bunny,) = pl.load_meshes(asset("stanford-bunny.obj"), unit="m")
    assert len(bunny.faces) == 69451 and bunny.normals is None and bunny.uv is None
    assert bunny.material == pl.Lambertian(0.5)
