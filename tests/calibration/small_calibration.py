"""A small calibration, its observations, and a lattice of micro images with measured centres."""

from functools import cache

import numpy as np

import plenoptic as pl


@cache
def observations(lattice=pl.Lattice.HEXAGONAL, degrees=0.0):
    """Of four boards, with blur and errors, by an array that is turned."""
    camera = pl.PlenopticCamera(
        lens=pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(5.0)).with_model(pl.LensModel.THIN),
        microlenses=pl.MicrolensArray(0.4, (2.0,), lattice),
        sensor=pl.Sensor(shape=(350, 400), pixel_pitch=0.02),
        stop_to_microlenses=156.0,
        microlenses_to_sensor=3.0,
    ).moved(pl.CameraPart.MICROLENSES, shift=(0.07, -0.05, 0.0), tilt=(2e-3, -1e-3, np.radians(degrees)))
    design = pl.targets.checkerboard(6, 5, square=3.0)
    axes = (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)
    boards = [design.rotated_deg(axis, 25).translated(z=-380) for axis in axes]
    corners, centres = pl.package.calibration_points(camera, boards), pl.microlens_centres(camera)
    rng = np.random.default_rng(1)
    pixel = corners.pixel + 0.02 * rng.standard_normal(corners.pixel.shape)
    centre = centres.pixel + 0.01 * rng.standard_normal(centres.pixel.shape)
    blur = np.where(corners.point % 2, corners.blur, -corners.blur)
    return pl.calibration.Observations(
        corners.index, pixel, corners.frame, corners.point, design.points - design.points[0],
        centres.index, centre, camera.sensor, lattice, blur,
    )  # fmt: skip


@cache
def calibration(lattice=pl.Lattice.HEXAGONAL, degrees=0.0):
    """Of these observations, with a free board."""
    return pl.calibrate(observations(lattice, degrees), start=pl.calibration.NominalCamera(100.0, 8.0), board=0.005)


def grid(offset=(0.0, 0.0)):
    """Lattice of three types whose measured centres are all displaced."""
    plain = pl.calibration.MicroImageGrid(
        pl.Lattice.HEXAGONAL, origin=(80.0, 100.0), basis=[(0.0, -20.0), (17.32, -10.0)], shape=(160, 240),
        type_pattern=[[0, 1, 2], [2, 0, 1], [1, 2, 0]],
    )  # fmt: skip
    index = plain.on_sensor
    return pl.calibration.MicroImageGrid(
        plain.lattice, origin=plain.origin, basis=plain.basis, shape=plain.shape, index=index,
        centre=plain.centres_of(index) + offset, radius=np.full(len(index), 8.5), type_pattern=plain.type_pattern,
    )  # fmt: skip
