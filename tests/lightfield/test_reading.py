"""Imported light fields: round trips, distances, and refusal of damaged folders."""

import dataclasses
import warnings

import numpy as np
import pytest
from PIL import Image

import plenoptic as pl
from plenoptic.errors import FileError, FileWarning, InvalidValueError
from plenoptic.lightfield import read_eslf, read_hci, read_lftoolbox, read_views, refocus


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
        # The cameras of the benchmark have no microlenses, over which light is uneven.
        assert imported.disparity_at(z - pupil) == pytest.approx(field.disparity_at(z), abs=5e-4)
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


def write_views(folder, names):
    folder.mkdir()
    for value, name in enumerate(names):
        Image.fromarray(np.full((2, 3), value, np.uint8)).save(folder / name)
    (folder / f"._{names[0]}").write_bytes(b"\0\5\x16\7")  # as macOS leaves beside every file of a foreign disk


def test_views_are_ordered_by_the_numbers_in_their_names(tmp_path):
    for case, names in enumerate(
        (
            [f"view_{k}.png" for k in range(12)],
            [f"scene-{k}.png" for k in range(1, 13)],
            [f"{row}_{column}.png" for row in (-5, 5, 15) for column in (-10, -1, 0, 1)],
            [f"out_{k // 4:02d}_{k % 4:02d}_-{780 - k}.134705_-{335 * k}.3_.png" for k in range(12)],
        )
    ):
        write_views(tmp_path / str(case), names)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            field = read_views(tmp_path / str(case), (3, 4), encoding=pl.images.Encoding.LINEAR)
        np.testing.assert_allclose(255 * field.views[:, :, 0, 0, 0].T, np.arange(12.0).reshape(3, 4), atol=1e-4)
    gap = [f"view_{k}.png" for k in range(13) if k != 3]
    write_views(tmp_path / "gap", gap)
    with pytest.warns(FileWarning, match=r"number 3 is missing after 'view_2\.png'"):
        read_views(tmp_path / "gap", (3, 4), encoding=pl.images.Encoding.LINEAR)
    for names, said in ((["a_0.5.png", "a_0.25.png"], "another by decimals"), (["a1.png", "a01.png"], "same numbers")):
        write_views(tmp_path / names[0], names)
        with pytest.raises(FileError, match=said):
            read_views(tmp_path / names[0], (1, 2))


def test_transparent_pixels_are_unknown(tmp_path):
    picture = np.full((4, 6, 4), 100, np.uint8)
    picture[1, 2, 3], picture[3, 4, 3] = 0, 1
    Image.fromarray(picture).save(tmp_path / "a.png")
    for field in (read_views(tmp_path, (1, 1)), read_eslf(tmp_path / "a.png", (2, 2))):
        assert np.isnan(field.views).sum() == 3
    assert np.isnan(field.views[0, 1, 0, 1]).all()  # row 1 of the macro-pixels' two, column 0


def test_16_bits_of_unknown_encoding_are_not_decoded_silently(tmp_path):
    codes = np.full((4, 6), 32768, np.uint16)
    for ending in ("png", "tif"):
        folder = tmp_path / ending
        folder.mkdir()
        for number in range(2):
            Image.fromarray(codes).save(folder / f"{number}.{ending}")
        with pytest.warns(FileWarning, match=r"0\.\w+' does not state whether its 16 bits .*LINEAR") as warned:
            field = read_views(folder, (1, 2))
        assert len(warned) == 1
        np.testing.assert_allclose(field.views, pl.images.srgb_to_linear(32768 / 65535), rtol=1e-6)
        for encoding, value in ((pl.images.Encoding.LINEAR, 32768 / 65535), (pl.images.Encoding.SRGB, field.views[0])):
            np.testing.assert_allclose(read_views(folder, (1, 2), encoding=encoding).views[0], value, rtol=1e-6)
            np.testing.assert_allclose(read_eslf(folder / f"0.{ending}", (1, 1), encoding=encoding).views[0], value)


def test_true_maps_of_the_benchmark_come_back(field, tmp_path):
    scene = pl.Scene(pl.targets.checkerboard(30, 30, square=1.5).translated(z=-390.0).meshes)
    pl.export.hci(tmp_path, field, scene=scene)
    imported = read_hci(tmp_path)
    truth, pupil = imported.ground_truth, pl.paraxial.cardinal_points(field.camera.lens).entrance_pupil
    np.testing.assert_allclose(truth.depth, field.truth(scene).depth + pupil, rtol=1e-6)
    seen = np.isfinite(truth.depth)
    np.testing.assert_allclose(truth.disparity[seen], field.disparity_at(-390.0)[0], atol=1e-6)
    assert pl.lightfield.disparity_scores(truth.disparity, truth.disparity).pixels == np.isfinite(truth.disparity).sum()
    assert not truth.standard_error.any() and (truth.confidence == 1).all()
    # Another program's map: big-endian, with a scale.
    head = "Pf\n{1} {0}\n2.0\n".format(*truth.depth.shape).encode("ascii")
    half = (0.5e-3 * truth.depth[::-1]).astype(">f4")
    (tmp_path / "gt_depth_lowres.pfm").write_bytes(head + half.tobytes())
    (tmp_path / "gt_disp_lowres.pfm").unlink()
    other = read_hci(tmp_path).ground_truth
    np.testing.assert_allclose(other.depth, truth.depth, rtol=1e-6)
    assert np.isnan(other.disparity).all()
    (tmp_path / "gt_depth_lowres.pfm").write_bytes(b"Pf\n1 1\n-1\n" + bytes(4))
    with pytest.raises(FileError, match="has shape .1, 1., and the views .7, 9.; they must agree"):
        read_hci(tmp_path)
    (tmp_path / "gt_depth_lowres.pfm").unlink()
    assert read_hci(tmp_path).ground_truth is None
    (tmp_path / "colours.pfm").write_bytes(b"PF\n1 1\n-1\n" + bytes(12))
    with pytest.raises(FileError, match="has 3 channels"):
        pl.images.read_pfm(tmp_path / "colours.pfm")


def test_decoded_files_of_older_matlab(tmp_path):
    io = pytest.importorskip("scipy.io")
    codes = np.random.default_rng(3).integers(0, 65536, (2, 3, 4, 5, 4)).astype(np.uint16)  # j, i, l, k, channel
    codes[..., 3] = 65535
    codes[1, 2, 3, 4, 3] = 0
    for compressed in (False, True):  # versions 5 and 7
        io.savemat(tmp_path / "a.mat", {"other": np.ones(3), "LF": codes}, do_compression=compressed)
        field = read_lftoolbox(tmp_path / "a.mat")
        expected = (codes[..., :3].transpose(1, 0, 2, 3, 4) / 65535).astype(np.float32)
        expected[2, 1, 3, 4] = np.nan
        np.testing.assert_allclose(field.views, expected, rtol=1e-6)
    io.savemat(tmp_path / "b.mat", {"LF": np.zeros((9, 9, 99, 99, 3))}, do_compression=True)
    with pytest.raises(FileError, match="its array LF would take 19053144 bytes"):
        read_lftoolbox(tmp_path / "b.mat", limits=pl.images.FileLimits(memory=1000))
    io.savemat(tmp_path / "c.mat", {"other": np.ones(3)})
    with pytest.raises(FileError, match=r"c\.mat' holds no light field LF"):
        read_lftoolbox(tmp_path / "c.mat")


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
