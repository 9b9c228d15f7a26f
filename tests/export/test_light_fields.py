"""Decoded light fields as other programs read them."""

import configparser

import numpy as np
import pytest
from raws import camera, shots

import plenoptic as pl
from plenoptic.errors import InvalidValueError

SLANTED = pl.quad((-30, -30, 0), (60, 0, 0), (0, 60, 0), material=pl.Lambertian(0.5)).rotated_deg((0, 1, 0), 35)
SCENE = pl.Scene([SLANTED.translated(z=-404)], background=1)


@pytest.fixture(scope="module")
def fields():
    cameras = [camera(lattice).focused_at(z=-404.0) for lattice in (pl.Lattice.SQUARE, pl.Lattice.HEXAGONAL)]
    return [pl.lightfield.decode(*shots(taken_by), views=7) for taken_by in cameras]


def read_pfm(path):
    """The plane of a portable float map of one channel, little-endian, the highest row first."""
    kind, size, order, data = path.read_bytes().split(b"\n", 3)
    columns, rows = map(int, size.split())
    assert kind == b"Pf" and float(order) < 0
    return np.frombuffer(data, dtype="<f4").reshape(rows, columns)[::-1]


def hci_disparity(parameters, depth):
    """The benchmark's formula, from its documentation."""
    inner, outer = parameters["intrinsics"], parameters["extrinsics"]
    focal, sensor = float(inner["focal_length_mm"]), float(inner["sensor_size_mm"])
    size = max(int(inner["image_resolution_x_px"]), int(inner["image_resolution_y_px"]))
    beta = float(outer["baseline_mm"]) * focal * size
    focus = 1000 * float(outer["focus_distance_m"])
    return (beta * focus / (1000 * depth) - beta) / (focus * sensor)


def test_the_benchmark_gets_what_it_reads(tmp_path, fields):
    for field in fields:
        folder = tmp_path / field.camera.microlenses.lattice.name
        pl.export.hci(folder, field, scene=SCENE)
        parameters = configparser.ConfigParser()
        parameters.read(folder / "parameters.cfg")
        assert parameters["extrinsics"]["num_cams_x"] == "7"

        def plane(name, folder=folder):
            return read_pfm(folder / f"{name}.pfm")

        for number in (0, 6, 24, 48):
            u, v = number % 7 - 3, number // 7 - 3
            depth, disparity = (plane(f"gt_{name}_lowres_Cam{number:03d}") for name in ("depth", "disp"))
            np.testing.assert_allclose(disparity, hci_disparity(parameters, depth), atol=1e-3)
            truth = field.truth(SCENE, u, v, truth=pl.Truth.DEPTH).depth
            expected = np.array([[field.disparity_at(-z)[0] for z in row] for row in truth])
            np.testing.assert_allclose(disparity, expected, atol=1e-4)
            picture = pl.images.read_linear(folder / f"input_Cam{number:03d}.png")[:, :, :1]
            view = np.clip(np.nan_to_num(field.view(u, v)) / np.nanpercentile(field.views, 99.9), 0.0, 1.0)
            np.testing.assert_allclose(picture, view, atol=0.005)  # half a code of 8 bits where sRGB is steepest
        np.testing.assert_array_equal(plane("gt_disp_lowres"), plane("gt_disp_lowres_Cam024"))
        low, high = float(parameters["meta"]["disp_min"]), float(parameters["meta"]["disp_max"])
        assert low <= plane("gt_disp_lowres").min() and plane("gt_disp_lowres").max() <= high


def test_what_the_benchmark_does_not_know(tmp_path, fields):
    taken_by = camera(pl.Lattice.RECTANGULAR, pitch=(0.147, 0.16)).focused_at(z=-404.0)
    with pytest.raises(InvalidValueError, match="square pixels"):
        pl.export.hci(tmp_path, pl.lightfield.decode(*shots(taken_by), views=3))
    with pytest.raises(InvalidValueError, match="3 or more"):
        pl.export.hci(tmp_path, pl.lightfield.decode(*shots(fields[0].camera), views=1))
