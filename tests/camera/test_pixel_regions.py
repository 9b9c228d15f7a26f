"""The regions from which samples are drawn: they hold every ray that passes, and nothing twice."""

import dataclasses
import math

import numpy as np
import pytest
from numpy.lib.recfunctions import structured_to_unstructured

import plenoptic as pl
from plenoptic.camera.record import CameraRecord, camera_record
from plenoptic.camera.sampling.pixel_regions import feeding_regions
from plenoptic.core.kernels.ray_blocks import BLOCK
from plenoptic.optics.microlens.kernels.plano_convex import fill_plano_convex
from plenoptic.optics.microlens.record import SensorPlane, array_record

LENS = pl.load_lens("double-gauss-100mm-f2")
SENSOR = pl.Sensor(shape=(512, 512), pixel_pitch=0.01)
THIN = pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,))
SPHERICAL = dataclasses.replace(THIN, model=pl.optics.MicrolensModel.SPHERICAL, thickness=0.3, index=1.5)
HALF_PIXEL = 0.5 * math.sqrt(2) * SENSOR.pixel_pitch


def camera_of(array: pl.MicrolensArray | None, b: float, stop: float, stop_to_microlenses: float = 123.3, **changes):
    fields = {"lens": LENS.with_stop(pl.CircularStop(stop)), "sensor": SENSOR} | changes
    return pl.PlenopticCamera(
        microlenses=array, stop_to_microlenses=stop_to_microlenses, microlenses_to_sensor=b, **fields
    )


def with_side(side: pl.optics.ConvexSide, **changes) -> pl.MicrolensArray:
    return dataclasses.replace(SPHERICAL, convex_side=side, **changes)


CAMERAS = {
    "2.0": camera_of(THIN, 1.7, 5.0),
    "1.0": camera_of(THIN, 2.0, 4.25),
    "2.0 square": camera_of(dataclasses.replace(THIN, lattice=pl.Lattice.SQUARE), 1.7, 5.0),
    "2.0 hexagonal blades": camera_of(THIN, 1.7, 5.0, lens=LENS.with_stop(pl.PolygonStop(6, 5.0, rotation=0.2))),
    "keplerian, fully open": camera_of(THIN, 2.4, 17.1, 146.6),
    "spherical towards the scene": camera_of(with_side(pl.optics.ConvexSide.SCENE), 1.7, 5.0),
    "spherical towards the sensor": camera_of(with_side(pl.optics.ConvexSide.SENSOR), 1.7, 5.0),
    "1.0 spherical towards the scene": camera_of(with_side(pl.optics.ConvexSide.SCENE), 2.0, 4.25),
    "1.0 spherical towards the sensor": camera_of(with_side(pl.optics.ConvexSide.SENSOR), 2.0, 4.25),
    "strong spheres towards the sensor": camera_of(
        with_side(pl.optics.ConvexSide.SENSOR, focal_lengths=(0.5,), thickness=0.2), 0.45, 12.0
    ),
    "strong spheres towards the scene": camera_of(
        with_side(pl.optics.ConvexSide.SCENE, focal_lengths=(0.5,), thickness=0.2), 0.45, 12.0
    ),
}
BY_NAME = pytest.mark.parametrize("name", list(CAMERAS))


def some_pixels(rng: np.random.Generator, n: int) -> np.ndarray:
    """Centres of random pixels; the middle and a corner are among them."""
    rows, columns = rng.integers(0, 512, (2, n))
    rows[:2], columns[:2] = (256, 0), (256, 0)
    return SENSOR.centre_of(rows, columns)


def towards_the_lens(camera: pl.PlenopticCamera, sensor: np.ndarray, points: np.ndarray) -> pl.RayBundle:
    """Rays from points of the sensor through points of the array, each bent by the microlens that holds the point."""
    array, n = camera.microlenses, len(points)
    assert array is not None
    centres = array.nearest(points)
    b, z = camera.microlenses_to_sensor, camera.stop_to_microlenses
    if array.model is pl.optics.MicrolensModel.THIN:
        slope = (points - sensor) / b - (points - centres) / array.focal_length
        return pl.RayBundle(np.column_stack([points, np.full(n, z)]), np.column_stack([slope, np.full(n, -1.0)]))
    rows = np.zeros((8, -(-n // BLOCK) * BLOCK))
    rows[:6, :n] = np.column_stack([points, centres[:, 0], points - sensor, centres[:, 1]]).T
    blocks = np.ascontiguousarray(rows.reshape(8, -1, BLOCK).transpose(1, 0, 2))
    # A ray belongs to the microlens on whose curved side it lands.
    made, power = cell_of(array), 1 / array.focal_length
    fill_plano_convex(blocks.reshape(-1), None, SensorPlane(b, None), made.model, power, made.edges, z, None)
    x, y, z_out, l, m, n_out, _, status = blocks.transpose(1, 0, 2).reshape(8, -1)[:, :n]
    origin, along = np.stack([x, y, z_out], axis=1), np.stack([l, m, n_out], axis=1)
    return pl.RayBundle(origin, along, status=status.astype(np.uint8))


def cell_of(array: pl.MicrolensArray):
    """The numbers of the array alone, as designed and where designed."""
    return array_record(array, turn=np.eye(2), origin=np.zeros(2), reach=1.0, margin=0.0)


def regions_of(tables: CameraRecord, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Triangles as columns, those of TRIANGLE, and where those of each pixel begin."""
    regions = feeding_regions(tables, pixels, HALF_PIXEL)
    return structured_to_unstructured(regions.triangles), regions.first


def aims_around(tables: CameraRecord, pixel: np.ndarray, camera: pl.PlenopticCamera, n: int, rng) -> np.ndarray:
    """Points of the array over much more than what can see the lens's rear from a pixel."""
    behind = tables.pupil.plane.distance
    ratio = behind / tables.sensor.plane.distance
    bend = 1 + ratio - behind / camera.microlenses.focal_length
    middle = pixel * ratio / (1 + ratio)
    rim = camera.lens.elements[-1].semi_diameter
    spread = abs(bend) * camera.microlenses.cell_radius
    half = min((rim + spread) / (1 + ratio) * 1.1, 1.2) + camera.microlenses.pitch
    return middle + rng.uniform(-half, half, (n, 2))


def depth_inside(triangles: np.ndarray, points: np.ndarray) -> np.ndarray:
    """How deep each point lies in each triangle, (points, triangles) in mm; negative outside."""
    corner, a, b = triangles[:, None, 0:2], triangles[:, None, 2:4], triangles[:, None, 4:6]
    corners = np.concatenate([corner, corner + a, corner + b], axis=1)
    side = np.roll(corners, -1, axis=1) - corners
    inward = np.stack([-side[..., 1], side[..., 0]], axis=-1) / np.linalg.norm(side, axis=-1, keepdims=True)
    return np.einsum("ptkc,tkc->ptk", points[:, None, None] - corners, inward).min(axis=2)


@BY_NAME
def test_every_ray_that_passes_starts_in_its_cell_s_region(name: str) -> None:
    camera = CAMERAS[name]
    tables = camera_record(camera)
    rng = np.random.default_rng(23)
    pixels = some_pixels(rng, 8)
    triangles, first = regions_of(tables, pixels)
    passed_in_all = 0
    for p, pixel in enumerate(pixels):
        n = 40000
        points = aims_around(tables, pixel, camera, n, rng)
        sensor = pixel + rng.uniform(-0.5, 0.5, (n, 2)) * SENSOR.pixel_pitch
        rays = towards_the_lens(camera, sensor, points)
        if camera.microlenses.model is pl.optics.MicrolensModel.SPHERICAL:
            # An aim in the overlap of widened cells belongs to the neighbour too: try each with its own cell only.
            points, rays = points[rays.status == 0], rays.selected(rays.status == 0)
        passed = camera.lens.trace_reverse(rays).status == 0
        points = points[passed]
        passed_in_all += len(points)
        mine = triangles[first[p] : first[p + 1]]
        if not len(points):
            continue
        centres = camera.microlenses.nearest(points)
        own = np.linalg.norm(mine[None, :, 7:9] - centres[:, None], axis=2) < 1e-9
        # Coordinates of a few mm: an edge is some 1e-15 mm wide.
        held = np.any(own & (depth_inside(mine, points) >= -1e-13), axis=1)
        assert np.all(held)
    assert passed_in_all > 500


@pytest.mark.parametrize("side", list(pl.optics.ConvexSide))
def test_aims_beyond_the_cell_that_land_on_its_sphere_are_held_too(side: pl.optics.ConvexSide) -> None:
    # Aimed a little beside the cell on the principal plane, some rays meet the cell's own curved side.
    camera = camera_of(with_side(side, focal_lengths=(1.5,), thickness=0.2), 1.4, 17.1)
    beside = 0.1 if side is pl.optics.ConvexSide.SCENE else 0.01
    array, tables = camera.microlenses, camera_record(camera)
    rng = np.random.default_rng(5)
    pixels = some_pixels(rng, 6)
    triangles, first = regions_of(tables, pixels)
    n, seen = 60000, 0
    for p, pixel in enumerate(pixels):
        centres = array.nearest(aims_around(tables, pixel, camera, n, rng))
        # On the ways from the centre outwards, around the cell's edge.
        angle = rng.uniform(0, 2 * math.pi, n)
        outward = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        edge = (array.pitch / 2) / (outward @ array.cell_edges[:, :2].T).max(axis=1)
        points = centres + outward * (edge * rng.uniform(1 - beside, 1 + beside, n))[:, None]
        sensor = pixel + rng.uniform(-0.5, 0.5, (n, 2)) * SENSOR.pixel_pitch
        rows = np.zeros((8, -(-n // BLOCK) * BLOCK))
        rows[:6, :n] = np.column_stack([points, centres[:, 0], points - sensor, centres[:, 1]]).T
        blocks = np.ascontiguousarray(rows.reshape(8, -1, BLOCK).transpose(1, 0, 2))
        b = camera.microlenses_to_sensor
        made, plane = tables.array, SensorPlane(b, None)
        fill_plano_convex(
            blocks.reshape(-1), None, plane, made.model, 1 / array.focal_length, made.edges, tables.z_plane, None
        )
        fields = blocks.transpose(1, 0, 2).reshape(8, -1)[:, :n]
        rays = pl.RayBundle(fields[:3].T, fields[3:6].T, status=fields[7].astype(np.uint8))
        passed = camera.lens.trace_reverse(rays).status == 0
        outside = np.any((points - centres) @ array.cell_edges[:, :2].T > array.cell_edges[:, 2], axis=1)
        points, centres = points[passed & outside], centres[passed & outside]
        seen += len(points)
        if not len(points):
            continue
        mine = triangles[first[p] : first[p + 1]]
        own = np.linalg.norm(mine[None, :, 7:9] - centres[:, None], axis=2) < 1e-9
        assert np.all(np.any(own & (depth_inside(mine, points) >= -1e-13), axis=1))
    assert seen > 100


@BY_NAME
def test_triangles_stay_in_their_cell_and_never_overlap(name: str) -> None:
    camera = CAMERAS[name]
    tables = camera_record(camera)
    rng = np.random.default_rng(31)
    pixels = some_pixels(rng, 60)
    triangles, first = regions_of(tables, pixels)
    assert len(triangles) > 60
    corner, a, b = triangles[:, 0:2], triangles[:, 2:4], triangles[:, 4:6]
    # In the widened cell: its edges are those of the cell, moved out.
    edges = camera.microlenses.cell_edges
    wider = np.linalg.norm(tables.array.opening.corners[0, 0]) / camera.microlenses.cell_radius
    assert wider >= 1.0 - 1e-15
    if camera.microlenses.model is pl.optics.MicrolensModel.THIN:
        assert wider == pytest.approx(1.0, abs=1e-15)
    assert wider < 1.3
    for points in (corner, corner + a, corner + b):
        assert ((points - triangles[:, 7:9]) @ edges[:, :2].T - wider * edges[:, 2]).max() <= 1e-14
    # Cells are whole multiples of the lattice vectors.
    steps = triangles[:, 7:9] @ np.linalg.inv(camera.microlenses.basis)
    assert np.abs(steps - np.round(steps)).max() < 1e-9
    # Areas add up over a pixel's triangles, which are counter-clockwise.
    area = 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    assert np.all(area > 0)
    for p in range(60):
        mine = slice(first[p], first[p + 1])
        assert triangles[mine, 6] == pytest.approx(np.cumsum(area[mine]), rel=1e-13)
        # A point deep inside one triangle of a cell is inside no other one of that cell.
        part = triangles[mine]
        if not len(part):
            continue
        u, v = rng.uniform(size=(2, 12, len(part)))
        u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
        points = (part[:, 0:2] + u[..., None] * part[:, 2:4] + v[..., None] * part[:, 4:6]).reshape(-1, 2)
        cell = np.tile(part[:, 7:9], (12, 1))
        same_cell = np.linalg.norm(cell[:, None] - part[None, :, 7:9], axis=2) < 1e-9
        depth = depth_inside(part, points)
        itself = np.tile(np.eye(len(part), dtype=bool), (12, 1))
        assert np.all(depth[itself] >= -1e-13)
        # Without widening, cells do not overlap either.
        rivals = ~itself & (same_cell if wider > 1 else True)
        assert not np.any(rivals & (depth > 1e-12))


@pytest.mark.parametrize(
    "name", ["2.0", "1.0", "2.0 square", "spherical towards the scene", "spherical towards the sensor"]
)
def test_a_region_wastes_little(name: str) -> None:
    # At least 60 % of the samples must leave the lens; here over pixels of the middle of the sensor, where nothing
    # vignettes.
    camera = CAMERAS[name]
    tables = camera_record(camera)
    rng = np.random.default_rng(6)
    pixels = SENSOR.centre_of(*rng.integers(200, 312, (2, 60)))
    triangles, first = regions_of(tables, pixels)
    area = np.array([triangles[first[p + 1] - 1, 6] if first[p + 1] > first[p] else 0.0 for p in range(60)])
    passing = np.zeros(60)
    for p, pixel in enumerate(pixels):
        n = 4000
        points = aims_around(tables, pixel, camera, n, rng)
        side = np.ptp(points, axis=0).prod()
        sensor = pixel + rng.uniform(-0.5, 0.5, (n, 2)) * SENSOR.pixel_pitch
        rays = towards_the_lens(camera, sensor, points)
        passing[p] = side * np.count_nonzero(camera.lens.trace_reverse(rays).status == 0) / n
    # Counts of 60 pixels: a standard error of some 3 %.
    assert passing.sum() / area.sum() > 0.55


def test_without_microlenses_the_region_is_the_pupil_s_outline() -> None:
    camera = camera_of(None, 0.0, 5.0, 134.6)
    tables = camera_record(camera)
    rng = np.random.default_rng(12)
    pixels = some_pixels(rng, 20)
    triangles, first = regions_of(tables, pixels)
    z = tables.z_plane
    rim = camera.lens.elements[-1].semi_diameter
    for p, pixel in enumerate(pixels):
        aim = rng.uniform(-rim, rim, (4000, 2))
        sensor = pixel + rng.uniform(-0.5, 0.5, (4000, 2)) * SENSOR.pixel_pitch
        start = np.column_stack([sensor, np.full(4000, camera.z_sensor)])
        rays = pl.RayBundle(start, np.column_stack([aim, np.full(4000, z)]) - start)
        passed = camera.lens.trace_reverse(rays).status == 0
        assert np.count_nonzero(passed) > 100
        mine = triangles[first[p] : first[p + 1]]
        assert np.all(np.any(depth_inside(mine, aim[passed]) >= -1e-13, axis=1))


def test_little_room_is_not_overrun() -> None:
    # More triangles than the first guess of 16 a pixel: a wide pupil over many small microlenses.
    array = pl.MicrolensArray(pitch=0.05, focal_lengths=(0.5,))
    camera = camera_of(array, 0.45, 17.1, 123.3)
    tables = camera_record(camera)
    pixels = SENSOR.centre_of(*np.mgrid[250:254, 250:254].reshape(2, -1))
    triangles, first = regions_of(tables, pixels)
    one_by_one = [regions_of(tables, pixels[p : p + 1])[0] for p in range(16)]
    assert np.array_equal(triangles, np.concatenate(one_by_one))
    assert first[-1] == len(triangles)
