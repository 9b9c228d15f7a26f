"""Raw images for exporters, and readers of other programs' files that know nothing of the package."""

import functools

import numpy as np

import plenoptic as pl

LENS = pl.load_lens("double-gauss-100mm-f2")


def camera(lattice=pl.Lattice.HEXAGONAL, shape=(140, 180), turned=0.0, **array):
    """Of plenoptic 1.0, micro images of 14.8 pixels; the array turned by so many radians."""
    lenses = pl.MicrolensArray(**{"pitch": 0.147, "focal_lengths": (1.2,), "lattice": lattice, **array})
    made = pl.PlenopticCamera(LENS.with_stop(pl.CircularStop(5.3)), pl.Sensor(shape, 0.01), 134.6, lenses, 1.2)
    return made.moved(pl.CameraPart.MICROLENSES, shift=(0.031, -0.022, 0.0), tilt=(0.0, 0.0, turned))


def focused(shape=(200, 260), **array):
    """Of plenoptic 2.0, Galilean."""
    lenses = pl.MicrolensArray(**{"pitch": 0.217, "focal_lengths": (1.7, 2.0, 2.4), **array})
    return pl.PlenopticCamera(LENS.with_stop(pl.CircularStop(6.0)), pl.Sensor(shape, 0.01), 123.3, lenses, 1.7)


def shots(taken_by, **settings):
    """A picture and the white image."""
    settings = {"progress": False, **settings}
    white = pl.render_white(taken_by, samples=16, seed=1, **settings)
    return pl.render(pl.check_scene(), taken_by, samples=8, **settings), white


@functools.cache
def plain_shots(lattice):
    """Those of the camera of a lattice."""
    return shots(camera(lattice))


def nearest(points, known):
    """For each of `points` the distance to the nearest of `known`."""
    return np.sqrt(((points[:, None] - known[None]) ** 2).sum(axis=2)).min(axis=1)
