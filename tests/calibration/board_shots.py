"""Raw images of boards as a sensor's noise leaves them, and corners found in them."""

import functools

import numpy as np
from calibration_helpers import in_thin_axes, true_values

import plenoptic as pl
from plenoptic.calibration.fitting.geometry import project_views

_LIGHT = {"dark": pl.Emissive(0.05), "bright": pl.Emissive(0.8)}
"""As bright as boards of the usual paint below a white sky, but no paths are scattered."""
checkerboard = functools.partial(pl.targets.checkerboard, **_LIGHT)
marked_checkerboard = functools.partial(pl.targets.marked_checkerboard, **_LIGHT)
DESIGN = checkerboard(5, 4, square=3.0, margin=3.0)
PITCH = 0.0135


@functools.cache
def white_of(camera):
    return pl.render_white(camera, samples=16, progress=False)


@functools.cache
def shot_of(camera, *targets, samples=32):
    meshes = [mesh for target in targets for mesh in target.meshes]
    return pl.render(pl.Scene(meshes, background=1.0), camera, samples=samples, progress=False)


def raw_of(shot, camera, electrons=3000.0, seed=1):
    """Raw image in which white is this number of electrons."""
    level = float(np.percentile(white_of(camera).image, 95))
    sensor = pl.SensorModel(electrons / level, read_noise=4.0, gain=0.2, bits=14, full_well=60000.0, black_level=64)
    return shot.develop(sensor, seed=seed)


def blurred_shot(shot, sigma):
    """Image blurred by a normal distribution of a standard deviation in pixels."""
    steps = np.arange(-5, 6)
    kernel = np.exp(-0.5 * (steps / sigma) ** 2) / np.exp(-0.5 * (steps / sigma) ** 2).sum()
    image = np.squeeze(shot.image)
    for axis in (0, 1):
        image = sum(weight * np.roll(image, step, axis) for step, weight in zip(steps, kernel, strict=True))
    return pl.Exposure(image[..., None])


@functools.cache
def grid_of(camera):
    return pl.calibration.find_micro_images(raw_of(white_of(camera), camera, 20000.0))


def found(camera, *targets, design=DESIGN, electrons=3000.0, seed=1, with_white=True, samples=32):
    raw = raw_of(shot_of(camera, *targets, samples=samples), camera, electrons, seed)
    white = raw_of(white_of(camera), camera, 20000.0) if with_white else None
    return pl.calibration.find_corners(raw, grid_of(camera), design, white=white)


@functools.cache
def tilted(axis=(1.0, 0.2, 0.0), angle=25.0, z=-430.0, turn=0.0, design=DESIGN, shift=(0.0, 0.0)):
    return design.rotated_deg((0, 0, 1), turn).translated(*shift).rotated_deg(axis, angle).translated(z=z)


def projection_minus_corners(camera, corners, points):
    """Displacements in pixels by the formula of the thin lens; indices of grid and camera differ by a symmetry."""
    grid, centres = grid_of(camera), pl.microlens_centres(camera, progress=False)
    nearest = [np.hypot(*(centres.pixel - pixel).T).argmin() for pixel in grid.centre[::7]]
    table = np.column_stack([grid.index[::7], np.ones(len(nearest))])
    change = np.rint(np.linalg.lstsq(table, centres.index[nearest], rcond=None)[0])
    position = (corners.index @ change[:2] + change[2]) @ camera.microlenses.basis / camera.microlenses.pitch
    values = true_values(camera, None, pivot=(0, 0))
    return project_views(values, position, corners.pixel, in_thin_axes(camera, points), PITCH).pixel
