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


SIDES = {
    # Where a point of the picture lies on a face: x to the right and y up as seen from outside, within -1/2 and 1/2.
    "back": lambda x, y: (-x, y, -0.5),
    "left": lambda x, y: (-0.5, y, x),
    "front": lambda x, y: (x, y, 0.5),
    "right": lambda x, y: (0.5, y, -x),
}


@pytest.mark.parametrize("side", SIDES)
def test_the_logo_stands_upright_on_all_sides_of_the_box(side):
    (mesh,) = load_file(asset("BoxTextured.glb"), unit="mm").meshes
    np.testing.assert_allclose(mesh.bounds, [[-0.5] * 3, [0.5] * 3])

    def colour(x, y):
        point = np.array(SIDES[side](x, y))
        a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
        # Barycentric coordinates in each triangle, and how far the point is from its plane.
        across = np.linalg.solve(np.stack([b - a, c - a, np.cross(b - a, c - a)], axis=2), (point - a)[..., None])
        s, t, height = across[..., 0].T
        (inside,) = np.nonzero((np.abs(height) < 1e-6) & (s >= 0) & (t >= 0) & (s + t <= 1))
        k = inside[0]
        uv = mesh.uv[mesh.faces[k]]
        return texels_at(mesh.material.base, (uv[0] + s[k] * (uv[1] - uv[0]) + t[k] * (uv[2] - uv[0]))[None])[0]

    red, green, blue = colour(0.0, 0.40)  # sky above
    assert blue > 0.5 > red
    red, green, blue = colour(0.0, -0.40)  # meadows below
    assert green > 0.1 > blue
    # A white sun, on the right above; the file itself, by its texture coordinates, mirrors two sides.
    sun, sky = (colour(x, 0.217) for x in ((0.154, -0.154) if side in ("back", "left") else (-0.154, 0.154)))
    assert sun.min() > 0.95 and sky[0] < 0.2


def test_spot_has_horns_above_hooves_below_and_a_face_in_front():
    texture = pl.Texture.load(asset("spot_texture.png"))
    (mesh,) = pl.load_meshes(asset("spot_triangulated.obj"), material=pl.Lambertian(texture))
    points, colours = painted(mesh, texture)
    red, green, blue = colours.T
    brown = points[(red > 0.25) & (red < 0.45) & (green < 0.15) & (blue < 0.08)]
    horns, nostrils = brown[brown[:, 1] > 0.7], brown[brown[:, 1] <= 0.7]
    muzzle = points[(red > 0.95) & (green > 0.45) & (green < 0.65) & (blue > 0.3) & (blue < 0.45)]
    muzzle = muzzle[muzzle[:, 1] > 0.5]  # the udder has the same colour
    hooves = points[(red > 0.1) & (red < 0.2) & (np.ptp(colours, axis=1) < 0.01)]
    eyes = points[(red < 0.002) & (green < 0.002)]
    assert min(len(horns), len(muzzle), len(hooves), len(eyes)) > 20
    assert len(horns) > 5 * len(nostrils) and horns[:, 1].min() > 0.8
    assert np.quantile(hooves[:, 1], 0.98) < 0.2  # the rims of the glints in the eyes are grey too
    assert (nostrils >= muzzle.min(axis=0)).all() and (nostrils <= muzzle.max(axis=0)).all()
    assert muzzle[:, 1].min() > 0.45 and muzzle[:, 1].max() < eyes[:, 1].mean() < horns[:, 1].min()
    # The face looks towards -z; both eyes are as far from the middle.
    assert muzzle[:, 2].max() < 0.3 and eyes[:, 2].max() < 0.3
    left, right = (np.mean(eyes[side * (eyes[:, 0] - 0.5) > 0, 0]) for side in (-1, 1))
    assert left + right == pytest.approx(1, abs=0.02)


def test_spot_keeps_its_seams():
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


def test_the_bunny_is_all_there():
    (mesh,) = pl.load_meshes(asset("stanford-bunny.obj"), unit="m")
    assert len(mesh.faces) == 69451 and mesh.normals is None and mesh.uv is None
    assert mesh.material == pl.Lambertian(0.5)
