"""Light transport where geometry is unkind: tiny, huge, far away, broken, touching, by the thousand."""

import functools
import itertools
import sys
from pathlib import Path

import numpy as np
import pytest

import plenoptic as pl

sys.path.insert(0, str(Path(__file__).parent))
import pinholes  # noqa: E402
from pinholes import flat, pinhole  # noqa: E402

radiance = functools.partial(pinholes.radiance_once, max_bounces=32)

SCALES = [1e-3, 1.0, 1e6]


def turned_about(mesh):
    """Turned so that nothing lies along an axis."""
    return mesh.rotated_deg((1, 0, 0), 33).rotated_deg((0, 1, 0), 21).rotated_deg((0, 0, 1), 74)


BODIES = {
    "box": lambda size, material: pl.box(size, material=material),
    "flat box": lambda size, material: pl.box((size, 0.01 * size, size), material=material),
    "ball": lambda size, material: flat(pl.sphere(0.5 * size, segments=(24, 12), material=material)),
}


def test_convex_bodies_do_not_shadow_themselves():
    # Albedo 1 in a world of radiance 1: exactly 1 where a ray reflected off a convex body never meets it again.
    for size, (shape, body) in itertools.product(SCALES, BODIES.items()):
        for material in (pl.Lambertian(1.0), pl.Conductor()):
            mesh = turned_about(body(size, material)).translated(z=-4 * size)
            rendered = radiance(pl.Scene([mesh], background=1.0), pinhole(opening=1e-6 * size))
            np.testing.assert_allclose(rendered, 1.0, rtol=3e-6, err_msg=f"{shape} {size}")


def test_instances_do_not_shadow_themselves():
    # A body of 1 mm, or of 1e-3 or 1e3 mm, brought to its size and place by its matrix.
    for size, place, scale in itertools.product(SCALES, [(0.0, 0.0, 0.0), (1e5, -2e5, 3e5)], (1e-3, 1.0, 1e3)):
        body = turned_about(pl.box(scale, material=pl.Lambertian(1.0)))
        matrix = np.diag([size / scale, size / scale, size / scale, 1.0])
        matrix[:3, 3] = np.multiply(place, size)
        camera = pinhole(opening=1e-6 * size).posed(matrix[:3, 3] + np.array([0, 0, 4 * size]), matrix[:3, 3])
        rendered = radiance(pl.Scene([pl.scene.Instances(body, matrix[None])], background=1.0), camera)
        np.testing.assert_allclose(rendered, 1.0, rtol=3e-6, err_msg=f"{size} {place} {scale}")


def test_glass_is_entered_and_left_at_all_scales():
    # Nothing is absorbed: 1, but for paths that are cut off after 500 bounces: total reflection keeps rays inside a
    # box for ever in some directions, which none enters. 64 pixels x 256 paths; weights are 1 but for the bookkeeping
    # of radiance (n^2), so that only Russian roulette makes noise: below 1e-2.
    for size, (shape, body) in itertools.product(SCALES, BODIES.items()):
        mesh = turned_about(body(size, pl.Dielectric(1.5))).translated(z=-4 * size)
        rendered = radiance(pl.Scene([mesh], background=1.0), pinhole(opening=1e-6 * size), 256, max_bounces=500)
        assert rendered.mean() == pytest.approx(1.0, abs=1e-2), (shape, size)
        assert np.median(rendered) == pytest.approx(1.0, abs=1e-2), (shape, size)


@pytest.mark.parametrize("size", SCALES)
def test_light_does_not_leak_out_of_closed_boxes_or_past_the_foot_of_a_wall(size):
    room = turned_about(pl.box(size, material=pl.Lambertian(0.9))).translated(z=-4 * size)
    lamp = pl.QuadLight((0, 0, -4 * size), (0.3 * size, 0, 0), (0, 0.3 * size, 0), radiance=1e6, two_sided=True)
    camera = pinhole(opening=1e-6 * size)
    assert not radiance(pl.Scene([room], [lamp]), camera, 256).any()
    # It does shine: one face fewer, and there is light.
    opened = pl.Mesh(room.vertices, room.faces[2:], room.material)
    assert radiance(pl.Scene([opened], [lamp]), camera, 16).any()
    # Two rooms side by side under one lid, a lamp in the left one: the right one is black. Where the lamp touches the
    # wall between them, shadow rays that end 4e-6 of their way before the light can miss the wall: that much leaks, and
    # walls of 0.9 make up to ten times as much of it.
    wall = pl.quad((0, -size, -size), (0, 2 * size, 0), (0, 0, 2 * size), material=pl.Lambertian(0.9))
    both = pl.box((4 * size, 2 * size, 2 * size), material=pl.Lambertian(0.9))
    right = pinhole(0.8, opening=1e-6 * size).posed((1.5 * size, 0.1 * size, 0), (0, -0.9 * size, 0))
    left = right.posed((-1.5 * size, 0.1 * size, 0), (0, -0.9 * size, 0))
    for gap, leak in ((0.0, 4e-5), (1e-3 * size, 0.0)):
        lamp = pl.QuadLight((-size - gap, 0, 0), (2 * size, 0, 0), (0, 0, 2 * size), radiance=1.0, two_sided=True)
        dark, lit = (radiance(pl.Scene([both, wall], [lamp]), camera, 256) for camera in (right, left))
        assert dark.mean() <= leak * lit.mean()
        assert lit.all()


def test_light_does_not_leak_into_closed_bodies():
    sun = pl.SunLight((0.3, -1.0, 0.2), 1e6)
    for size, (shape, body) in itertools.product(SCALES, BODIES.items()):
        mesh = turned_about(body(size, pl.Lambertian(0.9)))
        lamp = pl.lights.PointLight((2 * size, size, 0.0), 1e6 * size**2)
        camera = pinhole(0.5, opening=1e-6 * size).posed((1e-3 * size, 2e-3 * size, 1e-3 * size), (0, -size, -size))
        assert not radiance(pl.Scene([mesh], [sun, lamp], background=1e3), camera, 256).any(), (shape, size)


def test_a_small_body_far_from_the_origin_on_a_huge_floor():
    # 1e-2 mm at 1e6 mm, and a black floor that is 1e6 mm large: the middle of the vertices, from which float32 counts,
    # lies at the detail. All is seen as beside the origin.
    size, place = 1e-2, np.array([1e6, -1e6, 5e5])
    ground = pl.quad((-1e6, 0, 1e6), (2e6, 0, 0), (0, 0, -2e6), material=pl.Lambertian(0.0))
    ground = ground.translated(*(place - np.array([0, 0.5 * size, 0])))
    camera = pinhole(opening=1e-6 * size).posed(place + np.array([0, 0, 4 * size]), place)
    for material in (pl.Lambertian(1.0), pl.Conductor(), pl.Dielectric(1.5)):
        ball = flat(pl.sphere(0.5 * size, segments=(24, 12), material=material)).translated(*place)
        ball_only = radiance(pl.Scene([ball], background=1.0), camera, 256, max_bounces=200)
        # Hit points are known to 1e-10 of 1e6 mm: 1e-4 of the body's size.
        assert ball_only.mean() == pytest.approx(1.0, abs=1e-2), material
        standing = radiance(pl.Scene([ball, ground], background=1.0), camera, 256, max_bounces=200)
        at_origin = pl.Scene([ball.translated(*-place), ground.translated(*-place)], background=1.0)
        near = radiance(at_origin, camera.posed((0, 0, 4 * size), (0, 0, 0)), 256, max_bounces=200)
        assert standing.mean() == pytest.approx(near.mean(), rel=0.02), material
        assert 0.3 < near.mean() < 0.98


@pytest.mark.parametrize("half", [1e3, 1e12])
def test_huge_triangles(half):
    # A plane that fills the lower half of the view, seen at a grazing angle: 1 above and below.
    for material in (pl.Lambertian(1.0), pl.Conductor()):
        ground = pl.quad((-half, -1, half), (2 * half, 0, 0), (0, 0, -2 * half), material=material)
        block = pl.box(0.5, center=(0, -0.75, -10), material=material)
        rendered = radiance(pl.Scene([ground], background=1.0), pinhole())
        np.testing.assert_allclose(rendered, 1.0, rtol=3e-6)
        rendered = radiance(pl.Scene([ground, block], background=1.0), pinhole(), max_bounces=100)
        # Between block and ground light goes to and fro: Russian roulette only. Paths start 0.45 mm off a triangle of
        # 1e12 mm, and as far from its edge: one that meets the ground's diagonal beside the block may start inside it.
        np.testing.assert_allclose(rendered, 1.0, rtol=1e-2 if half < 1e12 else 2.5 / 64)
        assert abs(rendered.mean() - 1.0) < 1e-3


def broken(mesh):
    """The mesh with useless, doubled and turned triangles, each by its name."""
    rng, vertices, faces = np.random.default_rng(9), mesh.vertices, mesh.faces
    i, j = rng.integers(len(vertices), size=(2, 50, 1))
    # Slivers along edges, some 1e-9 to 1e-18 of their length wide.
    near_edge = vertices[faces[:, :2]].mean(axis=1) * (1 + 10.0 ** -rng.uniform(9, 18, size=(len(faces), 1)))
    for defect, broken_mesh in {
        "triangles without area": np.concatenate([faces, *(np.hstack(k) for k in ((i, i, j), (i, j, j), (i, i, i)))]),
        "slivers": np.concatenate([faces, np.column_stack([faces[:, :2], len(vertices) + np.arange(len(faces))])]),
        "faces twice": np.concatenate([faces, faces]),
        "faces twice, both ways": np.concatenate([faces, faces[:, ::-1]]),
        "winding at random": np.where(rng.random((len(faces), 1)) < 0.5, faces, faces[:, ::-1]),
    }.items():
        yield defect, pl.Mesh(np.concatenate([vertices, near_edge]), rng.permutation(broken_mesh), mesh.material)


def test_broken_opaque_meshes_reflect_as_whole_ones():
    for material in (pl.Lambertian(1.0), pl.Conductor(), pl.MetallicRoughness(1.0, 0.0, 0.05)):
        for defect, ball in broken(flat(pl.sphere(6.0, segments=(24, 12), material=material))):
            rendered = radiance(pl.Scene([ball.translated(z=-40)], background=1.0), pinhole(), 128)
            # Plastic's weights vary: 64 x 128 paths, far below 1e-2.
            np.testing.assert_allclose(rendered.mean(), 1.0, rtol=1e-2, err_msg=defect)
            if not isinstance(material, pl.MetallicRoughness):
                np.testing.assert_allclose(rendered, 1.0, rtol=3e-6, err_msg=defect)


def test_nearly_perfect_mirrors_show_what_perfect_ones_do():
    # A light whose mirror image fills columns 5 and 6; blurred by some alpha of 0.05 a pixel.
    lamp = pl.QuadLight((7.5, 0.0, -5.0), (0, 15.0, 0), (7.5, 0, 0), radiance=4.0)
    expected = np.zeros((8, 8))
    expected[2:6, 5:7] = 3.6
    for alpha in (0.0, 1e-5, 2e-4, 1e-3):
        ground = pl.quad((-50, -50, -40), (100, 0, 0), (0, 100, 0), material=pl.Conductor(0.9, alpha=alpha))
        rendered = radiance(pl.Scene([ground], [lamp]), pinhole(), 256)[:, :, 0]
        # GGX has long tails: the share of normals beyond t alpha is 1 / (1 + t^2), so that 2 alpha / 0.05 of the light
        # of a pixel leaves it at each edge, or so.
        assert np.abs(rendered - expected).max() < 3.6 * (1e-3 + 10 * alpha / 0.05), alpha
        assert rendered.sum() == pytest.approx(expected.sum(), rel=1e-3 + 2 * alpha / 0.05), alpha
