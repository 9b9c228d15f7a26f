"""Normal maps: which way a surface seems to face, found by how it is shaded."""

import dataclasses
import math

import numpy as np
import pytest
from scene_helpers import FACES, UV

import plenoptic as pl
from plenoptic.truth.channels import Truth

# Variants of kernels that nothing else needs: half a minute of compiling.
pytestmark = pytest.mark.slow

CORNERS = np.array([[-1.0, -1, 0], [1, -1, 0], [-1, 1, 0], [1, 1, 0]])
UP = np.array([0.0, 0.0, 1.0])


def unit(v):
    v = np.asarray(v, dtype=float)
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


LEAN = unit([0.25, 0.5, 0.75])
SUNS = unit([[0.3, 0.1, 1.0], [-0.3, 0.3, 1.0], [0.0, -0.4, 1.0]])
"""Directions to three suns: three radiances tell a normal."""
VIEW = unit([0.1, -0.2, 1.0])
PLASTIC = pl.MetallicRoughness(0.7, 0.3, 0.5)


def mapped(n=LEAN, uv=UV, normals=None, material=PLASTIC):
    """A square around the origin that faces +z, with a map of one texel that says n."""
    texels = (np.asarray(n, dtype=np.float32) + 1)[None, None] / 2
    return pl.Mesh(CORNERS, FACES, dataclasses.replace(material, normal_map=pl.Texture(texels)), uv=uv, normals=normals)


def camera_from(view, target=(0.0, 0.0, 0.0), half=1e-6):
    """A camera with a tiny opening that sees a point of the scene, and next to nothing around it."""
    target = np.asarray(target)
    camera = pl.PlenopticCamera(pl.no_lens(1e-5), pl.Sensor((1, 1), pixel_pitch=20.0 * half), stop_to_microlenses=10.0)
    return camera.posed(target + 10 * np.asarray(view), target, up=(0.3, 1.0, 0.2))


def radiances(meshes, view=VIEW, target=(1e-3, 2e-3, 0.0), suns=SUNS):
    """(3,) radiance under each of the suns."""
    camera = camera_from(view, target)
    options = {"samples": 4, "replicates": 1, "progress": False}
    sky = pl.render(pl.Scene(background=1.0), camera, truth=Truth.NONE, **options).image[0, 0, 0]
    found = []
    for sun in suns:
        scene = pl.Scene(meshes, [pl.SunLight(-sun, 3.0, angular_radius=0.0)])
        shot = pl.render(scene, camera, truth=Truth.NONE, max_bounces=1, **options)
        found.append(float(shot.image[0, 0, 0]) / float(sky))
    return np.array(found)


def shaded(normal, view=VIEW, suns=SUNS, material=PLASTIC):
    """(3,) radiance f cos E of a surface that faces along `normal`."""
    x = unit(np.cross(normal, [0.3, 0.9, 0.1]))
    frame = np.array([x, np.cross(normal, x), normal])
    return np.array([3.0 * pl.bsdf.evaluate(material, frame @ view, frame @ sun).value[0, 0] for sun in suns])


def assert_faces(meshes, normal, **more):
    """Directions within the view differ by 2e-6; float32 keeps maps to 6e-8 and images too: some 1e-5 of radiance."""
    np.testing.assert_allclose(radiances(meshes, **more), shaded(unit(normal), more.get("view", VIEW)), rtol=3e-5)


def test_radiances_tell_normals():
    # The tests below can fail: a degree away, or with the sign of a component turned, at least one is another.
    for other in (LEAN + np.array([0.02, 0, 0]), LEAN * (-1, 1, 1), LEAN * (1, -1, 1), LEAN[[1, 0, 2]], UP):
        assert np.abs(shaded(unit(other)) / shaded(LEAN) - 1).max() > 5e-3


def test_red_goes_along_u_green_up_and_blue_outwards():
    # u grows along +x and v along +y, so the texture's frame is the world's. What is shorter than 1 is stretched.
    for n in ([0.5, 0, 1], [0, 0.5, 1], [-0.5, 0.25, 1], 0.5 * LEAN):
        assert_faces([mapped(n)], n)
    # A flat map changes nothing. 1/2, 1/2, 1 are exact in float32, so the normal turns by rounding alone.
    flat = pl.Mesh(CORNERS, FACES, PLASTIC)
    np.testing.assert_allclose(radiances([mapped([0, 0, 1])]), radiances([flat]), rtol=1e-6)
    # Two texels, one above the other, the upper one of which leans towards +y: rows count downwards.
    texels = (np.array([unit([0, 1, 2]), unit([0, -1, 2])])[:, None] + 1) / 2
    bumps = pl.Texture(texels, filter=pl.materials.TextureFilter.NEAREST)
    mesh = pl.Mesh(CORNERS, FACES, dataclasses.replace(PLASTIC, normal_map=bumps), uv=UV)
    assert_faces([mesh], [0, 1, 2], target=(0.3, 0.5, 0))
    assert_faces([mesh], [0, -1, 2], target=(0.3, -0.5, 0))
    # As a leaning plane does.
    axis = np.cross(UP, LEAN)
    leaning = pl.Mesh(CORNERS, FACES, PLASTIC).rotated(axis, math.asin(np.linalg.norm(axis)))
    np.testing.assert_allclose(radiances([mapped()]), radiances([leaning], target=(0, 0, 0)), rtol=3e-5)


def test_the_frame_is_that_of_the_texture_wherever_it_lies():
    # Mirrored textures turn neither the front nor what is up in the picture.
    for uv, frame in (
        (UV * (7, 0.01) + (3, -2), [[1, 0, 0], [0, 1, 0]]),  # stretched
        (UV[:, ::-1], [[0, 1, 0], [1, 0, 0]]),  # transposed
        (UV * (-1, 1), [[-1, 0, 0], [0, 1, 0]]),  # mirrored
        (UV * (1, -1), [[1, 0, 0], [0, -1, 0]]),
        (UV @ [[0.6, -0.8], [0.8, 0.6]], [[0.6, 0.8, 0], [-0.8, 0.6, 0]]),  # turned
    ):
        normal = LEAN @ np.array([*frame, UP])
        for target in ((-0.5, -0.4, 0), (0.5, 0.4, 0)):  # both triangles
            assert_faces([mapped(uv=uv)], normal, target=target)


def test_a_bump_is_a_dent_from_behind():
    # Whatever is seen and lit from the front, reflected in the plane of the surface: the front's normal, turned over.
    below, suns = VIEW * (1, 1, -1), SUNS * (1, 1, -1)
    for side in (1, -1):
        found = radiances([mapped(uv=UV * (side, 1))], view=below, suns=suns)
        np.testing.assert_allclose(found, shaded(-LEAN * (side, 1, 1), below, suns), rtol=3e-5)


def test_where_the_bent_normal_faces_away_or_the_texture_has_no_area_the_surface_stays_as_it_is():
    steep, low = unit([1, 0, 0.2]), unit([-1, 0.2, 0.1])
    assert low @ steep < 0
    assert_faces([mapped(steep)], UP, view=low)
    for uv in (UV * (0, 1), UV * 0, UV[:, :1] @ [[1, 1]]):
        assert_faces([mapped(uv=uv)], UP)


def test_maps_bend_smooth_normals():
    # Vertex normals that lean along +x: blue goes along them, red along the part of u across them.
    smooth = unit([-0.3, 0.0, 0.8])
    along = unit([0.8, 0.0, 0.3])
    mesh = mapped(normals=np.tile(smooth, (4, 1)))
    assert_faces([mesh], LEAN @ np.array([along, [0, 1, 0], smooth]))
    plain = pl.Mesh(CORNERS, FACES, mesh.material, uv=UV)
    assert_faces([mesh, plain.translated(x=5)], LEAN, target=(5, 0, 0))


def test_instances_bend_as_copies_do():
    # Turned, stretched along the axes and mirrored; fronts towards +z.
    rng = np.random.default_rng(5)
    turn = np.linalg.qr(rng.normal(size=(40, 3, 3)))[0]
    turn[:, :, 2] *= np.sign(turn[:, 2, 2])[:, None]
    turn = turn[turn[:, 2, 2] > 0.85][:4]
    matrices = np.tile(np.eye(4), (4, 1, 1))
    turn[:, :, 0] *= np.sign(np.linalg.det(turn))[:, None] * ((1,), (-1,), (1,), (-1,))
    matrices[:, :3, :3] = turn * rng.uniform(0.5, 2, (4, 1, 3))
    matrices[:, 0, 3] = 10.0 * np.arange(4)
    assert (np.linalg.det(matrices) < 0).tolist() == [False, True, False, True]
    group = pl.scene.Instances(mapped([0.1, 0.3, 1.0]), matrices)
    for k, copy in enumerate(group.meshes()):
        options = {"view": UP, "target": matrices[k, :3, 3]}
        np.testing.assert_allclose(radiances([group], **options), radiances([copy], **options), rtol=3e-5)


def test_bumpy_white_plastic_makes_no_light():
    # Light that a bent normal would send into the surface is lost, and none is made: at most 1, and not much less
    # where normals lean by up to 27 degrees.
    rng = np.random.default_rng(8)
    bumps = unit(np.concatenate([rng.uniform(-0.35, 0.35, (8, 8, 2)), np.ones((8, 8, 1))], axis=2))
    material = pl.MetallicRoughness(1.0, 0.0, 0.6, normal_map=pl.Texture((bumps + 1) / 2))
    plate = pl.Mesh(CORNERS, FACES, material, uv=UV)
    camera = camera_from(VIEW, half=0.02)
    options = {"samples": 4096, "replicates": 1, "progress": False}
    sky = pl.render(pl.Scene(background=1.0), camera, **options)
    shot = pl.render(pl.Scene([plate], background=1.0), camera, truth=Truth.NONE, max_bounces=1, **options)
    # Paths bring 0 to some 2: 4096 of them 1 %.
    assert 0.9 < shot.image[0, 0, 0] / sky.image[0, 0, 0] < 1.02
