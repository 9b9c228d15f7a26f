"""Scenes of up to five million triangles, and of many more by instances: seconds and memory to build, rays a second."""

import numpy as np
from table import Table
from timing import apart, memory, timed

import plenoptic as pl
from plenoptic.scene.geometry.accel import build_intersector
from plenoptic.scene.geometry.build_geometry import geometry_record
from plenoptic.scene.geometry.geometry_records import Hits
from plenoptic.scene.geometry.instance import Instances

# Triangles are some 2 x side^2 for terrain, 5000 a ball for the others.
FULL = (
    *(("terrain", 158), ("terrain", 500), ("terrain", 1582)),
    *(("balls, copied", 1000), ("balls, instances", 1000), ("balls, instances", 100_000)),
)
SMALL = (("terrain", 20), ("balls, copied", 3), ("balls, instances", 3))
BUNDLE = 4096


def tables(*, quick):
    scenes, rays = (SMALL, 64) if quick else (FULL, 512)
    rows = [(name, *apart(measured, name, size, rays)) for name, size in scenes]
    remark = (
        "MB are what the process holds more afterwards. Tables: `Scene.tables()`; Embree: float32 copies and the "
        "tree. First rays come from one point, those of neighbouring pixels together; random ones go on from where "
        "these end, in all directions above the surface; shadow rays go from there to a lamp of 40 x 40 mm. One "
        f"thread, bundles of {BUNDLE}, the best of 5."
    )
    columns = "scene | triangles | stored | tables: s | MB | Embree: wall s | CPU s | MB | peak MB | "
    columns += "million rays a CPU-second: first | random | shadow"
    yield Table("Large scenes, each in a process of its own", columns, rows, [remark])


def measured(name, size, side):
    """Triangles met and stored, costs of tables and Embree scene, peak memory, rays a second of the three kinds."""
    triangle = geometry_record(np.eye(3), np.arange(3, dtype=np.int32)[None], np.zeros(1, np.int32))
    build_intersector(triangle)  # loads the library
    scene = terrain(size) if name == "terrain" else balls(size, copied="copied" in name)
    held = [memory()]
    tables, compiled = timed(scene.tables)
    held.append(memory())
    tree, intersector = timed(build_intersector, compiled.geometry, compiled.instances)
    held.append(memory())
    more, most = np.diff(held) / 2**20, memory("VmHWM") / 2**20
    spent = [tables.wall, float(more[0]), *tree, float(more[1]), most]
    stored = len(compiled.geometry.triangles)
    met = stored if compiled.instances is None else compiled.instances.plain + int(compiled.instances.faces.sum())
    first = from_a_point(side)
    random, shadow = onwards(intersector, first)
    rates = speed(intersector, first), speed(intersector, random), speed(intersector, shadow, shadow=True)
    return [met, stored, *spent, *rates]


def terrain(side):
    """A rough ground of some 2 x side^2 triangles, 400 x 400 mm, across the axis at z = -404."""
    rng = np.random.default_rng(0)
    x = np.linspace(-200, 200, side + 1)
    across, up = np.meshgrid(x, x)
    z = -404 + 5 * np.sin(across / 7) * np.cos(up / 9) + rng.normal(scale=20 / side, size=up.shape)
    row = np.arange((side + 1) ** 2).reshape(side + 1, side + 1)
    a, b, c, d = (part.ravel() for part in (row[:-1, :-1], row[:-1, 1:], row[1:, 1:], row[1:, :-1]))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return pl.Scene([pl.Mesh(np.stack([across, up, z], axis=-1).reshape(-1, 3), faces)])


def balls(count, *, copied):
    """Balls of 4900 triangles, turned and scaled, whose volumes fill a tenth of a box of 200 mm about z = -404."""
    rng = np.random.default_rng(0)
    places = np.tile(np.eye(4), (count, 1, 1))
    radius = (0.1 * 200**3 / (4.19 * count)) ** (1 / 3)
    places[:, :3, :3] = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0] * rng.uniform(0.5, 1.2, (count, 1, 1)) * radius
    places[:, :3, 3] = rng.uniform(-100, 100, (count, 3)) - [0, 0, 404]
    some = Instances(pl.sphere(1, segments=(50, 50)), places)
    return pl.Scene(some.meshes() if copied else [some])


def from_a_point(side):
    """(side^2, 6): from the origin through a square of 160 mm at z = -404, in blocks of 4 x 4."""
    x = np.linspace(-80, 80, side)
    grid = np.stack(np.meshgrid(x, x), axis=-1).reshape(side // 4, 4, side // 4, 4, 2).swapaxes(1, 2).reshape(-1, 2)
    through = np.column_stack([grid, np.full(len(grid), -404.0)])
    direction = through / np.linalg.norm(through, axis=1, keepdims=True)
    return np.concatenate([np.zeros_like(direction), direction], axis=1)


def onwards(intersector, first):
    """As many rays from where those end that meet something: in random directions back, and to a lamp."""
    rng = np.random.default_rng(1)
    low, high = np.full(len(first), 200.0), np.full(len(first), 700.0)
    blocked = np.empty(len(first), dtype=np.uint8)
    for _ in range(24):  # where a shadow ray begins to be blocked, 700 mm / 2^24 off at most
        reached = (low + high) / 2
        rays = first.copy()
        rays[:, 3:] *= reached[:, None]
        intersector.fill_occlusion(blocked, rays)
        low, high = np.where(blocked, low, reached), np.where(blocked, reached, high)
    points = (first[:, :3] + low[:, None] * first[:, 3:])[low < 699] + [0, 0, 1e-3]
    points = points[rng.integers(0, len(points), len(first))]
    direction = rng.normal(size=points.shape)
    direction *= np.sign(direction[:, 2:]) / np.linalg.norm(direction, axis=1, keepdims=True)
    lamp = np.column_stack([rng.uniform(-20, 20, (len(points), 2)), np.full(len(points), -200.0)])
    return np.concatenate([points, direction], axis=1), np.concatenate([points, lamp - points], axis=1)


def speed(intersector, rays, shadow=False):
    """Million rays a CPU-second, the best of five rounds."""
    hits, placed, blocked = (np.empty(BUNDLE, dtype) for dtype in (np.int32, np.int32, np.uint8))

    def answered():
        for start in range(0, len(rays), BUNDLE):
            part = rays[start : start + BUNDLE]
            n = len(part)
            if shadow:
                intersector.fill_occlusion(blocked[:n], part)
            else:
                intersector.fill_closest(Hits(hits[:n], placed[:n], None), part)

    return 1e-6 * len(rays) / min(timed(answered)[0].cpu for _ in range(6))
