"""Which triangle a ray meets: Embree through its C library beside `EmbreeScene.run`, and beside plain float64."""

import itertools

import numpy as np
import pytest
from scene_helpers import turned

import plenoptic as pl
from plenoptic.scene.geometry.accel import build_intersector
from plenoptic.scene.geometry.build_geometry import geometry_record, middle_of, suits_float32
from plenoptic.scene.geometry.embree_run import SceneRunTriangles
from plenoptic.scene.geometry.geometry_records import INSTANCE_DISTANCE, RAY_OFFSET, Hits
from plenoptic.scene.geometry.instance import Instances, instance_record
from plenoptic.scene.geometry.kernels.embree import EmbreeTriangles
from plenoptic.scene.geometry.kernels.intersect import SHADOW_END

BUILDS = EmbreeTriangles, SceneRunTriangles


def geometry_of(vertices, triangles, instances):
    return geometry_record(vertices, triangles, np.zeros(len(triangles), np.int32), instances=instances), instances


def records_of(plain, groups=()):
    """Geometry and instances: plain meshes first, then each instanced mesh once."""
    meshes, first = list(plain), {}
    for group in groups:
        if group.mesh not in first:
            first[group.mesh] = sum(len(mesh.faces) for mesh in meshes)
            meshes.append(group.mesh)
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    triangles = np.concatenate([mesh.faces + np.int32(start) for mesh, start in zip(meshes, starts[:-1], strict=True)])
    instances = instance_record(groups, [first[group.mesh] for group in groups])
    return geometry_of(np.concatenate([mesh.vertices for mesh in meshes]), triangles, instances)


def corners_of(records, rows, places):
    """(n, 3 corners, 3) in the world."""
    geometry, instances = records
    corners = geometry.vertices[geometry.triangles[rows]]
    if instances is not None:
        matrices = instances.matrices.reshape(-1, 3, 4)[places]
        moved = np.einsum("nij,nkj->nki", matrices[:, :, :3], corners) + matrices[:, None, :, 3]
        corners = np.where((places >= 0)[:, None, None], moved, corners)
    return corners


def all_triangles(records):
    """Row and instance of every triangle in the world."""
    (_, triangles, *_), instances = records
    if instances is None:
        return np.arange(len(triangles)), np.full(len(triangles), -1)
    parts = [(np.arange(instances.plain), np.full(instances.plain, -1))]
    for place, (first, count) in enumerate(zip(instances.first, instances.faces, strict=True)):
        parts.append((np.arange(first, first + count), np.full(count, place)))
    rows, places = zip(*parts, strict=True)
    return np.concatenate(rows), np.concatenate(places)


def met(corners, rays):
    """Distances (n, m) of rays and triangles, and how far inside the edges the planes are met (barycentric)."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    normal = np.cross(b - a, c - a)
    squared = (normal**2).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        height = (a * normal).sum(axis=1) - rays[:, :3] @ normal.T
        t = height / (rays[:, 3:] @ normal.T)
        p = rays[:, None, :3] + t[..., None] * rays[:, None, 3:]
        inside = [
            (np.cross(edge, p - corner) * normal).sum(axis=2) / squared
            for edge, corner in ((b - a, a), (c - b, b), (a - c, c))
        ]
        return t, np.min(inside, axis=0)


def nearest(records, rays):
    """Row, instance and distance of the first hit in float64, and which rays come near no edge on their way."""
    rows, places = all_triangles(records)
    t, inside = met(corners_of(records, rows, places), rays)
    hit = (t > 0) & (inside >= 0)
    distance = np.where(hit, t, np.inf)
    first = distance.argmin(axis=1)
    reached = distance[np.arange(len(rays)), first]
    clear = ~((np.abs(inside) < 1e-4) & (t > 0) & (t <= reached[:, None] * 1.0001)).any(axis=1)
    found = np.isfinite(reached)
    return np.where(found, rows[first], -1), np.where(found, places[first], -1), reached, clear


def ask(intersector, rays):
    hits = Hits(np.full(len(rays), -7, np.int32), np.full(len(rays), -7, np.int32), None)
    intersector.fill_closest(hits, rays)
    return hits.triangle, hits.instance


def random_rays(rng, count, *, reach):
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return np.concatenate([rng.uniform(-reach, reach, (count, 3)), direction], axis=1)


def crowd(rng):
    """Plain boxes between instances of two meshes, mirrored ones among them."""
    ball, box = pl.sphere(3, segments=(8, 4)), pl.box((4, 1, 6), center=(50, 60, 70))
    off = np.eye(4)
    off[:3, 3] = -50, -60, -70  # back to the origin: this mesh lies far from that of its frame
    groups = [
        Instances(ball, turned(rng, 6, reach=12)),
        Instances(box, turned(rng, 5, reach=12) @ off),
        Instances(ball, turned(rng, 4, reach=12, mirrored=True)),
    ]
    return records_of([pl.box(4), pl.box(2, center=(8, 0, 0))], groups)


def assert_found(intersector, rays, rows, places, clear):
    hits, placed = ask(intersector, rays)
    np.testing.assert_array_equal(hits[clear], rows[clear])
    np.testing.assert_array_equal(placed[clear], places[clear])


def test_finds_what_float64_finds_and_is_blocked_where_that_is_before_the_end():
    rng = np.random.default_rng(1)
    box = Instances(pl.box(2), turned(rng, 5, reach=5))
    for records, reach, some in ((crowd(rng), 14, 0.1), (records_of([], [box]), 8, 0.03)):
        rays = random_rays(rng, 2000, reach=reach)
        rays[:, 3:] *= rng.uniform(1, 40, (2000, 1))
        rows, places, reached, clear = nearest(records, rays)
        assert clear.mean() > 0.95 and (places >= 0).mean() > 0.05
        assert records[1].plain == 0 or ((rows >= 0) & (places < 0)).mean() > 0.01
        sure = clear & (np.abs(reached - 1) > 1e-4)  # in units of the direction, which ends a shadow ray
        for build in BUILDS:
            intersector, blocked = build(*records), np.full(2000, 7, np.uint8)
            assert_found(intersector, rays, rows, places, clear)
            intersector.fill_occlusion(blocked, rays)
            assert sure.mean() > 0.9 and some < blocked.mean() < 0.9
            np.testing.assert_array_equal(blocked[sure], reached[sure] < 1)


def test_what_is_not_asked_for_or_not_there():
    rng = np.random.default_rng(2)
    records, rays, bare = crowd(rng), random_rays(rng, 500, reach=20), records_of([pl.box(4)])
    for build in BUILDS:
        with_places, _ = ask(build(*records), rays)
        hits = np.empty(500, np.int32)
        build(*records).fill_closest(Hits(hits, None, None), rays)
        np.testing.assert_array_equal(hits, with_places)
        hits, placed = ask(build(*bare), rays)
        assert set(placed.tolist()) == {-1} and (hits >= 0).any() and bare[0].instance_to_world is None
        assert ask(build(*records), rays[:0])[0].size == 0


@pytest.mark.parametrize("is_copy", [False, True])
def test_rays_along_shared_edges_find_the_same_whatever_goes_beside_them(is_copy):
    # A board of 40 x 40 squares, and rays towards points some 1e-7 of a square beside its edges and diagonals.
    rng = np.random.default_rng(3)
    squares = [pl.quad((x, y, -404.0), (1, 0, 0), (0, 1, 0)) for x in range(-20, 20) for y in range(-20, 20)]
    starts = 4 * np.arange(len(squares))[:, None, None]
    faces = np.stack([square.faces for square in squares]) + starts
    board = pl.Mesh(np.concatenate([square.vertices for square in squares]), faces.reshape(-1, 3))
    records = records_of([], [Instances(board, np.eye(4)[None])]) if is_copy else records_of([board])
    build, count = EmbreeTriangles(*records), 8000
    corners, along = rng.integers(-15, 15, (count, 2)).astype(float), rng.random((count, 1))
    ways = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, -1.0]])[rng.integers(4, size=count)]
    points = corners + along * ways + rng.normal(scale=1e-7, size=(count, 2))
    origins = np.column_stack([rng.normal(scale=0.5, size=(count, 2)), np.zeros(count)])
    directions = np.column_stack([points, np.full(count, -404.0)]) - origins
    lengths = np.linalg.norm(directions, axis=1)[:, None]
    # Directions of rays to the board; rays that end some float32 steps before or behind it.
    whole = np.ascontiguousarray(np.column_stack([origins, directions / lengths]))
    ends = np.ascontiguousarray(np.column_stack([origins, directions * rng.normal(1.0, 1e-7, (count, 1)) / SHADOW_END]))
    order = rng.permutation(count)

    def occlusion(rays):
        blocked = np.full(len(rays), 7, np.uint8)
        build.fill_occlusion(blocked, rays)
        return blocked

    for answer, rays in (lambda rays: ask(build, rays)[0], whole), (occlusion, ends):
        together, mixed = answer(rays), answer(rays[order])
        apart = np.concatenate([answer(rays[k : k + 1]) for k in range(count)])
        assert np.array_equal(together, apart) and np.array_equal(together[order], mixed)
    assert (ask(build, whole)[0] >= 0).all() and 0.1 < together.mean() < 0.9


def test_no_ray_slips_between_triangles():
    # Rays at points of edges of rough ground, up to rounding. Where triangles are as they are, one in 18 is lost.
    first = np.arange(120 * 121).reshape(120, 121)[:, :120].ravel()
    faces = np.concatenate([first[:, None] + [0, 1, 122], first[:, None] + [0, 122, 121]])
    for offset in (0.0, 1e4):
        rng = np.random.default_rng(13)
        x, y = np.meshgrid(*2 * [0.1 * np.arange(-60, 61) + offset])
        points = np.stack([x, y, rng.normal(offset, 0.02, x.shape)], axis=-1).reshape(-1, 3)
        build = build_intersector(pl.Scene([pl.Mesh(points, faces)]).tables().geometry)
        ends, share = points[faces[rng.integers(len(faces), size=50_000)]], rng.random((50_000, 1))
        aims = ends[:, 0] * share + ends[:, 1] * (1 - share)
        aims = aims[np.abs(aims[:, :2] - offset).max(axis=1) < 5.5]
        starts = offset + rng.uniform(-4, 4, aims.shape) * [1, 1, 0] + [0, 0, 5]
        rays = np.concatenate([starts, 1.1 * (aims - starts)], axis=1)
        assert (ask(build, rays)[0] >= 0).all()
        blocked = np.empty(len(rays), np.uint8)
        build.fill_occlusion(blocked, rays)
        assert blocked.all()


def test_tiny_components_of_directions_lose_no_ray():
    # Embree takes the inverse of a component below 1e-18 for that of 1e-18.
    tiny = (1e-45, 1e-38, 1e-30, 1e-20, 0.9e-18, 1.1e-18, 1e-15, 1e-8, 1e-3)
    rng, middle = np.random.default_rng(8), [0.0, 0.0, -600.0]
    ball = pl.shapes.sphere(200.0, center=(7.3, -11.1, 0.0), segments=(256, 128))
    quarter = np.eye(4)  # its cosine is 6e-17, which makes tiny components of exact zeros
    quarter[:2, :2] = [[np.cos(np.pi / 2), -1.0], [1.0, np.cos(np.pi / 2)]]
    plain, repeated = [ball.translated(*middle)], [Instances(ball, [quarter]).translated(*middle)]
    for instanced, records in enumerate([records_of(plain), records_of([], repeated)]):
        intersector = build_intersector(*records)
        for axis, sign in itertools.product((0, 1), (-1, 1)):
            directions = np.tile([0.0, 0.0, -1.0], (len(tiny) * 1000, 1))
            directions[:, axis] = rng.choice([0.0, -0.0, *(sign * np.array(tiny))], len(directions))
            directions[:, 1 - axis] = rng.choice([0.0, 0.01, -0.02], len(directions))
            hits = ask(intersector, np.column_stack([np.zeros_like(directions), directions]))[0]
            assert (hits >= 0).all(), (instanced, axis, sign)


def test_a_scene_far_from_the_origin_loses_nothing():
    rng = np.random.default_rng(9)
    records, rays = crowd(rng), random_rays(rng, 2000, reach=20)
    rows, places, _, clear = nearest(records, rays)
    (vertices, triangles, *_), instances = records
    plain = np.arange(len(vertices))[:, None] < triangles[: instances.plain].max() + 1
    for offset in (1e6, -3e7):
        matrices = instances.matrices.copy()
        matrices[:, 3::4] += offset
        moved = geometry_of(vertices + offset * plain, triangles, instances._replace(matrices=matrices))
        np.testing.assert_allclose(moved[0].middle - offset, middle_of(vertices, triangles, instances), atol=1e-7)
        there = rays + np.array([offset] * 3 + [0] * 3)
        assert_found(build_intersector(*moved), there, rows, places, clear)


def test_a_mesh_with_large_coordinates_of_its_own():
    # Details of 1e-3 mm at 1e6 mm, in the mesh's frame and back at the middle of the world.
    chip = pl.sphere(1e-3, segments=(16, 8)).translated(1e6, -1e6, 1e6)
    back = np.eye(4)
    back[:3, 3] = -1e6, 1e6, -1e6
    records = records_of([pl.box(1e-3, center=(5e-3, 0, 0))], [Instances(chip, [back])])
    rays = random_rays(np.random.default_rng(10), 4000, reach=2e-3)
    rows, places, _, clear = nearest(records, rays)
    assert (places == 0).mean() > 0.1
    assert_found(build_intersector(*records), rays, rows, places, clear)


def test_matrices_that_float32_cannot_invert():
    turn, shear = np.eye(4), np.eye(4)
    shear[0, 1] = 50
    turn[:3, :3] = np.linalg.qr(np.random.default_rng(11).normal(size=(3, 3)))[0]
    for radius, matrix, suits in (
        (1.0, np.diag([1e-2, 1, 1e2, 1]), True),  # scaled along the axes
        (1e13, np.diag([1e-13, 1e-13, 1e-13, 1]), False),
        (1e-13, np.diag([1e13, 1e13, 1e13, 1]), False),
        (1.0, shear, False),
    ):
        matrix = turn @ matrix
        assert suits_float32(matrix[None, :3, :3]).tolist() == [suits]
        records = records_of([], [Instances(pl.sphere(radius, segments=(8, 4)), [matrix])])
        # Towards the middle of each triangle, from without; thinnest parts are 1e-4 of the whole.
        rows, places = all_triangles(records)
        middle = corners_of(records, rows, places).mean(axis=1)
        rays = np.concatenate([1.5 * middle, -middle], axis=1)
        assert_found(build_intersector(*records), rays, rows, places, slice(None))


def test_huge_degenerate_and_double_triangles_give_answers():
    point, line = pl.quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), [[0, 0, 1], [1, 1, 1], [0, 1, 0]]
    poor = pl.Mesh(point.vertices, np.vstack([line, point.faces, point.faces]))
    vast = pl.quad((-5e14, -5e14, -500), (1e15, 0, 0), (0, 1e15, 0))
    place, up = np.eye(4), np.eye(4)
    place[:3, 3], up[2, 3] = (1e6, 0, 1), 1
    records = records_of([poor, vast], [Instances(poor, [place, place]), Instances(vast, [up])])
    x = np.array([0.3, 1e6 + 0.3])
    rays = np.array([[u, 0.2, z, 0, 0, d] for u in x for z in (3.0, 0.5, -400.0) for d in (-1.0, 1.0)])
    for build in BUILDS:
        hits, placed = ask(build(*records), rays)
        kinds = np.where(hits < 0, -1, placed >= 0)  # 0: a plain triangle, 1: one of an instance, -1: none
        assert kinds.tolist() == [0, -1, 0, -1, 1, 0, 1, -1, 1, 1, 1, 1]
        found = hits >= 0
        reached = met(corners_of(records, hits[found], placed[found]), rays[found])[0].diagonal()
        # Of sums of coordinates of 1e15 that cancel, float64 leaves units of 0.1.
        np.testing.assert_allclose(reached, [3, 0.5, 99, 400, 2, 499.5, 0.5, 99, 401], rtol=0, atol=1)
        assert not {0, 1, 2, 9, 10, 11} & set(hits.tolist())  # those without area


def test_rays_that_start_clear_of_a_triangle_do_not_meet_it_again():
    rng, n = np.random.default_rng(12), 50000
    corners = rng.normal(size=(2000, 1, 3)) * 500 + rng.normal(size=(2000, 3, 3)) * 20
    soup = pl.Mesh(corners.reshape(-1, 3), np.arange(6000).reshape(-1, 3))
    for plain in ([], [pl.sphere(1, center=(700, 100, 0))]):
        records = records_of(plain, [Instances(soup, turned(rng, 3, reach=800))])
        intersector = build_intersector(*records)
        place = rng.integers(0, 3, n)
        row = records[1].first[place] + rng.integers(0, 2000, n)
        corners = corners_of(records, row, place)
        point = (corners * rng.dirichlet((1, 1, 1), n)[:, :, None]).sum(axis=1)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        # To the side of the normal, from right off the surface down to along it.
        along = np.cross(normal, rng.normal(size=(n, 3)))
        rise = rng.random((n, 1)) ** 4
        direction = along / np.linalg.norm(along, axis=1, keepdims=True) + rise * normal
        relative = np.abs(point - records[0].middle).sum(axis=1)
        size = np.abs(corners - records[0].middle) + np.abs(corners - point[:, None])
        least = records[0].instance_to_world[place, INSTANCE_DISTANCE]
        reach = np.max([relative, size.sum(axis=2).max(axis=1), least], axis=0)
        # Twice as near is still near enough; 32 times is not: the test can fail.
        for share, some in ((1, 0), (0.5, 0), (1 / 32, n // 100)):
            rays = np.concatenate([point + normal * (share * RAY_OFFSET * reach)[:, None], direction], axis=1)
            hits, placed = ask(intersector, rays)
            again = ((hits == row) & (placed == place)).sum()
            assert again == 0 if not some else again > some
