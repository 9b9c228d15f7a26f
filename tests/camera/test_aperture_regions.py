"""Aperture regions contain every ray that passes, and nothing twice."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from camera_helpers import CAMERA, bare_camera, camera_with, in_blocks, out_of_blocks, the_lens

import plenoptic as pl
from plenoptic.camera.camera_record import camera_record
from plenoptic.camera.sampling.aperture_regions import aperture_regions
from plenoptic.camera.sampling.kernels.camera_samples import aim_sample
from plenoptic.camera.sampling.kernels.round_pieces import ROUND_SCALE
from plenoptic.camera.sampling.region_bounds import openings
from plenoptic.core.kernels.ray_blocks import BLOCK, RAY
from plenoptic.core.numba.jit import kernel
from plenoptic.optics.microlens.kernels.plano_convex import fill_plano_convex
from plenoptic.optics.microlens.microlens_record import SensorPlane, array_record
from plenoptic.optics.stops.stop_registry import STOPS

SENSOR = CAMERA.sensor
SPHERICAL = {"model": pl.optics.MicrolensModel.SPHERICAL, "thickness": 0.3}
TO_SENSOR = SPHERICAL | {"convex_side": pl.optics.ConvexSide.SENSOR}
STRONG = {"focal_lengths": (0.5,), "thickness": 0.2}
CAMERAS = {
    "2.0": CAMERA,
    "2.0 hexagonal blades": camera_with(stop=pl.PolygonStop(6, 5.0, rotation=0.2)),
    "keplerian, fully open": camera_with(2.4, 17.1, to_array=146.6),
    "spherical towards the scene": camera_with(**SPHERICAL),
    "strong spheres towards the sensor": camera_with(0.45, 12.0, **TO_SENSOR | STRONG),
}
MORE_CAMERAS = {
    "1.0": camera_with(2.0, 4.25),
    "2.0 square": camera_with(lattice=pl.Lattice.SQUARE),
    "spherical towards the sensor": camera_with(**TO_SENSOR),
    "1.0 spherical towards the scene": camera_with(2.0, 4.25, **SPHERICAL),
    "1.0 spherical towards the sensor": camera_with(2.0, 4.25, **TO_SENSOR),
    "strong spheres towards the scene": camera_with(0.45, 12.0, **SPHERICAL | STRONG),
}


def some_pixels(rng, n):
    """Centres of random pixels; the middle and a corner are among them."""
    rows, columns = rng.integers(0, 512, (2, n))
    rows[:2], columns[:2] = (256, 0), (256, 0)
    return SENSOR.centre_of(rows, columns)


def bent_by_plates(made, power, b, z, points, centres, sensor):
    """Rays from points of the sensor through points of plano-convex lenses about `centres`, towards the lens."""
    nothing = np.zeros((len(points), 2))
    blocks = in_blocks(np.column_stack([points, centres[:, 0], points - sensor, centres[:, 1], nothing]).T)
    fill_plano_convex(blocks, None, SensorPlane(b, None), made.model, power, made.edges, z, None)
    fields = out_of_blocks(blocks, len(points))
    return pl.RayBundle(fields[:3].T, fields[3:6].T, status=fields[7].astype(np.uint8))


def towards_the_lens(camera, sensor, points):
    """Rays from points of the sensor through points of the array, each bent by the microlens that holds the point."""
    array, n = camera.microlenses, len(points)
    centres, b, z = array.nearest(points), camera.microlenses_to_sensor, camera.stop_to_microlenses
    if array.model is pl.optics.MicrolensModel.THIN:
        slope = (points - sensor) / b - (points - centres) / array.focal_length
        return pl.RayBundle(np.column_stack([points, np.full(n, z)]), np.column_stack([slope, np.full(n, -1.0)]))
    # A ray belongs to the microlens on whose curved side it lands: the array alone, as designed and where designed.
    record = array_record(array, turn=np.eye(2), origin=np.zeros(2), reach=1.0, margin=0.0)
    return bent_by_plates(record, 1 / array.focal_length, b, z, points, centres, sensor)


def regions_of(tables, pixels):
    """Aperture regions of whole pixels."""
    return aperture_regions(tables, pixels, tables.sensor.pixel.half)


def holds(regions, pixel, centres, points, offsets):
    """True for points (n, 2) of microlenses with axes (n, 2) in the regions of points (n, 2) from a pixel's centre."""
    is_held = np.zeros(len(points), dtype=bool)
    for piece in regions.pieces[regions.first[pixel] : regions.first[pixel + 1]]:
        is_lens = np.linalg.norm(centres - [piece["axis_x"], piece["axis_y"]], axis=1) < 1e-9
        moved = offsets @ np.array([[piece["xu"], piece["yu"]], [piece["xv"], piece["yv"]]])
        inside = points - [piece["cell_x"], piece["cell_y"]] - moved
        corners = regions.corners[:, piece["first_corner"] : piece["first_corner"] + piece["corners"]].T
        side = np.roll(corners, -1, axis=0) - corners
        inward = np.stack([-side[:, 1], side[:, 0]], axis=1)
        # Coordinates of a few mm: an edge is some 1e-15 mm wide.
        held = np.all(
            (inside[:, None] - corners) * inward @ [1.0, 1.0] >= -1e-13 * np.linalg.norm(inward, axis=1), axis=1
        )
        for plane in regions.planes[piece["first_plane"] : piece["first_plane"] + piece["planes"]]:
            at = inside @ [plane["a"], plane["b"]] + offsets @ [plane["s"], plane["t"]]
            held &= at <= plane["limit"] + 1e-13 * np.hypot(plane["a"], plane["b"])
        is_held |= is_lens & held
    return is_held


def aims_around(tables, pixel, camera, n, rng):
    """Points of the array over an area much larger than the region of a pixel."""
    behind = tables.pupil.plane.distance
    ratio = behind / tables.sensor.plane.distance
    height_factor = 1 + ratio - behind / camera.microlenses.focal_length
    middle = pixel * ratio / (1 + ratio)
    rim = camera.lens.elements[-1].semi_diameter
    spread = abs(height_factor) * camera.microlenses.cell_radius
    half = min((rim + spread) / (1 + ratio) * 1.1, 1.2) + camera.microlenses.pitch
    return middle + rng.uniform(-half, half, (n, 2))


@pytest.mark.parametrize("cameras", [CAMERAS, pytest.param(MORE_CAMERAS, marks=pytest.mark.slow)], ids=["few", "more"])
def test_regions_hold_every_ray_that_passes_and_nothing_twice(cameras):
    for name, camera in cameras.items():
        tables = camera_record(camera)
        assert_every_ray_that_passes_starts_in_its_cell_s_region(name, camera, tables)
        assert_pieces_stay_in_their_cells_once_each(name, camera, tables)


def assert_every_ray_that_passes_starts_in_its_cell_s_region(name, camera, tables):
    rng, n = np.random.default_rng(23), 40000
    pixels = some_pixels(rng, 6)
    regions = regions_of(tables, pixels)
    passed_in_all = 0
    for p, pixel in enumerate(pixels):
        points = aims_around(tables, pixel, camera, n, rng)
        sensor = pixel + rng.uniform(-0.5, 0.5, (n, 2)) * SENSOR.pixel_pitch
        rays = towards_the_lens(camera, sensor, points)
        if camera.microlenses.model is pl.optics.MicrolensModel.SPHERICAL:
            # An aim in the overlap of widened cells belongs to the neighbour too: try each with its own cell only.
            passed_ = rays.status == 0
            points, sensor, rays = points[passed_], sensor[passed_], rays.selected(passed_)
        passed = camera.lens.trace_reverse(rays).status == 0
        points, offsets = points[passed], (sensor - pixel)[passed]
        passed_in_all += len(points)
        assert np.all(holds(regions, p, camera.microlenses.nearest(points), points, offsets)), name
    assert passed_in_all > 400, name


def assert_pieces_stay_in_their_cells_once_each(name, camera, tables):
    regions = regions_of(tables, some_pixels(np.random.default_rng(31), 60))
    pieces = regions.pieces[: regions.first[-1]]
    assert len(pieces) > 20
    # In the widened cell: its edges are those of the cell, moved out.
    edges = camera.microlenses.cell_edges
    wider = np.linalg.norm(tables.array.opening.corners[0, 0]) / camera.microlenses.cell_radius
    assert 1.0 - 1e-15 <= wider < 1.3
    if camera.microlenses.model is pl.optics.MicrolensModel.THIN:
        assert wider == pytest.approx(1.0, abs=1e-15)
    for piece in pieces:
        x, y = regions.corners[:, piece["first_corner"] : piece["first_corner"] + piece["corners"]]
        if piece["xu"] == 0:
            assert (np.stack([x, y], axis=1) @ edges[:, :2].T - wider * edges[:, 2]).max() <= 1e-14, name
    # Cells are whole multiples of the lattice vectors.
    centres = np.stack([pieces["cell_x"], pieces["cell_y"]], axis=1)
    steps = centres @ np.linalg.inv(camera.microlenses.basis)
    assert np.abs(steps - np.round(steps)).max() < 1e-9
    for p in range(60):
        mine = slice(regions.first[p], regions.first[p + 1])
        assert np.all(np.diff(pieces["area"][mine], prepend=0.0) > 0), name
        assert len(np.unique(np.round(steps[mine]), axis=0)) == len(steps[mine]), name


def test_aims_beyond_the_cell_that_land_on_its_sphere_are_held_too():
    # Aimed a little beside the cell on the principal plane, some rays meet the cell's own curved side.
    for side, excess in ((SPHERICAL, 0.1), (TO_SENSOR, 0.01)):
        camera = camera_with(1.4, 17.1, **side | {"focal_lengths": (1.5,), "thickness": 0.2})
        array, tables = camera.microlenses, camera_record(camera)
        rng = np.random.default_rng(5)
        pixels = some_pixels(rng, 6)
        regions = regions_of(tables, pixels)
        n, n_outside = 60000, 0
        for p, pixel in enumerate(pixels):
            centres = array.nearest(aims_around(tables, pixel, camera, n, rng))
            # On the ways from the centre outwards, around the cell's edge.
            angle = rng.uniform(0, 2 * math.pi, n)
            outward = np.stack([np.cos(angle), np.sin(angle)], axis=1)
            edge = (array.pitch / 2) / (outward @ array.cell_edges[:, :2].T).max(axis=1)
            points = centres + outward * (edge * rng.uniform(1 - excess, 1 + excess, n))[:, None]
            sensor = pixel + rng.uniform(-0.5, 0.5, (n, 2)) * SENSOR.pixel_pitch
            power, b = 1 / array.focal_length, camera.microlenses_to_sensor
            rays = bent_by_plates(tables.array, power, b, tables.parts.z_plane, points, centres, sensor)
            passed = camera.lens.trace_reverse(rays).status == 0
            outside = np.any((points - centres) @ array.cell_edges[:, :2].T > array.cell_edges[:, 2], axis=1)
            tested = passed & outside
            n_outside += np.count_nonzero(tested)
            assert np.all(holds(regions, p, centres[tested], points[tested], (sensor - pixel)[tested])), side
        assert n_outside > 100, side


def test_bounds_hold_the_holes_of_all_stops_and_touch_them():
    curved, mask = (
        pl.PolygonStop(5, 5.0, blade_radius=7.0),
        pl.optics.MaskStop([[0.0, 1.0, 0.25], [1.0, 0.5, 0.0]], 5.0),
    )
    round_stops = {pl.CircularStop(5.0): 0, pl.optics.RingStop(5.0, 2.0): 0, curved: 32}
    stops = round_stops | {pl.PolygonStop(6, 5.0, 0.2): 6, pl.StarStop(5, 5.0, 2.5, 0.3): 5, mask: 6}
    assert {type(stop) for stop in stops} == {kind.stop for kind in STOPS.values()}
    for stop, sides in stops.items():
        lens = pl.LensStack([stop, pl.Surface(math.inf, semi_diameter=9.0)])
        bounds, outline = openings(lens, 550.0), np.asarray(stop.outline(10**5))
        assert len(bounds.edges) == sides, stop
        assert np.all(np.hypot(*outline.T) ** 2 <= bounds.semi_diameter2.min() * (1 + 1e-12)), stop
        reach = (outline @ bounds.edges[:, :2].T).max(axis=0, initial=0.0)
        # The sagitta of the arcs between the 4096 points that bound a curved edge is below 1e-5 of its radius.
        assert np.all(reach <= bounds.edges[:, 2] * (1 + 1e-12)) and np.all(bounds.edges[:, 2] <= reach + 6e-5), stop


def aimed(regions, random):
    """Points of the array (n, 2) that paths from the centre of the first pixel are aimed at."""
    blocks = np.empty(-(-len(random) // BLOCK) * RAY)
    fill_aims(blocks, regions, random)
    fields = blocks.reshape(-1, RAY // BLOCK, BLOCK)
    return np.stack([fields[:, 0].ravel(), fields[:, 1].ravel()], axis=-1)[: len(random)]


@kernel
def fill_aims(blocks, regions, random):
    for k in range(random.shape[0]):
        ray = blocks[(k // BLOCK) * RAY : (k // BLOCK + 1) * RAY]
        region = regions.first[0], regions.first[1]
        aim_sample(ray, k % BLOCK, regions, region, ((0.0, 0.0), (0.0, 0.0)), (random[k, 0], random[k, 1]))


def under_a_sky(camera, first, last, samples=64):
    """Path statistics under a uniform sky; white images do not trace the unvignetted core."""
    options = {"samples": samples, "region": np.s_[first:last, first:last], "truth": pl.Truth.NONE, "progress": False}
    return pl.render(pl.Scene(background=1.0), camera, **options).stats


def test_no_path_through_a_round_opening_is_lost_and_they_fill_it_evenly():
    thin = bare_camera(the_lens(model=pl.LensModel.THIN))
    small = camera_with(lens=the_lens(0.1, pl.LensModel.THIN))
    for camera, pixel in ((thin, (-0.405, 1.105)), (small, (0.005, -0.005))):
        tables = camera_record(camera)
        regions = regions_of(tables, np.array([pixel]))
        (piece,) = regions.pieces[: regions.first[1]]
        assert piece["is_round"] == 1 and piece["planes"] == 0
        # The polygon has the area of the ellipse, and its corners lie on a larger one around the same centre.
        corners = regions.corners[:, piece["first_corner"] :][:, : piece["corners"]]
        x, y = corners
        assert 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) == pytest.approx(piece["area"], rel=1e-12)
        rng, n = np.random.default_rng(29), 40000
        points = aimed(regions, rng.random((n, 2)))
        offsets = points - corners.mean(axis=1) - [piece["cell_x"], piece["cell_y"]]
        shape = np.stack([corners[:, 0] - corners[:, 12], corners[:, 6] - corners[:, 18]], axis=1)
        unit = np.linalg.solve(shape, offsets.T)
        radius2 = (unit**2).sum(axis=0) / (0.25 / ROUND_SCALE**2)
        assert radius2.max() <= 1 + 1e-12
        # Uniform by area: moments of the unit disc, 5 standard errors.
        assert radius2.mean() == pytest.approx(0.5, abs=5 / math.sqrt(12 * n))
        angle = np.arctan2(unit[1], unit[0])
        for k in (1, 2, 3):
            assert abs(np.exp(1j * k * angle).mean()) < 5 / math.sqrt(n), k
    stats = under_a_sky(thin, 240, 272)
    assert stats.paths_through_lens == stats.paths


def test_round_pieces_beside_clipped_ones_are_filled():
    """White images draw no ellipses: the same light, also where a pixel sees a round piece and a clipped one."""
    lens = the_lens(1.5, pl.LensModel.THIN)
    camera = camera_with(3.0, lens=lens, shape=(24, 24), focal_lengths=(1.4,))
    tables = camera_record(camera)
    rows, columns = np.divmod(np.arange(24 * 24), 24)
    regions = regions_of(tables, camera.sensor.centre_of(rows, columns))
    parts = [regions.pieces[a:b] for a, b in itertools.pairwise(regions.first)]
    is_mixed = np.array([part["is_round"].any() and part["planes"].any() for part in parts]).reshape(24, 24)
    assert is_mixed.sum() > 50
    options = {"samples": 1024, "truth": pl.Truth.NONE, "progress": False}
    white = pl.render_white(camera, samples=1024, seed=99, progress=False).image[is_mixed].sum(dtype=float)
    seen = [pl.render(pl.Scene(background=1.0), camera, seed=k, **options).image for k in range(8)]
    light = np.array([image[is_mixed].sum(dtype=float) for image in seen]) / white
    # Polygons of the same area would lack 2.2e-3 of it.
    assert abs(light.mean() - 1) < 5 * light.std(ddof=1) / math.sqrt(8) + 1e-4


def test_nearly_all_paths_pass():
    both = CAMERAS | MORE_CAMERAS
    for name, least_fraction in (
        *(("2.0", 0.96), ("1.0", 0.97), ("2.0 square", 0.94), ("2.0 hexagonal blades", 0.93)),
        *(("spherical towards the scene", 0.75), ("spherical towards the sensor", 0.7)),
    ):
        stats = under_a_sky(both[name], 240, 272)
        # Those count that do not start on a part of a pixel that is dark.
        dark = sum(count for cause, element, count in stats.lost if cause == "missed" and element is None)
        assert stats.paths_through_lens > least_fraction * (stats.paths - dark), name
    assert under_a_sky(bare_camera(), 240, 272).fraction_through_lens > 0.98
    # The sensor's size does not matter.
    camera = dataclasses.replace(CAMERA, sensor=pl.Sensor(shape=(4096, 4096), pixel_pitch=0.01))
    for first in (2032, 1000):
        assert under_a_sky(camera, first, first + 32, samples=16).fraction_through_lens > 0.96
    # Small stops waste little more. Paths are lost that start on a part of their pixel to which the image of the stop
    # does not reach.
    for stop, least_fraction in ((1.0, 0.5), (0.1, 0.3), (0.01, 0.2)):
        assert under_a_sky(camera_with(stop=stop), 240, 304).fraction_through_lens > least_fraction, stop


def test_more_pieces_than_the_first_capacity():
    # More pieces than the first guess of 2 a pixel: a wide pupil over many small microlenses.
    tables = camera_record(camera_with(0.45, 17.1, pitch=0.05, focal_lengths=(0.5,)))
    pixels = SENSOR.centre_of(*np.mgrid[250:254, 250:254].reshape(2, -1))
    regions = regions_of(tables, pixels)
    areas = regions.pieces["area"][: regions.first[-1]]
    one_by_one = [regions_of(tables, pixels[p : p + 1]) for p in range(16)]
    assert np.array_equal(areas, np.concatenate([one.pieces["area"][: one.first[-1]] for one in one_by_one]))
    assert len(areas) > 2 * 16


def biconvex(stop, before, radii, thickness, index, semi_diameters):
    front = pl.Surface(radii[0], thickness, pl.ConstantMedium(index), semi_diameter=semi_diameters[0])
    back = pl.Surface(-radii[1], semi_diameter=semi_diameters[1])
    return pl.LensStack([pl.CircularStop(stop, before), front, back])


def cut_ball(stop, before, thickness, index, semi_diameter):
    """More than half a ball of radius 10, its flat side towards the scene."""
    front = pl.Surface(math.inf, thickness, pl.ConstantMedium(index), semi_diameter=semi_diameter)
    return pl.LensStack([pl.CircularStop(stop, before), front, pl.Surface(-10.0, semi_diameter=10.0, depth=thickness)])


NEAR = 0.84, 1.8
PARTED = {
    # Lens, distance of the sensor from its last vertex, pixel pitch, distance of pixels from the axis.
    "small pupil close to the sensor": (cut_ball(1.815, 2.216, 18.39, 1.841, 5.445), 0.528, 0.25, (0.0, 1.75, 5.75)),
    "crescent far from the rest": (cut_ball(0.514, 3.329, 11.12, 1.589, 9.937), 8.607, 0.2, (6.2, 8.2)),
    "steep between two parts": (biconvex(0.641, 2.614, (7.48, 8.76), 14.348, 1.987, (6.6, 6.685)), 1.08, 0.02, NEAR),
    "ball": (biconvex(1.391, 5.829, (10.0, 10.0), 20.0, 1.5315, (8.774, 8.774)), 1.447, 0.02, (2.32, 3.56, 4.12)),
    "two crescents": (biconvex(0.526, 3.422, (12.66, 12.0), 22.0, 1.638, (9.178, 11.86)), 6.787, 0.01, (1.2, 5.0)),
    "horns": (cut_ball(2.454, 3.91, 13.795, 1.479, 9.25), 9.0, 0.02, (8.62,)),
}
FEW = ["crescent far from the rest", "steep between two parts", "two crescents"]


@pytest.mark.parametrize(("names", "n"), [(FEW, 1 << 16), pytest.param([*PARTED], 1 << 17, marks=pytest.mark.slow)])
def test_disconnected_pupils_lose_no_ray(names, n):
    for name in names:
        lens, gap, pitch, places = PARTED[name]
        columns, last = 2 * round(max(places) / pitch) + 3, float(lens.vertices[-1])
        camera = bare_camera(lens, last + gap, (1, columns), pitch)
        tables = camera_record(camera)
        pixels = camera.sensor.centre_of(np.zeros(len(places)), np.rint(columns / 2 - 0.5 - np.array(places) / pitch))
        regions = regions_of(tables, pixels)
        rng = np.random.default_rng(41)
        for p, pixel in enumerate(pixels):
            offsets = rng.uniform(-0.5, 0.5, (n, 2)) * pitch
            start = np.column_stack([pixel + offsets, np.full(n, last + gap)])
            # All directions, as a Lambertian patch of the pixel sends light.
            sine, azimuth = np.sqrt(rng.uniform(size=n)), rng.uniform(0, 2 * math.pi, n)
            along = np.column_stack([sine * np.cos(azimuth), sine * np.sin(azimuth), -np.sqrt(1 - sine * sine)])
            passed = lens.trace_reverse(pl.RayBundle(start, along)).status == 0
            aim = start[passed, :2] - (gap / along[passed, 2])[:, None] * along[passed, :2]
            assert np.count_nonzero(passed) > 50, name
            assert np.all(holds(regions, p, np.zeros((len(aim), 2)), aim, offsets[passed])), name
