"""Files of COMPOTE: lattice indices, sides of the board, and what is refused."""

import json
import math

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.optics.microlens.lattice import lattice_basis

HEADING = "k,l,u,v,rho,cluster,frame\n"


def write(folder, geometry, corners, centres):
    camera = {"mia": {"mesh": {"geometry": geometry}}, "sensor": {"scale": 0.01, "width": 90, "height": 60}}
    (folder / "camera.js").write_text(json.dumps(camera))
    (folder / "corners.csv").write_text(HEADING + "\n".join(",".join(map(str, row)) for row in corners))
    (folder / "centres.csv").write_text("k,l,u,v\n" + "\n".join(",".join(map(str, row)) for row in centres))
    return [folder / name for name in ("camera.js", "corners.csv", "centres.csv")]


def place(geometry, k, l):  # noqa: E741
    """Pixel u, v of the micro image (k, l) in pitches, as libpleno places it."""
    if geometry == 0:
        return k, l
    if geometry == 1:
        return k + 0.5 * (l % 2 == 0), l * math.sqrt(3) / 2
    return k * math.sqrt(3) / 2, l - 0.5 * (k % 2)


@pytest.mark.parametrize("geometry", [0, 1, 2])
def test_indices_place_micro_images_as_the_lattice_does(tmp_path, geometry):
    pairs = [(k, l) for k in range(5) for l in range(6)]  # noqa: E741
    centres = [(*pair, *place(geometry, *pair)) for pair in pairs]
    observations = pl.calibration.read_compote(
        *write(tmp_path, geometry, [(1, 2, 3.0, 4.0, 1.0, 0, 0)], centres), board_columns=3, square=2.0
    )
    on_array = observations.centre_index @ lattice_basis(observations.lattice, (1.0, 1.0))
    # On the sensor x runs against columns, y along rows: a rotation and a shift are between them.
    on_sensor = observations.centre_pixel[:, ::-1] * [-1.0, 1.0]
    a, b = on_array - on_array.mean(axis=0), on_sensor - on_sensor.mean(axis=0)
    turn = np.linalg.lstsq(a, b, rcond=None)[0]
    np.testing.assert_allclose(a @ turn, b, atol=1e-12)
    np.testing.assert_allclose(turn @ turn.T, np.eye(2), atol=1e-12)
    assert np.linalg.det(turn) > 0
    assert observations.pixel.tolist() == [[4.0, 3.0]] and observations.sensor.shape == (60, 90)


@pytest.mark.parametrize("flipped", [False, True])
def test_the_board_shows_its_face(tmp_path, flipped):
    """Pictures are upright: y of the board runs against rows of pixels."""
    corners = [(0, 0, 10.0 * (c % 3), (1 - 2 * flipped) * 7.0 * (c // 3), 1.0, c, 4) for c in range(6)]
    corners += [(0, 0, 1.0, 1.0, 0.0, -1, 4)]
    files = write(tmp_path, 1, corners, [(0, 0, 1.0, 1.0)])
    observations = pl.calibration.read_compote(*files, board_columns=3, square=2.0)
    assert len(observations.pixel) == 6, "corners without a cluster are left out"
    assert observations.board[:, 0].tolist() == [0, 2, 4, 0, 2, 4]
    assert observations.board[3, 1] == (2.0 if flipped else -2.0)


def test_other_files_are_refused_with_their_name(tmp_path):
    files = write(tmp_path, 1, [(1, 2, 3.0, 4.0, 1.0, 0, 0)], [(1, 2, 3.0, 4.0)])
    for k, text in enumerate(("{}", "k,l\n1,2", "k,l,u,v\n1,2,x,4")):
        before = files[k].read_text()
        files[k].write_text(text)
        with pytest.raises(pl.errors.FileError, match=files[k].name):
            pl.calibration.read_compote(*files, board_columns=3, square=2.0)
        files[k].write_text(before)
    with pytest.raises(pl.errors.FileError, match="absent.js"):
        pl.calibration.read_compote(tmp_path / "absent.js", *files[1:], board_columns=3, square=2.0)


def test_observations_refuse_other_shapes():
    usual = {"index": [[0, 0]], "pixel": [[1.0, 2.0]], "frame": [3], "point": [0], "board": [[0.0, 0.0, 0.0]]}
    usual |= {"centre_index": [[0, 0]], "centre_pixel": [[1.0, 1.0]], "sensor": pl.Sensor((4, 4), 0.01)}
    observations = pl.calibration.Observations(**usual)
    assert observations == pl.calibration.Observations(**usual) and observations.frames.tolist() == [3]
    for changes, sentence in (
        ({"frame": [1, 2]}, "frame has shape"),
        ({"point": [1]}, "the board has 1 points"),
        ({"pixel": [[np.nan, 1.0]]}, "pixel"),
        ({"lattice": pl.Lattice.FREE}, "needs HEXAGONAL or SQUARE"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=sentence):
            pl.calibration.Observations(**(usual | changes))
