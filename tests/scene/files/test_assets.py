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


def texels_at(texture, uv):
    """The nearest texels, (n, 3): row 0 is at v = 1, and the image repeats."""
    rows, columns = texture.texels.shape[:2]
    place = np.floor(np.mod(uv, 1.0) * (columns, rows)).astype(int)
    return texture.texels[rows - 1 - np.clip(place[:, 1], 0, rows - 1), np.clip(place[:, 0], 0, columns - 1)]


def painted(mesh, texture, count=60000):
    """Points evenly over the surface, as shares of the bounds, and their colours."""
    random = np.random.default_rng(1)
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    triangle = random.choice(len(area), count, p=area / area.sum())
    weights = random.dirichlet((1, 1, 1), count)[..., None]
    points = (weights * mesh.vertices[mesh.faces[triangle]]).sum(axis=1)
    low, high = mesh.bounds
    return (points - low) / (high - low), texels_at(texture, (weights * mesh.uv[mesh.faces[triangle]]).sum(axis=1))


def test_the_duck_has_eyes_in_its_head_and_an_orange_beak_in_front():
    contents = load_file(asset("Duck.glb"))
    (mesh,) = contents.meshes
    assert len(mesh.faces) == 4212 and mesh.normals is not None
    material = mesh.material
    assert material == pl.MetallicRoughness(material.base, 0.0, 1.0) and material.base.texels.shape == (512, 512, 3)
    points, colours = painted(mesh, material.base)
    beak = points[(colours[:, 0] > 0.9) & (colours[:, 1] < 0.3) & (colours[:, 2] < 0.1)]
    pupils = points[colours.max(axis=1) < 0.02]
    glints = points[colours.min(axis=1) > 0.95]
    assert min(len(beak), len(pupils), len(glints)) > 20
    # The beak is what reaches farthest to +x, in the upper half.
    assert beak[:, 0].min() > 0.75 and beak[:, 0].max() > 0.98 and beak[:, 1].min() > 0.5
    middle = beak[:, 2].mean()
    # One eye on each side, behind the beak and above its middle; most of its white lies above the pupil.
    for side in (-1, 1):
        eye, white = (part[side * (part[:, 2] - middle) > 0] for part in (pupils, glints))
        assert len(eye) > 10 and np.abs(eye[:, 2] - middle).min() > 0.05
        assert eye[:, 0].min() > 0.5 and eye[:, 0].max() < beak[:, 0].max()
        assert eye[:, 1].mean() > beak[:, 1].mean() and white[:, 1].mean() > eye[:, 1].mean()


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
