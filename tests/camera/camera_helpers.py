"""Helpers for tests of cameras: the reference camera with other parts, its images, rays in blocks for kernels."""

import dataclasses
import math

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.core.kernels.ray_blocks import BLOCK

CAMERA, GAUSS = pl.camera.example_camera(), pl.load_lens("double-gauss-100mm-f2")


def the_lens(stop=5.0, model=pl.LensModel.EXACT):
    return GAUSS.with_stop(pl.CircularStop(stop) if isinstance(stop, float) else stop).with_model(model)


def camera_with(
    b=1.7, stop=5.0, shape=(512, 512), lens=None, moved=(), pixels=None, blemishes=(), to_array=123.3, **array
):
    """The camera of the reference scenes with another array; `moved` are parts with their shift and tilt."""
    lens, sensor = the_lens(stop) if lens is None else lens, pl.Sensor(shape, 0.010, **(pixels or {}))
    array = pl.MicrolensArray(**({"pitch": 0.217, "focal_lengths": (2.0,)} | array))
    camera = pl.PlenopticCamera(lens, sensor, to_array, array, b, blemishes=blemishes)
    for part, shift, tilt in moved:
        camera = camera.moved(part, shift=shift, tilt=tilt)
    return camera


def bare_camera(lens=None, z=134.6, shape=(512, 512), pitch=0.010):
    lens = the_lens() if lens is None else lens
    return pl.PlenopticCamera(lens=lens, sensor=pl.Sensor(shape=shape, pixel_pitch=pitch), stop_to_microlenses=z)


def with_array(camera, **changes):
    return dataclasses.replace(camera, microlenses=dataclasses.replace(camera.microlenses, **changes))


def in_world(camera, points):
    return np.asarray(points, dtype=float) if camera.pose is None else camera.pose.to_world(points)


def compiled_anew(camera):
    """Copy of a camera that is compiled again: the cache compares parts by identity."""
    return dataclasses.replace(camera, sensor=dataclasses.replace(camera.sensor))


def refused(message):
    return pytest.raises(pl.errors.InvalidValueError, match=message)


def white(camera, samples=64, region=None, seed=0):
    return pl.render_white(camera, samples=samples, region=region, seed=seed, progress=False)


def total(shot, region=np.s_[:]):
    """Sum over the pixels and its standard error."""
    return float(shot.image[region].sum(dtype=float)), float(np.linalg.norm(shot.standard_error[region].astype(float)))


def agree(a, b, factor=1.0, relative=0.0, region=np.s_[:], case=None):
    """Totals within 4 joint standard errors; single pixels at the rims of images have no honest error of their own."""
    (sum_a, error_a), (sum_b, error_b) = total(a, region), total(b, region)
    assert abs(sum_a - factor * sum_b) < 4 * math.hypot(error_a, factor * error_b) + relative * sum_a, case


def pairs(one, other):
    """Rows of the microlenses that both know."""
    first, second = ({tuple(index): row for row, index in enumerate(each.index.tolist())} for each in (one, other))
    common = sorted(first.keys() & second.keys())
    return [first[key] for key in common], [second[key] for key in common]


def in_blocks(rows):
    """Values (8, n) of rays as kernels take them: in blocks, the last one filled up with the last ray."""
    filled = np.pad(rows, ((0, 0), (0, -rows.shape[1] % BLOCK)), mode="edge")
    return np.ascontiguousarray(filled.reshape(8, -1, BLOCK).transpose(1, 0, 2)).reshape(-1)


def out_of_blocks(blocks, n):
    return np.concatenate(list(blocks.reshape(-1, 8, BLOCK)), axis=1)[:, :n]
