"""White images against areas: what each microlens gets, and the shape of the stop under it."""

import dataclasses
import math

import numpy as np
import pytest
from camera_helpers import camera_with, the_lens, total, white, with_array

import plenoptic as pl

FOCAL = 2.0


def camera_of(lens, distance=123.3, pitch=0.217):
    """A plenoptic 1.0 camera."""
    return camera_with(FOCAL, shape=(600, 600), lens=lens, to_array=distance, pitch=pitch, lattice=pl.Lattice.SQUARE)


def alone(camera, centre):
    """The same camera with all microlenses but one made dark, so that no light of others reaches its image."""
    index = camera.microlenses.lenses((-6, -6), (6, 6)).index
    others = index[(index != np.round(centre / camera.microlenses.pitch).astype(int)).any(axis=1)]
    dark = pl.optics.MicrolensDeviations(others, transmission=np.zeros(len(others)))
    return with_array(camera, imperfections=dark)


def around(camera, centre, half):
    """The region of the pixels within `half` (mm) of a point of the sensor, and their places (rows, columns, 2)."""
    row, column = np.rint(camera.sensor.pixel_of(centre)).astype(int)
    n = round(half / camera.sensor.pixel_pitch)
    region = np.s_[row - n : row + n + 1, column - n : column + n + 1]
    return region, camera.sensor.centre_of(*np.mgrid[region])


def light_in(camera, centre, half, samples):
    """Light on the pixels within `half` (mm) of a point of the sensor, and its standard error, times mm^2."""
    shot = white(camera, samples, around(camera, centre, half)[0])
    return np.multiply(total(shot), camera.sensor.pixel_pitch**2)


def tube(*stops):
    sides = (1.0, pl.ConstantMedium(1.5)), (0.0, pl.optics.AIR)
    plate = [pl.Surface(math.inf, thickness, medium, semi_diameter=20.0) for thickness, medium in sides]
    return pl.LensStack([*stops, *plate], iris=0).with_model(pl.LensModel.NONE)


def test_microlenses_get_what_stops_and_rims_leave_open():
    lens, pitch = the_lens(), 0.08
    twice = lens.inserted(pl.CircularStop(5.5), z=60.0)
    # Rays in reverse from the microlens through a fine grid of a plane behind the lens.
    z, step = 62.0, 0.04
    grid = np.meshgrid(np.arange(-9, 9, step), np.arange(-9, 9, step))
    plane = np.column_stack([*(g.ravel() for g in grid), np.full(grid[0].size, z)])
    for stops, height in ((lens, 0.0), (lens, 2.6), (twice, 1.5), (twice, 2.6)):
        camera = camera_of(stops, pitch=pitch)
        centre = np.round(np.array([height * 0.8, height * 0.6]) / pitch) * pitch
        light, error = light_in(alone(camera, centre), centre * (1 + FOCAL / 128.5), 0.25, 512)
        start = np.array([*centre, 123.3])
        out = stops.trace_reverse(pl.RayBundle(np.tile(start, (len(plane), 1)), plane - start))
        open_area = np.count_nonzero(out.status == 0) * step**2
        # Ideal microlenses keep dx dy du dv; at the sensor it is weighed by cos^4 of slopes up to 0.1: 1 to 1 %.
        expected = pitch**2 * open_area / (123.3 - z) ** 2
        assert light == pytest.approx(expected, rel=0.015, abs=4 * error), height
        assert error < 0.01 * expected, height


STOPS = {"round": pl.CircularStop(5.0), "6 blades": pl.PolygonStop(6, 5.0, rotation=0.2)}
STOPS |= {"12 blades": pl.PolygonStop(12, 5.0), "star": pl.StarStop(5, 5.0, 2.5, rotation=0.3)}
STOPS |= {"curved blades": pl.PolygonStop(5, 5.0, blade_radius=7.0)}


def assert_shape(camera, centre, half, holes, name):
    """Under the microlens at `centre` light is where holes (stop, its distance, its scale, from where) let it pass.

    With b = f, the pixel at s under the microlens at c sees, through all of the cell, the parallel beam of slope
    (s - c) / f, which crosses a hole at the distance D around P = c - (s - c) D / f, as wide as the cell. So it is
    fully lit where P +- half a cell is open in all holes, and dark where all of it is closed in one of them.
    """
    pitch, away = camera.microlenses.pitch, holes[0][1]
    region, places = around(camera, centre * (1 + FOCAL / away), half)
    shot = white(alone(camera, centre), 128, region).image[..., 0]
    slope, inside = (places - centre) / FOCAL, []
    steps = np.mgrid[-1:1:9j, -1:1:9j].reshape(2, -1).T  # between the corners too, where a hole is not convex
    for stop, away, scale in holes:
        reach = 0.5 * (pitch + camera.sensor.pixel_pitch * away / FOCAL)
        beams = ((centre - slope * away + reach * step) / scale for step in steps)
        inside.append([stop.contains(*beam.transpose(2, 0, 1)) for beam in beams])
    lit, dark = np.all(inside, axis=(0, 1)), ~np.any(inside, axis=1)
    # A second stop really cuts: pixels that the first one alone would light are dark.
    assert len(holes) == 1 or (dark[1] & ~dark[0]).sum() > 5, name
    dark = np.any(dark, axis=0)
    full = pitch**2 / FOCAL**2 * (1 + (slope**2).sum(axis=-1)) ** -2
    # cos^4 at the corners of the cell is 2 % off that of its centre.
    assert lit.sum() > 20 and dark.sum() > 20, name
    assert shot[lit] == pytest.approx(full[lit], rel=0.03), name
    assert np.all(shot[dark] == 0), name


def test_the_stop_s_shape_appears_under_each_microlens():
    for name, offset in (*((name, (6, -4)) for name in STOPS), ("6 blades", (0, 0)), ("star", (0, 0))):
        lens = the_lens(STOPS[name], pl.LensModel.THIN)
        points = pl.paraxial.cardinal_points(lens, 587.6)
        hole = (lens.stop, 123.3 - points.rear_principal, points.entrance_pupil_semi_diameter / 5.0)
        assert_shape(camera_of(lens), np.array(offset) * 0.217, 0.12, [hole], name)


def test_blades_that_are_curved_inwards_dim_by_the_area_of_their_hole():
    # cos^4 at the rim of the cone of f/10 is 1 - 0.005. Of 65 536 independent samples 0.44 pass, with a relative
    # standard error of sqrt(0.56 / (0.44 * 65536)) = 0.0044; Sobol points have a smaller one.
    straight, inwards = pl.PolygonStop(4, 5.0, 0.3), pl.PolygonStop(4, 5.0, 0.3, blade_radius=-5.05)
    lens, sensor = pl.load_lens("double-gauss-100mm-f2"), pl.Sensor((8, 8), 0.01)
    cameras = [pl.PlenopticCamera(lens.with_stop(stop), sensor, 102.5) for stop in (inwards, straight)]
    dim, full = (white(camera, 1024).image.mean() for camera in cameras)
    assert dim / full == pytest.approx(inwards.area / straight.area, rel=0.005 + 4 * 0.0044)


def test_images_are_cut_off_where_the_second_stop_cuts():
    # Two stops and no lens.
    distance, pitch = 70.0, 0.1
    for name, height in (("6 blades", 1.3), ("star", 2.0)):
        stop, near = dataclasses.replace(STOPS[name], thickness=40.0), pl.CircularStop(2.2, thickness=1.0)
        centre = np.round(np.array([0.8, 0.6]) * height / pitch) * pitch
        holes = [(stop, distance, 1.0), (near, distance - 40.0, 1.0)]
        assert_shape(camera_of(tube(stop, near), distance, pitch), centre, 0.22, holes, name)
