"""Cameras of the golden cases: the reference camera, and some that have everything else between them."""

import math

import numpy as np

import plenoptic as pl

SMALL = pl.Sensor((40, 40), 0.02)
GAUSS = pl.load_lens("double-gauss-100mm-f2")


def reference(*, to_sensor=1.7, semi_diameter=5.0, shape=(512, 512), **more):
    """Plenoptic 2.0 as it is; with to_sensor=2.0, semi_diameter=4.25 plenoptic 1.0."""
    array = pl.MicrolensArray(0.217, (2.0,), more.pop("lattice", pl.Lattice.HEXAGONAL))
    lens = GAUSS.with_stop(pl.CircularStop(semi_diameter))
    return pl.PlenopticCamera(lens, pl.Sensor(shape, 0.010), 123.3, array, to_sensor, **more)


def out_of_place():
    """Every part decentred, turned and tilted; imperfect microlenses of three types, dust, pixels that see angles."""
    lens = GAUSS.with_stop(pl.PolygonStop(6, 5.0, rotation=0.2, blade_radius=7.0))
    lens = lens.moved(slice(0, 2), shift=(0.05, -0.03, 0.02), tilt=(0.004, -0.003, 0.1))
    lens = lens.moved(8, tilt=(0.0, 0.002, 0.0))
    imperfect = pl.MicrolensImperfections(0.003, 0.002, 0.03, missing=0.05, dark=0.05, seed=3)
    round_ones = pl.optics.MicrolensAperture(pl.optics.ApertureShape.CIRCLE, 0.8, pl.optics.Gaps.OPAQUE)
    array = pl.MicrolensArray(0.217, (1.8, 2.0, 2.3), aperture=round_ones, imperfections=imperfect)
    angular = pl.sensor.AngularResponse(0.002, 1.5, pupil_distance=60.0, exponent=1.2)
    sensor = pl.Sensor((48, 40), 0.02, (0.9, 0.8), angular)
    camera = pl.PlenopticCamera(lens, sensor, 123.3, array, 1.7, blemishes=some_blemishes())
    camera = camera.moved(pl.CameraPart.LENS, shift=(0.1, -0.05, 0.03), tilt=(0.002, 0.001, 0.02))
    camera = camera.moved(pl.CameraPart.MICROLENSES, shift=(0.02, 0.01, -0.02), tilt=(0.006, -0.004, 0.03))
    camera = camera.moved(pl.CameraPart.SENSOR, shift=(-0.03, 0.02, 0.01), tilt=(-0.02, 0.03, -0.05))
    return camera.posed((6.0, -4.0, 3.0), (0.0, 0.0, -404.0), up=(0.1, 1.0, 0.0))


def some_blemishes():
    """On each site there is."""
    scattered, site, near = pl.Blemishes.scattered, pl.BlemishSite, {"half_size": (0.5, 0.5), "dust_radius": 0.02}
    return (
        scattered(site.SENSOR, **near, dust_per_mm2=30.0, height=0.4, seed=1),
        scattered(site.ARRAY, **near, dust_per_mm2=20.0, scratches=2, transmission=0.3, seed=2),
        scattered(site.LENS_REAR, half_size=(8.0, 8.0), dust_per_mm2=0.1, dust_radius=0.5, seed=3),
        pl.Blemishes(site.LENS_FRONT, [(-3.0, 1.0)], [(4.0, 2.0)], 0.4, 0.5),
    )


def free():
    """Listed microlenses of several types, some negative, some of them wrong, behind a thin lens with a star."""
    rng = np.random.default_rng(5)
    grid = np.stack(np.meshgrid(np.arange(-3, 4), np.arange(-3, 4)), axis=-1).reshape(-1, 2)
    centres = 0.2 * grid + rng.uniform(-0.03, 0.03, (len(grid), 2))
    moved = {"shift": [(0.01, 0.0), (0.0, -0.02), (0.005, 0.005)], "decentre": [(0.0, 0.004), (0.002, 0.0), (0.0, 0.0)]}
    weak = {"focal_length_factor": [1.1, math.inf, 0.9], "transmission": [0.5, 1.0, 0.7]}
    wrong = pl.optics.MicrolensDeviations(index=[(24, 0), (17, 0), (25, 0)], **moved, **weak)
    lens = GAUSS.with_stop(pl.StarStop(5, 6.0, 3.0, rotation=0.3)).with_model(pl.LensModel.THIN)
    listed = {"centres": centres, "types": np.arange(49) % 3, "imperfections": wrong}
    array = pl.MicrolensArray(0.4, (2.0, 1.7, -4.0), pl.Lattice.FREE, **listed)
    return pl.PlenopticCamera(lens, SMALL, 123.3, array, 1.7)


def spherical():
    """Exact plano-convex microlenses on squares, behind a paraxial lens with a mask."""
    rows, columns = np.mgrid[0:5, 0:6]
    lens = GAUSS.with_stop(pl.optics.MaskStop(((rows + 2 * columns) % 4) / 3.0, 6.0))
    plates = {"model": pl.optics.MicrolensModel.SPHERICAL, "thickness": 0.15, "pattern": [[0, 1], [1, 0]]}
    plates |= {"convex_side": pl.optics.ConvexSide.SENSOR}
    array = pl.MicrolensArray(0.217, (2.0, 1.8), pl.Lattice.SQUARE, **plates)
    return pl.PlenopticCamera(lens.with_model(pl.LensModel.PARAXIAL), SMALL, 123.3, array, 1.75)


def flat_high_index():
    """Flat microlenses of high index with clear gaps, behind an exact lens with aspheres."""
    square = pl.optics.MicrolensAperture(pl.optics.ApertureShape.SQUARE, 0.6, pl.optics.Gaps.CLEAR)
    flat = {"model": pl.optics.MicrolensModel.FLAT_HIGH_INDEX, "index": 1000.0, "thickness": 0.1, "aperture": square}
    return pl.PlenopticCamera(aspheric_lens(), SMALL, 82.0, pl.MicrolensArray(0.217, (2.0,), **flat), 1.8)


def pinholes():
    """Pinholes on rectangles."""
    array = pl.MicrolensArray((0.2, 0.3), (2.0,), pl.Lattice.RECTANGULAR, pl.optics.MicrolensModel.PINHOLE)
    return pl.PlenopticCamera(pl.load_lens("achromat-100mm-f4.4"), SMALL, 123.3, array, 1.7, wavelength=546.1)


def walled():
    """An array of cameras: microlenses between walls and no main lens."""
    array = pl.MicrolensArray(0.217, (1.7,), pl.Lattice.SQUARE, walls=pl.optics.Walls.OPAQUE)
    return pl.PlenopticCamera(pl.no_lens(20.0), SMALL, 5.0, array, 1.72)


def conventional(sensitivity=None):
    """No microlenses, and a tilted sensor."""
    camera = pl.PlenopticCamera(GAUSS, pl.Sensor((40, 48), 0.2), 134.624, sensitivity=sensitivity)
    return camera.moved(pl.CameraPart.SENSOR, tilt=(0.02, -0.01, 0.1))


def aspheric_lens():
    """Conics and even aspheres of catalogue glass: about 100 mm of focal length."""
    crown, flint = pl.glass("N-BK7"), pl.glass("F2")
    front = pl.Surface(62.0, 8.0, crown, semi_diameter=18.0, conic=-0.8, aspheric=(1e-6, -2e-10, 1e-13))
    middle = pl.Surface(-90.0, 3.0, flint, semi_diameter=18.0)
    back = pl.Surface(-400.0, 6.0, semi_diameter=18.0, conic=-3.0)
    behind = pl.Surface(150.0, 5.0, crown, semi_diameter=16.0, conic=0.4)
    last = pl.Surface(-300.0, semi_diameter=16.0, aspheric=(0.0, 3e-10))
    return pl.LensStack([front, middle, back, pl.CircularStop(8.0, 5.0), behind, last])
