"""Forward tracing through dust, onto pixels that do not see all light, and through grey masks: laws and hand sums."""

import dataclasses
import math

import numpy as np
import pytest
from camera_helpers import GAUSS, camera_with, the_lens

import plenoptic as pl
from plenoptic.camera.assembly import array_axes
from plenoptic.camera.points.centroids import centroids_at, moment_points
from plenoptic.camera.psf.point_spread import landing_points, point_spread
from plenoptic.camera.report.illumination import corner_light
from plenoptic.optics.microlens.dust import Blemishes, BlemishSite
from plenoptic.optics.sensor.angular_response import AngularResponse
from plenoptic.optics.stops.mask import MaskStop

POINT = (5.0, 3.0, -380.0)
PIXEL = 0.01


def camera_obscura(**changes):
    """A hole in the iris, no lens: the ray that lands at s on the sensor, at z = 125, crosses the plane z at s z / 125.

    The microlenses hardly bend.
    """
    return camera_with(lens=the_lens(1e-4, pl.LensModel.NONE), focal_lengths=(1e9,), **changes)


PLACES = np.random.default_rng(1).uniform(-8.0, 8.0, (300, 2))
SOURCES = np.column_stack([PLACES, np.full(len(PLACES), -404.0)])
"""Points whose images through the hole lie all over the sensor."""


@pytest.fixture(scope="module")
def plain():
    return landing_points(camera_obscura(), SOURCES, rays=4)


def test_light_lands_in_the_openings_of_pixels_only():
    cameras = camera_with(), camera_with(pixels={"pixel_aperture": (0.4, 0.9)})
    plain, landed_points = (landing_points(camera, POINT, rays=1 << 14) for camera in cameras)
    # Row and column are whole at the centres of pixels.
    row, column = camera_with().sensor.pixel_of(plain.position).T
    inside = (np.abs(column - np.rint(column)) <= 0.2) & (np.abs(row - np.rint(row)) <= 0.45)
    np.testing.assert_array_equal(landed_points.position, plain.position[inside])
    np.testing.assert_array_equal(landed_points.weight, plain.weight[inside])
    assert 0.3 < inside.mean() < 0.42


def test_light_beside_openings_is_a_fate():
    camera_ = camera_with(pixels={"pixel_aperture": (0.5, 0.6)})
    spread = point_spread(camera_, [(1.0, 0.5, -250.0), (8.5, 0.0, -404.0)], rays=1 << 14)
    assert ("beside_opening", None) in spread.fates
    np.testing.assert_allclose(spread.fractions.sum(axis=1), 1.0, rtol=1e-12)
    open_spread = point_spread(camera_with(), (1.0, 0.5, -250.0), rays=1 << 14)
    fractions, plain = spread.fraction_by_fate, open_spread.fraction_by_fate
    # The light of a point covers some thousand pixels: 0.3 of it to a few per cent.
    assert fractions["landed"][0] / plain["landed"] == pytest.approx(0.3, abs=0.03)
    assert fractions["landed"][0] + fractions["beside_opening"][0] == pytest.approx(plain["landed"], rel=1e-12)
    assert "beside_opening" not in plain


def test_response_is_that_to_the_direction_of_each_ray(plain):
    response = AngularResponse(well_depth=2.0, index=1.3, pupil_distance=60.0, exponent=3.0)
    landed_points = landing_points(camera_obscura(pixels={"angular_response": response}), SOURCES, rays=4)
    x, y = landed_points.position.T
    expected = response.at(-x / 125.0, -y / 125.0, x=x, y=y)
    # The hole is 1e-4 mm wide, 125 mm away; the response changes by some 3 per unit of slope.
    np.testing.assert_allclose(landed_points.weight / plain.weight, expected, atol=1e-5)
    assert np.ptp(expected) > 0.02


def test_dust_takes_its_part_where_rays_cross_its_plane(plain):
    rng = np.random.default_rng(4)
    for site, height, z in (
        (BlemishSite.SENSOR, 0.0, 125.0),
        (BlemishSite.SENSOR, 0.8, 124.2),
        (BlemishSite.ARRAY, 0.0, 123.3),
        (BlemishSite.LENS_REAR, 0.0, float(GAUSS.vertices[-1])),
        (BlemishSite.LENS_FRONT, 0.0, float(GAUSS.vertices[0])),
    ):
        scale = z / 125.0
        start = scale * rng.uniform(-2.6, 2.6, (40, 2))
        end, radius = start + scale * rng.uniform(-0.5, 0.5, (40, 2)), abs(scale) * rng.uniform(0.05, 0.2, 40)
        grains = Blemishes(site, start, end, radius, transmission=rng.uniform(0.0, 0.9, 40), height=height)
        landed_points = landing_points(camera_obscura(blemishes=(grains,)), SOURCES, rays=4)
        np.testing.assert_array_equal(landed_points.position, plain.position)
        passing = grains.at(scale * landed_points.position)
        # At the edge of a grain, the width of the hole decides: 1e-4 mm of some 0.1 mm.
        assert (np.abs(landed_points.weight / plain.weight - passing) < 1e-12).mean() > 0.99, (site, height)
        assert 0.05 < (passing < 1).mean() < 0.9, (site, height)


def test_dust_moves_with_what_it_lies_on():
    grain = Blemishes(BlemishSite.SENSOR, [(0.4, -0.3)], [(0.4, -0.3)], radius=0.6, transmission=0.0)
    for part, site in ((pl.CameraPart.SENSOR, BlemishSite.SENSOR), (pl.CameraPart.MICROLENSES, BlemishSite.ARRAY)):
        camera = camera_obscura(blemishes=(dataclasses.replace(grain, site=site),))
        moved = camera.moved(part, shift=(0.2, 0.1, 0.0), tilt=(0.0, 0.0, 0.5))
        landed_points = landing_points(moved, SOURCES, rays=1)
        turn = np.array([[math.cos(0.5), -math.sin(0.5)], [math.sin(0.5), math.cos(0.5)]])
        # On the sensor in its own axes; on the array as its shadow, 1.7 mm behind it.
        centre = np.array([0.4, -0.3])
        if site is BlemishSite.ARRAY:
            centre = (turn @ centre + (0.2, 0.1)) * 125.0 / 123.3
        dark = np.hypot(*(landed_points.position - centre).T) < 0.6 * (
            125.0 / 123.3 if site is BlemishSite.ARRAY else 1.0
        )
        assert dark.sum() > 10
        np.testing.assert_array_equal(landed_points.weight == 0.0, dark)


def test_rays_that_dust_stops_have_landed():
    everywhere = Blemishes(BlemishSite.ARRAY, [(0.0, 0.0)], [(0.0, 0.0)], radius=50.0, transmission=0.0)
    spread = point_spread(camera_with(blemishes=(everywhere,)), POINT, rays=1 << 12)
    assert spread.light == 0 and not spread.image.any() and np.isnan(spread.centroid).all()
    assert spread.fates == point_spread(camera_with(), POINT, rays=1 << 12).fates


def test_what_dims_nothing_changes_nothing():
    clear = tuple(Blemishes(site, [POINT[:2]], [(0.0, 0.0)], radius=30.0, transmission=1.0) for site in BlemishSite)
    clear += (Blemishes(BlemishSite.SENSOR, [], [], [], []),)
    clear = camera_with(blemishes=clear, pixels={"angular_response": AngularResponse(), "pixel_aperture": (1, 1)})
    spread, plain = (point_spread(camera, POINT, rays=1 << 12) for camera in (clear, camera_with()))
    np.testing.assert_allclose(spread.image, plain.image, rtol=1e-13)


def test_projections_leave_out_what_dims():
    dusty = Blemishes.scattered(BlemishSite.ARRAY, half_size=(3.0, 3.0), dust_per_mm2=40.0, dust_radius=0.03)
    pixels = {"pixel_aperture": (0.5, 0.5), "angular_response": AngularResponse(well_depth=3.0)}
    plain = pl.project(camera_with(), POINT, rays=256)
    assert plain == pl.project(camera_with(blemishes=(dusty,), pixels=pixels), POINT, rays=256)


def mask(cells, size):
    return MaskStop.of_cells(np.asarray(cells, dtype=float), size)


def test_a_mask_of_one_half_halves_the_light_and_moves_nothing():
    clear, grey = (point_spread(camera_with(stop=mask([[t]], 8.0)), POINT, rays=1 << 13) for t in (1.0, 0.5))
    # Products with 0.5 are exact.
    np.testing.assert_array_equal(grey.image, 0.5 * clear.image)
    np.testing.assert_array_equal(grey.centroid, clear.centroid)
    assert grey.light == 0.5 * clear.light and grey.fates == clear.fates


def test_the_centroid_of_greys_is_that_of_their_light():
    """Through the microlens on the axis, 123.3 mm behind the iris and without a main lens, it lands at -b / D of it."""
    # Two squares of 4 mm, column 0 at negative x and row 0 at positive y: (1 (-2) + 0.5 (2)) / 1.5 = -2/3 mm. A wedge
    # of n cells of transmission (k + 1/2) / n: the mean of x is w / 6 (1 - 1 / n^2) for the width w = 8. cos^4 varies
    # by 2 (4 / 123.3)^2 over the iris, which is 2e-3 of 0.011 mm; edges are found to 8 / 23 / 2^8 mm of it: 2e-5 mm.
    wedges = [np.tile((np.arange(n) + 0.5) / n, (n, 1)) for n in (3, 100)]
    for cells, size, x, y, atol in (
        *(([[0.5], [1.0]], 4.0, 0.0, -2 / 3, 5e-5), ([[1.0, 0.5]], 4.0, -2 / 3, 0.0, 5e-5)),
        *((wedge, 8.0 / len(wedge), 8 / 6 * (1 - 1 / len(wedge) ** 2), 0.0, 0.02 * PIXEL) for wedge in wedges),
    ):
        camera = camera_with(2.0, lens=the_lens(mask(cells, size), pl.LensModel.NONE))
        # Of hexagons, whose variance along x and y is 5 pitch^2 / 72.
        offsets = moment_points(np.full(2, 5.0 * camera.microlenses.pitch**2 / 72.0))
        centroid = centroids_at(array_axes(camera), camera.microlenses, np.zeros((1, 2)), 0.5, offsets)[0]
        np.testing.assert_allclose(centroid, -2.0 / 123.3 * np.array([x, y]), atol=atol)


def test_the_corner_sees_what_is_left_of_the_light_of_the_iris():
    bare = GAUSS.with_model(pl.LensModel.NONE)
    # A second mask dims to a half what the iris lets through, whatever the iris is.
    for stop in (pl.CircularStop(5.0), mask([[1.0, 0.5]], 4.0)):
        dimmed = bare.with_stop(stop).inserted(mask([[0.5]], 40.0), 5.0)
        assert corner_light(dimmed, (2.0, 1.0), 123.3, 587.6)[0] == pytest.approx(0.5, rel=1e-12)
    # Half shut just behind the iris: the clear half lets 1 of 1.5 pass. 15 points across: 7 or 8 in one half.
    shut = bare.with_stop(mask([[1.0, 0.5]], 4.0)).inserted(mask([[1.0, 0.0]], 4.0), 1e-3)
    assert corner_light(shut, (2.0, 1.0), 123.3, 587.6)[0] == pytest.approx(2 / 3, abs=0.06)
