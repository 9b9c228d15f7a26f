"""Packages give back what was written, say what belongs to what, and refuse what has been changed."""

import dataclasses
import json
import re
import shutil
import zipfile

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.errors import FileError, InvalidValueError
from plenoptic.package.reading import PROVENANCE

LENS = pl.load_lens("double-gauss-100mm-f2")


def a_camera(stop=5.0):
    imperfect = pl.MicrolensImperfections(pitch_jitter=0.002, seed=3)
    array = pl.MicrolensArray(0.217, (1.7, 2.0, 2.4), imperfections=imperfect)
    camera = pl.PlenopticCamera(LENS.with_stop(pl.CircularStop(stop)), pl.Sensor((72, 96), 0.01), 123.3, array, 1.7)
    return camera.moved(pl.CameraPart.MICROLENSES, shift=(0.03, -0.02, 0.01), tilt=(0.0, 0.0, 0.02))


CAMERA = a_camera()
SENSOR = pl.SensorModel(
    photon_rate=4000.0, gain=0.5, black_level=64, bits=12, read_noise=3.0, colour_filters=pl.BayerPattern.GRBG
)
SCENE = pl.check_scene()


@pytest.fixture(scope="module")
def shots():
    shot = pl.render(SCENE, CAMERA, samples=8, truth=pl.Truth.ALL, progress=False)
    whites = [pl.render_white(camera, samples=8, progress=False) for camera in (CAMERA, a_camera(2.5), a_camera(2.5))]
    return shot, *whites


def targets():
    board = pl.targets.checkerboard(4, 3, square=1.0)
    return board.translated(z=-404.0), board.rotated_deg((0, 1, 0), 20).translated(z=-380.0)


@pytest.fixture(scope="module", params=["folder", "file.zip"])
def written(request, shots, tmp_path_factory):
    path = tmp_path_factory.mktemp("package") / request.param
    shot, white, *others = shots
    pl.package.write(path, shot, white, sensor=SENSOR, other_whites=others, targets=targets(), scene=SCENE, seed=5)
    return path


def test_opening_gives_everything_back(shots, written):
    shot, white, *others = shots
    found = pl.package.read(written)
    assert found.exposure == shot and found.camera == CAMERA == shot.camera
    for name, array in shot.truth.arrays().items():
        np.testing.assert_array_equal(getattr(found.exposure.truth, name), array)
    assert found.white == white and [exposure for exposure, _ in found.other_whites] == others
    assert found.raw == shot.develop(SENSOR, seed=5)
    assert found.white_raw.fraction_saturated == 0 and 0.75 < found.white_raw.data.max() / SENSOR.white_level < 0.9
    assert found.dark.electrons().std() == pytest.approx(3.0, rel=0.1) and abs(found.dark.electrons().mean()) < 0.2
    for method in pl.CentreMethod:
        expected = pl.microlens_centres(CAMERA, method)
        for name, value in vars(expected).items():
            np.testing.assert_array_equal(getattr(found.centres[method], name), value)
    points = pl.package.calibration_points(CAMERA, targets(), scene=SCENE)
    assert len(points) > 20
    for name, value in vars(points).items():
        np.testing.assert_array_equal(getattr(found.points, name), value)
    assert found.provenance["seed"] == 0 and found.provenance["samples"] == 8
    assert found.provenance["relative_error"] == shot.relative_error
    assert found.provenance["plan"] == str(pl.plan(SCENE, CAMERA, samples=8)).splitlines()


@pytest.mark.parametrize("written", ["folder"], indirect=True)
def test_other_programs_understand_it(shots, written):
    """A reader of its own, which knows docs/package.md: NumPy, JSON, CSV, and any program that opens TIFF."""
    shot = shots[0]
    planes, _ = pl.images.read_channels(written / "raw.tif")
    assert np.rint(next(iter(planes.values())) * 65535).max() <= 4095
    with np.load(written / "truth.npz") as truth:
        np.testing.assert_array_equal(truth["depth"], shot.truth.depth)
    about = json.loads((written / "camera.json").read_text())
    rows, columns, pitch = (about["sensor"][name] for name in ("rows", "columns", "pixel_pitch"))
    table = np.genfromtxt(written / "centres.csv", delimiter=",", names=True)
    # Without imperfections the optical centre of a lens is its place on the lattice, along the normal of the array.
    with np.load(written / "centres.npz") as centres:
        place = centres["index"] @ np.array(about["array"]["basis"])
        assert np.abs(centres["on_array"] - place).max() < 0.02
        on_array = np.column_stack([centres["on_array"], np.zeros(len(place))])
    array, sensor = about["array_as_built"], about["sensor_as_built"]
    start = on_array @ np.array(array["rotation"]).T + array["origin"]
    along = np.array(array["rotation"])[:, 2]
    normal = np.array(sensor["rotation"])[:, 2]
    way = ((sensor["origin"] - start) @ normal) / (along @ normal)
    x, y, _ = ((start + way[:, None] * along - sensor["origin"]) @ np.array(sensor["rotation"])).T
    known = np.isfinite(table["orthogonal_row"])
    np.testing.assert_allclose((y / pitch + rows / 2 - 0.5)[known], table["orthogonal_row"][known], atol=1e-9)
    np.testing.assert_allclose((-x / pitch + columns / 2 - 0.5)[known], table["orthogonal_column"][known], atol=1e-9)


def test_without_anything_more(tmp_path):
    plain = pl.PlenopticCamera(LENS, pl.Sensor((8, 8), 0.01), 130.0)
    shot = pl.render(SCENE, plain, samples=1, truth=pl.Truth.NONE, region=np.s_[2:6, :], progress=False)
    for path in (tmp_path / "a", tmp_path / "a.zip"):
        pl.package.write(path, shot)
        pl.package.write(path, shot)  # takes the place of the first
        found = pl.package.read(path)
        assert found.exposure == shot and found.exposure.truth is None and found.raw.model.bits == 16
        assert found.white is None and not found.centres and found.points is None
        assert found.raw.linear() == pytest.approx(shot.image[:, :, 0], abs=float(shot.image.max()) / 0.8 / 65535)
    assert sorted(tmp_path.iterdir()) == [tmp_path / "a", tmp_path / "a.zip"]


def test_blur_is_that_of_the_traced_spot():
    round_one = pl.optics.MicrolensAperture(pl.optics.ApertureShape.CIRCLE, fill_factor=0.05)
    array = pl.MicrolensArray(0.4, (2.0,), pl.Lattice.FREE, centres=[[0.0, 0.0]], aperture=round_one)
    lens = dataclasses.replace(LENS.with_stop(pl.CircularStop(semi_diameter=3.0)), model=pl.LensModel.PARAXIAL)
    camera = pl.PlenopticCamera(lens, pl.Sensor(shape=(256, 256), pixel_pitch=0.001), 123.3, array, 1.7)
    for z in (-300.0, -330.0, -900.0):
        target = pl.targets.point_grid(1, 1, pitch=1.0, radius=0.1).translated(z=z)
        (blur,) = pl.package.calibration_points(camera, target).blur
        image = pl.point_spread(camera, target.points[0], rays=1 << 18).image
        spread = np.sqrt(np.cov(np.arange(image.shape[1]), aweights=image.sum(axis=0), ddof=0))
        # The standard deviation of a disc along x is half its radius; pixels add a twelfth of their size squared. Those
        # of n rays scatter by less than 1 / sqrt(4 n), 0.1 %.
        assert 2 * np.sqrt(spread**2 - 1 / 12) == pytest.approx(blur, rel=0.01), z


@pytest.mark.parametrize("written", ["folder"], indirect=True)
def test_what_has_been_changed_is_refused(written, tmp_path):
    for number, name in enumerate(("raw.tif", "raw.exr", "camera.json", "truth.npz", "centres.npz", PROVENANCE)):
        folder = tmp_path / str(number)
        shutil.copytree(written, folder)
        content = bytearray((folder / name).read_bytes())
        # What is told in the provenance, such as the plan, has no digest: there it is the form that breaks.
        content[0 if name == PROVENANCE else len(content) // 2] ^= 1
        (folder / name).write_bytes(content)
        with pytest.raises(FileError, match=name):
            pl.package.read(folder)
        (folder / name).unlink()
        with pytest.raises(FileError, match=name):
            pl.package.read(folder)


@pytest.mark.parametrize("written", ["file.zip"], indirect=True)
def test_zip_files_cannot_reach_out(written, tmp_path):
    with zipfile.ZipFile(written) as archive, zipfile.ZipFile(tmp_path / "a.zip", "w") as evil:
        for entry in archive.infolist():
            evil.writestr(entry, archive.read(entry))
        evil.writestr("../out.csv", b"1")
        evil.writestr("/tmp/out.csv", b"1")
    pl.package.read(tmp_path / "a.zip")
    assert not (tmp_path.parent / "out.csv").exists()
    with zipfile.ZipFile(tmp_path / "b.zip", "w", zipfile.ZIP_DEFLATED) as bomb:
        bomb.writestr("a.csv", bytes(1 << 20))
    with pytest.raises(FileError, match=r"a\.csv and more than may be unpacked"):
        pl.package.read(tmp_path / "b.zip", limits=pl.images.FileLimits(file_size=1 << 19))
    with zipfile.ZipFile(written) as archive, zipfile.ZipFile(tmp_path / "changed.zip", "w") as changed:
        for entry in archive.infolist():
            changed.writestr(entry, archive.read(entry) + b" " * (entry.filename == "camera.json"))
    with pytest.raises(FileError, match=f"^{re.escape(repr(str(tmp_path / 'changed.zip' / 'camera.json')))} has been"):
        pl.package.read(tmp_path / "changed.zip")
    (tmp_path / "c.zip").write_bytes(b"PK\3\4 no zip")
    with pytest.raises(FileError, match="is no package that can be read: File is not a zip file"):
        pl.package.read(tmp_path / "c.zip")


def test_what_cannot_be_written_says_why(shots, tmp_path):
    shot, white, other, _ = shots
    for given, sensor, said in (
        ((pl.Exposure(np.ones((2, 2, 1))),), None, "names no camera"),
        ((shot, other), None, "of another camera"),
        ((shot, white), pl.SensorModel(photon_rate=1.0, bits=None), "not quantised"),
    ):
        with pytest.raises(InvalidValueError, match=said):
            pl.package.write(tmp_path / "a", *given, sensor=sensor)
    with pytest.raises(FileError, match="does not exist; make it first"):
        pl.package.write(tmp_path / "none" / "a", shot)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("x")
    with pytest.raises(FileError, match="holds something else than a package"):
        pl.package.write(tmp_path / "mine", shot)
    with pytest.raises(FileError, match="no package|does not exist"):
        pl.package.read(tmp_path / "mine")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine"]


def test_values_come_back(tmp_path):
    for value in (CAMERA, LENS, SENSOR, (1, "a", 2.5, None)):
        pl.package.save_value(value, tmp_path / "a.json", about={"note": "mine"})
        assert pl.package.load_value(tmp_path / "a.json") == value
        assert json.loads((tmp_path / "a.json").read_text())["note"] == "mine"


def test_other_files_hold_no_value(tmp_path):
    for text, said in (
        ("{", "is not JSON"),
        ("[" * 100_000, "is not JSON"),
        ("[]", "has format None"),
        ('{"format": "plenoptic-value-1"}', "with a value"),
        ('{"format": "plenoptic-value-1", "value": {"value": ["Sensor", {}]}}', "Sensor is described without shape"),
        ('{"format": "plenoptic-value-1", "value": {"value": ["Sensor", {"iso": 3}]}}', "a Sensor has no iso; it has"),
        ('{"format": "plenoptic-value-1", "value": {"value": ["Path", {}]}}', "no value of this package"),
    ):
        (tmp_path / "a.json").write_text(text)
        with pytest.raises(FileError, match=said):
            pl.package.load_value(tmp_path / "a.json")
