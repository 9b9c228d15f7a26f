"""Imported light fields: round trips, distances, and refusal of damaged folders."""

import dataclasses

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.errors import FileError, InvalidValueError
from plenoptic.lightfield import read_eslf, read_hci, read_views, refocus


@pytest.fixture(scope="module")
def field():
    camera = pl.camera.example_camera(pl.CameraKind.PLENOPTIC_1, shape=(154, 198), lattice=pl.Lattice.SQUARE)
    scene = pl.Scene(pl.targets.checkerboard(30, 30, square=1.5).translated(z=-390.0).meshes, background=0.2)
    shot = pl.render(scene, camera, samples=16, progress=False)
    return pl.lightfield.decode(shot, pl.render_white(camera, samples=16, progress=False), views=5)


@pytest.fixture
def folder(field, tmp_path):
    pl.export.hci(tmp_path / "scene", field)
    return tmp_path / "scene"


def test_a_light_field_of_the_benchmark_comes_back(field, folder):
    imported = read_hci(folder)
    assert imported.views.shape == (5, 5, *field.views.shape[2:4], 3) and imported.camera is None
    scale = np.nanpercentile(field.views, 99.9)
    expected = np.clip(np.nan_to_num(field.views) / scale, 0, 1)
    np.testing.assert_allclose(imported.views, np.repeat(expected, 3, axis=4), atol=0.005)
    np.testing.assert_array_equal(imported.view(2, -1), imported.views[4, 1])
    pupil = pl.paraxial.cardinal_points(field.camera.lens).entrance_pupil
    for z in (-300.0, -404.0, -1000.0):
        assert imported.disparity_at(z - pupil) == pytest.approx(field.disparity_at(z), abs=1e-9)
    # Refocused alike, where no view was dark.
    ours, theirs = refocus(field, -390.0) / scale, refocus(imported, -390.0 - pupil)
    valid = np.pad(np.isfinite(field.views).all(axis=(0, 1, 4))[2:-2, 2:-2], 2)
    np.testing.assert_allclose(theirs[valid][:, :1], np.clip(ours[valid], 0, 1), atol=0.03)


def test_views_and_macro_pixels_come_back(tmp_path):
    views = np.random.default_rng(4).integers(0, 65536, (3, 2, 4, 5, 3)).astype(np.uint16)  # u, v, rows, columns
    for v in range(2):
        for u in range(3):
            pl.images.write_16bit(tmp_path / f"out_{v:02d}_{u:02d}.png", views[u, v])
    (tmp_path / "README").write_text("order")
    (tmp_path / "macro").mkdir()
    macro = views.transpose(2, 1, 3, 0, 4).reshape(4 * 2, 5 * 3, 3)
    pl.images.write_16bit(tmp_path / "macro" / "a_eslf.png", macro)
    linear = pl.images.srgb_to_linear(views / 65535)
    for imported in (read_views(tmp_path, (2, 3)), read_eslf(tmp_path / "macro" / "a_eslf.png", (2, 3))):
        np.testing.assert_allclose(imported.views, linear, atol=1e-5)
        np.testing.assert_array_equal(imported.view(0, -1), imported.views[1, 0])
        assert np.isfinite(refocus(imported, disparity=0.4)).any()
        # As many views along u as along v.
        views = np.concatenate([imported.views, imported.views[:, :1]], axis=1)
        square = dataclasses.replace(imported, views=views, v=np.arange(3.0) - 1)
        for call, said in (
            (lambda imported=imported: imported.disparity_at(-300.0), "refocus it by disparity"),
            (lambda imported=imported: imported.truth(pl.shapes.white_plane()), "names no camera"),
            (lambda square=square: pl.export.hci(tmp_path / "other", square), "names no camera"),
        ):
            with pytest.raises(InvalidValueError, match=said):
                call()


def test_damaged_folders_are_refused(folder, tmp_path):
    for read, said in (
        (lambda: read_hci(tmp_path), r"parameters\.cfg"),
        (lambda: read_views(tmp_path / "none", (2, 2)), "is no folder"),
        (lambda: read_views(folder, (3, 3)), "holds 26 pictures; 3 x 3"),
        (lambda: read_eslf(folder / "input_Cam000.png", (4, 4)), "do not divide"),
    ):
        with pytest.raises(FileError, match=said):
            read()
    text = (folder / "parameters.cfg").read_text()
    for old, new, said in (("cams_x = 5", "cams_x = 5000", "cannot be"), ("baseline_mm", "base", "cannot be unders")):
        (folder / "parameters.cfg").write_text(text.replace(old, new))
        with pytest.raises(FileError, match=said):
            read_hci(folder)
    (folder / "parameters.cfg").write_text(text)
    pl.images.write_16bit(folder / "input_Cam003.png", np.zeros((2, 2, 3), dtype=np.uint16))
    with pytest.raises(FileError, match="they must agree"):
        read_hci(folder)
    (folder / "input_Cam003.png").unlink()
    with pytest.raises(FileError, match="Cam003"):
        read_hci(folder)
