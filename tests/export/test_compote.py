"""What is written for COMPOTE, projected by a port of its camera model, is what this package projects."""

import dataclasses
import json

import numpy as np
import pytest
import small_calibration
from raws import focused, nearest

import plenoptic as pl
from plenoptic.errors import InvalidValueError

BOARD = pl.targets.checkerboard(5, 4, square=3.0)
BOARDS = (BOARD.translated(z=-404.0), BOARD.rotated_deg((1, 2, 0), 25).translated(2.0, -1.0, -330.0))


def a_camera(lattice=pl.Lattice.HEXAGONAL, degrees=0.0, model=pl.LensModel.THIN, z=0.0):
    pinholes = {"focal_lengths": (2.0,), "lattice": lattice, "model": pl.optics.MicrolensModel.PINHOLE}
    camera = focused((180, 220), **pinholes)
    camera = dataclasses.replace(camera, lens=camera.lens.with_model(model))
    camera = camera.moved(pl.CameraPart.MICROLENSES, shift=(0.031, -0.05, 0.0), tilt=(0.0, 0.0, np.radians(degrees)))
    return camera.posed(position=(0, 0, z), look_at=(0, 0, z - 400), up=(0.1, 1, 0))


def pose(found):
    return np.array(found["rotation"]), np.array(found["translation"])[0]


def in_frame(found, points):
    rotation, translation = pose(found)
    return (points - translation) @ rotation


def nodes(mesh):
    """Places of all nodes of a mesh by (column, row) in the frame around it."""
    columns, rows = np.meshgrid(np.arange(mesh["width"]), np.arange(mesh["height"]), indexing="ij")
    (along, down), height = mesh["pitch"][0], np.sqrt(0.75)
    flat = [(columns, rows), (columns + 0.5 * (rows % 2 == 0), rows * height),
            (columns * height, rows - 0.5 * (columns % 2))][mesh["geometry"]]  # fmt: skip
    flat = np.stack(flat, axis=-1) * [along, down]
    rotation, translation = pose(mesh["pose"])
    flat = np.concatenate([flat, np.zeros((*columns.shape, len(translation) - 2))], axis=-1)
    return flat @ rotation.T + translation


def projected(inner, camera_pose, point, i, j):
    """(u, v) of a world point through the lens of micro-image (i, j)."""
    x, y, z = in_frame(camera_pose, point)
    focal = inner["main_lens"]["f"]
    image = np.array([x, y, z]) * focal / (focal - z)
    mesh = inner["mla"]["mesh"]
    lens = nodes(mesh)[mesh["width"] - 1 - i, mesh["height"] - 1 - j]
    start, end = (in_frame(inner["sensor"]["pose"], place) for place in (image, lens))
    x, y, _ = start + (end - start) * start[2] / (start[2] - end[2])
    sensor = inner["sensor"]
    return sensor["width"] - 1 - x / sensor["scale"], sensor["height"] - 1 - y / sensor["scale"]


def written(folder, camera, **more):
    shot = pl.Exposure(np.ones((*camera.sensor.shape, 1)), camera=camera)
    pl.export.compote(folder, shot, shot, **more)
    return {path.stem: json.loads(path.read_text()) for path in folder.glob("*.js")}


def table(path):
    return np.genfromtxt(path, delimiter=",", names=True)


def test_its_model_projects_as_ours(tmp_path):
    hexagonal, square = pl.Lattice.HEXAGONAL, pl.Lattice.SQUARE
    for case in (
        *((hexagonal, 0.0, 30.0), (hexagonal, 33.0, 0.0), (hexagonal, -87.0, 30.0)),
        *((square, 4.0, 30.0), (square, -87.0, 0.0)),
    ):
        lattice, degrees, z = case
        folder = tmp_path / f"{lattice.name} {degrees}"
        said = written(folder, a_camera(lattice, degrees, z=z), targets=BOARDS)
        seen = table(folder / "features.csv")
        assert len(seen) > 100 and set(seen["frame"]) == {0, 1}, case
        poses = {entry["frame"]: entry["pose"] for entry in said["poses"]["poses"]}
        for row in seen[:: len(seen) // 25]:
            frame, i, j = (int(row[name]) for name in ("frame", "k", "l"))
            board = said["scene"]["checkerboards"][frame]
            place, rotation = pose(board["pose"])[1], pose(board["pose"])[0]
            corner = divmod(int(row["cluster"]), board["x_grid"])
            point = place + rotation @ [corner[1] * board["lph"], corner[0] * board["lph"], 0.0]
            np.testing.assert_allclose(point, board["points"][int(row["cluster"])], atol=1e-9)
            u, v = projected(said["intrinsics"], poses[frame], point, i, j)
            assert abs(u - row["u"]) < 1e-9 and abs(v - row["v"]) < 1e-9, case


def test_meshes_are_where_the_images_are(tmp_path):
    for degrees in (0.0, 4.0, 33.0):
        camera = a_camera(degrees=degrees, model=pl.LensModel.EXACT)
        said = written(tmp_path / str(degrees), camera)
        mesh, centres = said["camera"]["mia"]["mesh"], table(tmp_path / str(degrees) / "centres.csv")
        assert mesh["height"] % 2 == 0 and len(centres) == mesh["width"] * mesh["height"]
        ideal = nodes(mesh)[centres["k"].astype(int), centres["l"].astype(int)]
        # Aberrations of the pupil.
        assert np.abs(ideal - np.column_stack([centres["u"], centres["v"]])).max() < 0.03, degrees
        pixels = pl.microlens_centres(camera).pixel
        turned = said["camera"]["sensor"]["width"] != camera.sensor.shape[1]
        places = np.column_stack([centres["v"], centres["u"]])
        if turned:
            places = np.column_stack([centres["u"], camera.sensor.shape[1] - 1 - centres["v"]])
        assert nearest(places, pixels).max() < 1e-9, degrees


def test_the_real_lens_stays_in_the_observations(tmp_path):
    said = written(tmp_path, a_camera(model=pl.LensModel.EXACT), targets=BOARDS)
    seen = table(tmp_path / "features.csv")
    rest = []
    for row in seen[:: len(seen) // 25]:
        point = np.array(said["scene"]["checkerboards"][int(row["frame"])]["points"][int(row["cluster"])])
        u, v = projected(said["intrinsics"], said["poses"]["poses"][0]["pose"], point, int(row["k"]), int(row["l"]))
        rest.append(np.hypot(u - row["u"], v - row["v"]))
    assert 1e-4 < np.median(rest) < 0.5


def test_what_it_needs(tmp_path):
    camera = a_camera()
    part = pl.Exposure(np.ones((40, 50, 1)), camera=camera, region=(0, 40, 0, 50))
    with pytest.raises(InvalidValueError, match="images are of a region"):
        pl.export.compote(tmp_path, part, part)
    whole = pl.Exposure(np.ones((180, 220, 1)), camera=camera)
    stopped = dataclasses.replace(camera, lens=camera.lens.with_stop(pl.CircularStop(semi_diameter=3.0)))
    pl.export.compote(tmp_path, whole, whole, other_whites=[dataclasses.replace(whole, camera=stopped)])
    whites = json.loads((tmp_path / "images.js").read_text())["whites"]
    assert len(whites) == 2 and whites[1]["fnumber"] == pytest.approx(2 * whites[0]["fnumber"])
    with pytest.raises(InvalidValueError, match="without a camera"):
        pl.export.compote(tmp_path, whole, whole, other_whites=[pl.Exposure(np.ones((180, 220, 1)))])
    lens = pl.optics.window(camera.lens, 8.0, pl.glass("N-BK7"), distance=20.0, outside=pl.ConstantMedium(1.333))
    wet = pl.Exposure(np.ones((180, 220, 1)), camera=dataclasses.replace(camera, lens=lens))
    board = pl.targets.checkerboard(3, 3, square=1.0).translated(z=-404)
    with pytest.raises(InvalidValueError, match="in a medium of 1.333 times the rear index, .* leave targets out"):
        pl.export.compote(tmp_path, wet, wet, targets=board)


@pytest.mark.parametrize(("lattice", "degrees"), [(pl.Lattice.HEXAGONAL, d) for d in (0.4, 29.0, 171.0)]
                         + [(pl.Lattice.SQUARE, d) for d in (88.0,)])  # fmt: skip
def test_calibrations_project_as_they_were_fitted_and_observations_come_back(tmp_path, lattice, degrees):
    calibration, observations = (
        make(lattice, degrees) for make in (small_calibration.calibration, small_calibration.observations)
    )
    pl.export.compote_calibration(tmp_path, calibration, observations)
    said = {path.stem: json.loads(path.read_text()) for path in tmp_path.glob("*.js")}
    (board,) = said["scene"]["checkerboards"]
    poses = {entry["frame"]: entry["pose"] for entry in said["poses"]["poses"]}
    seen = table(tmp_path / "features.csv")
    fitted = observations.pixel + calibration.corner_residual
    for number in range(0, len(seen), len(seen) // 25):
        frame, cluster, k, l = (int(seen[name][number]) for name in ("frame", "cluster", "k", "l"))  # noqa: E741
        u, v = projected(said["intrinsics"], poses[frame], np.array(board["points"][cluster]), k, l)
        assert np.abs(np.array([v, u]) - fitted[number]).max() < 1e-9
    mesh, centres = said["camera"]["mia"]["mesh"], table(tmp_path / "centres.csv")
    assert mesh["geometry"] == (
        0 if lattice is pl.Lattice.SQUARE else 2 if abs(degrees % 60) in (0.4, 58.0, 51.0) else 1
    )
    ideal = nodes(mesh)[centres["k"].astype(int), centres["l"].astype(int)]
    assert np.abs(ideal - np.column_stack([centres["u"], centres["v"]])).max() < 0.05
    assert (board["x_grid"], board["y_grid"], board["lph"]) == (5, 4, pytest.approx(3.0, rel=0.01))
    # Read again, only the numbers of the microlenses differ, by a symmetry of the lattice.
    files = [tmp_path / name for name in ("camera.js", "features.csv", "centres.csv")]
    again = pl.calibration.read_compote(*files, board_columns=5, square=3.0)
    for name in ("pixel", "frame", "point", "blur", "centre_pixel"):
        np.testing.assert_array_equal(getattr(again, name), getattr(observations, name))
    np.testing.assert_allclose(again.board, observations.board, atol=1e-12)
    both = [np.concatenate([each.centre_index, each.index]) for each in (observations, again)]
    table_of_ones = np.column_stack([both[0], np.ones(len(both[0]))])
    turn = np.linalg.lstsq(table_of_ones, both[1], rcond=None)[0]
    np.testing.assert_allclose(table_of_ones @ turn, both[1], atol=1e-9)
    assert abs(np.linalg.det(turn[:2]) - 1.0) < 1e-9


def test_other_observations_are_refused(tmp_path):
    calibration, observations = small_calibration.calibration(), small_calibration.observations()
    fewer = dataclasses.replace(observations, centre_index=observations.centre_index[1:],
                                centre_pixel=observations.centre_pixel[1:])  # fmt: skip
    with pytest.raises(InvalidValueError, match="not those of the calibration"):
        pl.export.compote_calibration(tmp_path, calibration, fewer)
