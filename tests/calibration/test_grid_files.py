"""Lattices of micro images in files of other programs: what is written is read again."""

import json

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.errors import FileError, InvalidValueError

HEXAGONAL, SQUARE, RECTANGULAR = pl.Lattice.HEXAGONAL, pl.Lattice.SQUARE, pl.Lattice.RECTANGULAR
SHAPE = (300, 400)


def a_grid(lattice, degrees, pitches=(20.0, 20.0), **more):
    steps = {HEXAGONAL: ((0.0, -1.0), (np.sqrt(0.75), -0.5)), SQUARE: ((0, -1), (1, 0)), RECTANGULAR: ((0, -1), (1, 0))}
    angle = np.radians(degrees)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    basis = np.array(steps[lattice]) * np.array(pitches)[:, None] @ turn
    return pl.calibration.MicroImageGrid(lattice, origin=(133.3, 210.7), basis=basis, shape=SHAPE, **more)


def test_written_lattices_are_read_again(tmp_path):
    """Of hexagonal ones, by both formats; all micro images come back."""
    pattern = [[0, 1, 2], [2, 0, 1], [1, 2, 0]]
    cases = [("xml", HEXAGONAL, angle, {"type_pattern": pattern}) for angle in (0.5, 29.0, -77.0, 140.0)]
    cases += [(ending, HEXAGONAL, angle, {}) for ending in ("json", "xml") for angle in (0.5, 29.0, -77.0, 140.0)]
    cases += [("xml", HEXAGONAL, 29.0, {"type_pattern": np.minimum(pattern, 1)})]
    cases += [("json", SQUARE, 91.0, {}), ("json", RECTANGULAR, -3.0, {"pitches": (24.0, 18.0)})]
    for ending, lattice, degrees, more in cases:
        grid, path = a_grid(lattice, degrees, **more), tmp_path / f"grid.{ending}"
        pl.calibration.write_grid(path, grid)
        again = pl.calibration.read_grid(path, SHAPE)
        assert again.lattice is lattice, (ending, degrees)
        first, second = (each.centres_of(each.on_sensor) for each in (grid, again))
        order = [np.lexsort(np.round(each, 6).T) for each in (first, second)]
        np.testing.assert_allclose(second[order[1]], first[order[0]], atol=1e-10)
        assert again.type_pattern.max() == grid.type_pattern.max(), (ending, degrees)
        # Types get other numbers.
        kinds = [each.types_of(each.on_sensor)[k].tolist() for each, k in zip((grid, again), order, strict=True)]
        assert len(set(zip(*kinds, strict=True))) == int(grid.type_pattern.max()) + 1


def test_the_grid_model_begins_at_the_upper_left(tmp_path):
    for degrees in (0.4, 29.7):
        grid = a_grid(HEXAGONAL, degrees)
        pl.calibration.write_grid(tmp_path / "grid.json", grid)
        model = json.loads((tmp_path / "grid.json").read_text())["LensletGridModel"]
        assert model["Orientation"] == ("horz" if degrees < 15 else "vert")
        # As the Toolbox builds its grid; pixels count from 1.
        v, u = np.mgrid[0 : model["VMax"], 0 : model["UMax"]]
        along = model["HSpacing"] * u.astype(float)
        along[model["FirstPosShiftRow"] - 1 :: 2] += 0.5 * model["HSpacing"]
        place = along + 1j * model["VSpacing"] * v
        place = place * np.exp(1j * model["Rot"]) + model["HOffset"] + 1j * model["VOffset"]
        pixel = np.stack([place.imag, place.real] if degrees < 15 else [place.real, place.imag], axis=-1) - 1.0
        np.testing.assert_allclose(grid.centres_of(grid.indices_of(pixel)), pixel, atol=1e-10)
        assert np.abs(place[0, 0]) < 1.5 * grid.pitch and len(pixel) * pixel.shape[1] >= len(grid.on_sensor)


def test_what_formats_do_not_have_is_refused(tmp_path):
    for name, grid, sentence in (
        ("a.txt", a_grid(SQUARE, 0.0), "must end in .xml or .json"),
        ("a.xml", a_grid(SQUARE, 0.0), "the lattice is SQUARE"),
        ("a.xml", a_grid(HEXAGONAL, 0.0, type_pattern=[[0, 1]]), "do not repeat every three lenses"),
        ("a.json", pl.calibration.MicroImageGrid(SQUARE, origin=(0, 0), basis=[(0, -20), (20, 1)], shape=SHAPE),
         "sheared"),
    ):  # fmt: skip
        with pytest.raises(InvalidValueError, match=sentence):
            pl.calibration.write_grid(tmp_path / name, grid)
    for text in ("{}", '{"LensletGridModel": {"HSpacing": 3}}', '{"LensletGridModel": 1}', "{"):
        (tmp_path / "wrong.json").write_text(text)
        with pytest.raises(FileError, match=r"wrong.json' holds no lattice"):
            pl.calibration.read_grid(tmp_path / "wrong.json", SHAPE)
