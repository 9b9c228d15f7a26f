"""What the Light Field Toolbox, plenoptomos, light-field microscopy and JPEG Pleno read, by readers of their own."""

import dataclasses
import json
import shutil
import subprocess

import numpy as np
import pytest
from raws import camera, nearest, plain_shots, shots

import plenoptic as pl
from plenoptic.errors import FileError, InvalidValueError

h5py = pytest.importorskip("h5py")


@pytest.fixture(scope="module")
def hexagonal(tmp_path_factory):
    """A turned hexagonal array: camera, shot, white and a folder for the Toolbox."""
    taken_by = camera(pl.Lattice.HEXAGONAL, turned=0.004)
    shot, white = shots(taken_by)
    folder = tmp_path_factory.mktemp("toolbox")
    pl.export.lftoolbox(folder, shot, white, views=5)
    return taken_by, shot, white, folder


@pytest.fixture(scope="module")
def square():
    return camera(pl.Lattice.SQUARE), *plain_shots(pl.Lattice.SQUARE)


def test_matlab_sees_the_views_and_their_weights(hexagonal):
    _, shot, white, folder = hexagonal
    field = pl.lightfield.decode(shot, white, views=5)
    with h5py.File(folder / "shot__Decoded.mat", "r") as file:
        # MATLAB's axes are HDF5's in reverse order: (T, S, V, U, 4) there.
        found = file["LF"][()].transpose()
        assert file["LF"].attrs["MATLAB_class"] == b"uint16"
        assert file["LensletGridModel"].attrs["MATLAB_class"] == b"struct"
        text = file["LensletGridModel/Orientation"]
        assert bytes(text[()].tobytes()).decode("utf-16-le") == "horz" and text.attrs["MATLAB_class"] == b"char"
    assert (folder / "shot__Decoded.mat").read_bytes()[:10] == b"MATLAB 7.3"
    expected = field.views.transpose(1, 0, 2, 3, 4)
    known = np.isfinite(expected[..., 0])
    np.testing.assert_array_equal(found[..., 3] == 65535, known)
    scale = np.nanmax(field.views)
    np.testing.assert_allclose(found[..., 0][known] / 65535 * scale, expected[..., 0][known], atol=scale / 65535)
    again = pl.lightfield.read_lftoolbox(folder / "shot__Decoded.mat")
    np.testing.assert_allclose(again.views[..., :1] * scale, field.views, atol=scale / 65535)
    np.testing.assert_array_equal(np.isnan(again.views[..., :1]), np.isnan(field.views))


def lenslets(model):
    """The Toolbox's grid of lenslets from its model, (VMax, UMax, 2), x and y from 1."""
    v, u = np.mgrid[0 : int(model["VMax"]), 0 : int(model["UMax"])]
    along = model["HSpacing"] * u.astype(float)
    along[int(model["FirstPosShiftRow"]) - 1 :: 2] += 0.5 * model["HSpacing"]
    c, s = np.cos(model["Rot"]), np.sin(model["Rot"])
    down = model["VSpacing"] * v
    return np.stack([model["HOffset"] + c * along - s * down, model["VOffset"] + s * along + c * down], axis=-1)


def test_the_grid_model_finds_our_centres(hexagonal):
    taken_by, shot, _, folder = hexagonal
    model = json.loads((folder / "CalInfo.json").read_text())["LensletGridModel"]
    found = lenslets(model).reshape(-1, 2) - 1.0
    # The raw image is turned by a quarter: (row, column) to (columns - 1 - column, row).
    known = pl.microlens_centres(taken_by).pixel
    known = np.column_stack([known[:, 0], shot.image.shape[1] - 1 - known[:, 1]])
    # Chief rays of a real lens are no lattice to some thousandths of a pixel.
    assert len(found) > 80 and np.sqrt(np.mean(nearest(found, known) ** 2)) < 0.01


def test_the_matrix_holds_the_rays_of_the_views():
    """Points that pixels show lie on the rays that H has for their indices, if the lens is Gaussian."""
    taken_by = camera(pl.Lattice.SQUARE)
    taken_by = dataclasses.replace(taken_by, lens=taken_by.lens.with_model(pl.LensModel.PARAXIAL))
    white = pl.render_white(taken_by, samples=16, progress=False)
    field = pl.lightfield.decode(white, white, views=5)
    matrix = pl.export.to_lftoolbox.intrinsics(field)
    pupil = pl.paraxial.cardinal_points(taken_by.lens).entrance_pupil
    scene = pl.Scene([pl.quad((-200, -200, -330.0), (400, 0, 0), (0, 400, 0))])
    for u, v in ((0, 0), (2, -1), (-2, 2)):
        truth = field.truth(scene, u, v, truth=pl.Truth.POSITION | pl.Truth.STATE)
        rows, columns = np.nonzero(truth.state == pl.images.PixelState.SEEN)
        place = np.stack([np.full(len(rows), u + 3), np.full(len(rows), v + 3), columns + 1, rows + 1, 1 + 0 * rows])
        s, t, across, down, _ = matrix @ place
        seen = truth.position[rows, columns]
        depth = pupil - seen[:, 2]
        assert len(rows) > 50
        # Views look from between the pixels of the raw image at chief rays, which the closed form has in the middle.
        np.testing.assert_allclose(1e3 * s + depth * across, seen[:, 0], atol=0.05 * field.object_spacing[0])
        np.testing.assert_allclose(1e3 * t + depth * down, -seen[:, 1], atol=0.05 * field.object_spacing[1])


def test_the_matrix_gives_positions_to_the_views_of_a_file(tmp_path, hexagonal):
    taken_by, shot, white, folder = hexagonal
    field = pl.lightfield.decode(shot, white, views=5)
    path = folder / "shot__Decoded.mat"
    again = pl.lightfield.read_lftoolbox(path, intrinsics=folder / "CalInfo.json")
    pupil = pl.paraxial.cardinal_points(taken_by.lens).entrance_pupil
    assert again.z_focus == pytest.approx(field.z_focus - pupil, rel=1e-12)
    assert again.object_spacing == pytest.approx(field.object_spacing, rel=1e-12)
    # By tracing; aberrations alter it by 2e-4.
    for z in (-250.0, -600.0):
        assert again.disparity_at(z - pupil) == pytest.approx(field.disparity_at(z), rel=1e-3), z
    # Of another pair of planes (s, t) and (u, v) the rays, and so the positions, are the same.
    calibrated = json.loads((folder / "CalInfo.json").read_text())
    moved = np.eye(5)
    moved[0, 2] = moved[1, 3] = 0.123
    other = moved @ np.array(calibrated["EstCamIntrinsicsH"])
    (tmp_path / "moved.json").write_text(json.dumps({"EstCamIntrinsicsH": other.tolist()}))
    same = pl.lightfield.read_lftoolbox(path, intrinsics=tmp_path / "moved.json")
    assert same.z_focus == pytest.approx(again.z_focus, rel=1e-12)
    assert same.object_spacing == pytest.approx(again.object_spacing, rel=1e-12)
    np.testing.assert_allclose(same.exit_pupil, again.exit_pupil, rtol=1e-12)
    for wrong in ({}, {"EstCamIntrinsicsH": [[1.0]]}, {"EstCamIntrinsicsH": np.eye(5).tolist()}):
        (tmp_path / "wrong.json").write_text(json.dumps(wrong))
        with pytest.raises(FileError, match="holds no matrix EstCamIntrinsicsH"):
            pl.lightfield.read_lftoolbox(path, intrinsics=tmp_path / "wrong.json")


@pytest.mark.validation
def test_octave_loads_the_light_field(hexagonal):
    if shutil.which("octave-cli") is None:
        pytest.skip("Octave is not installed")
    folder = hexagonal[-1]
    script = (
        "load('shot__Decoded.mat'); printf('%s %s', class(LF), mat2str(size(LF))); "
        "printf(' %d %d %.9g', LF(2,3,4,5,1), LF(2,3,4,5,4), LensletGridModel.HSpacing);"
    )
    done = subprocess.run(["octave-cli", "--eval", script], cwd=folder, capture_output=True, text=True, timeout=120)
    with h5py.File(folder / "shot__Decoded.mat", "r") as file:
        held = file["LF"][()].transpose()
        spacing = float(file["LensletGridModel/HSpacing"][0, 0])
    size = "[" + " ".join(map(str, held.shape)) + "]"
    said = f"uint16 {size} {held[1, 2, 3, 4, 0]} {held[1, 2, 3, 4, 3]} {spacing:.9g}"
    assert said in done.stdout, done.stdout + done.stderr


def test_broken_files_of_the_toolbox_are_refused(tmp_path, hexagonal):
    content = (hexagonal[-1] / "shot__Decoded.mat").read_bytes()
    for number, wrong in enumerate((b"", b"MATLAB 5.0", content[:600], content[:-2000])):
        (tmp_path / f"{number}.mat").write_bytes(wrong)
        with pytest.raises(FileError, match="holds no light field LF"):
            pl.lightfield.read_lftoolbox(tmp_path / f"{number}.mat")


def test_plenoptomos_cuts_micro_images_where_they_are(tmp_path, square):
    taken_by, shot, white = square
    pl.export.plenoptomos(tmp_path / "a.vox", shot, white)
    found = pl.export.read_plenoptomos(tmp_path / "a.vox")
    numbers = found.numbers
    pixel = numbers["sensor/pixel_size"]
    # As its reader finds them: rows first.
    corner = (numbers["sensor/position"][:2] - numbers["micro_lenses_array/position"][:2]) / pixel
    pitch = numbers["micro_lens/physical_size"] / pixel
    rows, columns = (int(n) for n in numbers["micro_lenses_array/size"])
    row, column = np.mgrid[0:rows, 0:columns].reshape(2, -1)
    middle = corner + (np.column_stack([row, column]) + 0.5) * pitch - 0.5
    known = pl.microlens_centres(taken_by).pixel
    assert rows * columns > 80 and nearest(middle, known).max() < 0.1
    np.testing.assert_allclose(found.white / 65535, white.image[..., 0] / white.image.max(), atol=1e-5)
    assert found.mode == "raw" and found.dark is None
    assert numbers["main_lens/f1"] == pytest.approx(pl.paraxial.cardinal_points(taken_by.lens).efl)


def test_plenoptomos_gets_the_focal_length_in_the_medium_of_the_sensor(tmp_path):
    taken_by = camera(pl.Lattice.SQUARE)
    lens = pl.optics.window(taken_by.lens, 8.0, pl.glass("N-BK7"), distance=20.0, outside=pl.ConstantMedium(1.333))
    taken_by = dataclasses.replace(taken_by, lens=lens)
    pl.export.plenoptomos(tmp_path / "a.vox", *shots(taken_by))
    numbers = pl.export.read_plenoptomos(tmp_path / "a.vox").numbers
    # 1 / f = 1 / z1 + 1 / z0 with the apparent distance z0 = z / n of the plane imaged onto the array.
    points, plane = pl.paraxial.cardinal_points(lens), pl.paraxial.object_position(lens, taken_by.stop_to_microlenses)
    apparent = (points.front_principal - plane) / 1.333
    z1 = numbers["micro_lenses_array/position"][2]
    assert 1 / numbers["main_lens/f1"] == pytest.approx(1 / z1 + 1 / apparent, rel=1e-9)


def test_lattices_that_formats_do_not_know_are_refused(tmp_path, hexagonal):
    _, shot, white, _ = hexagonal
    for write in (pl.export.napari_lf, pl.export.pyolaf):
        with pytest.raises(InvalidValueError, match="square lattices of one focal length; this camera has HEXAGONAL"):
            write(tmp_path / "a", shot, white)
    with pytest.raises(InvalidValueError, match="hexagonal"):
        pl.export.plenoptomos(tmp_path / "a.vox", shot, white)
    (tmp_path / "b.vox").write_bytes(b"no file")
    with pytest.raises(FileError, match=r"no \.vox file"):
        pl.export.read_plenoptomos(tmp_path / "b.vox")


def test_microscopes_get_micrometres(tmp_path, square):
    taken_by, shot, white = square
    pl.export.napari_lf(tmp_path / "napari", shot, white)
    pl.export.pyolaf(tmp_path / "pyolaf", shot, white)
    said = json.loads((tmp_path / "napari" / "metadata.txt").read_text())["calibrate"]
    read = dict(line.split(": ") for line in (tmp_path / "pyolaf" / "config.yaml").read_text().splitlines())
    assert said["ulens_pitch"] == pytest.approx(147.0) == float(read["lensPitch"])
    assert said["pixel_size"] == pytest.approx(10.0) == float(read["pixelPitch"])
    assert (read["gridType"], read["focus"], read["plenoptic"]) == ("reg", "single", "1")
    larger = abs(pl.paraxial.magnification(taken_by.lens, float(taken_by.report().array_plane)))
    assert float(read["M"]) == pytest.approx(larger, rel=1e-6)
    raw = pl.images.read_linear(tmp_path / "napari" / "light_field.tif")
    np.testing.assert_allclose(raw[..., 0], shot.image[..., 0] / shot.image.max(), atol=1e-4)
    assert pl.images.read_linear(tmp_path / "napari" / "dark_frame.tif").max() == 0.0
    # pyolaf reads TIFFs as they are, and cannot work with three channels.
    assert pl.images.read_linear(tmp_path / "pyolaf" / "calib.tif").shape == (*white.image.shape[:2], 1)
    focused = dataclasses.replace(taken_by, microlenses_to_sensor=1.1)
    with pytest.raises(InvalidValueError, match="tube lens"):
        pl.export.pyolaf(tmp_path / "b", *(dataclasses.replace(one, camera=focused) for one in (shot, white)))


def test_jpeg_pleno_gets_columns_and_rows_of_views(tmp_path, square):
    _, shot, white = square
    field = pl.lightfield.decode(shot, white, views=3)
    pl.export.jpeg_pleno(tmp_path, field)
    kind, size, largest, data = (tmp_path / "002_000.ppm").read_bytes().split(b"\n", 3)
    columns, rows = map(int, size.split())
    assert kind == b"P6" and largest == b"1023" and (rows, columns) == field.views.shape[2:4]
    seen = np.frombuffer(data, ">u2").reshape(rows, columns, 3)[..., 0] / 1023
    linear = np.where(seen <= 0.04045, seen / 12.92, ((seen + 0.055) / 1.055) ** 2.4)
    view = np.clip(np.nan_to_num(field.view(1, -1)[..., 0]) / np.nanpercentile(field.views, 99.9), 0, 1)
    np.testing.assert_allclose(linear, view, atol=0.002)
    with pytest.raises(FileError, match="8 views of another light field"):
        pl.export.jpeg_pleno(tmp_path, pl.lightfield.decode(shot, white, views=1))
    again = pl.lightfield.read_views(tmp_path, (3, 3))
    np.testing.assert_allclose(again.view(1, -1)[..., 0], view, atol=0.002)
