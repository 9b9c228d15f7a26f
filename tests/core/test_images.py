import itertools
import os
import struct
import warnings
import zlib

import numpy as np
import pytest
from PIL import Image

from plenoptic.core.color.srgb import Encoding, linear_to_srgb, srgb_to_linear
from plenoptic.core.files import images
from plenoptic.errors import FileError, FileWarning, InvalidValueError
from plenoptic.scene.lights.environment import EnvironmentMap
from plenoptic.scene.textures.texture import Texture


@pytest.fixture
def ramp():
    return np.random.default_rng(1).integers(0, 65536, (5, 7, 3)).astype(np.uint16)


def left_over(folder):
    return [name for name in os.listdir(folder) if name.startswith(".")]


def test_srgb_is_that_of_the_standard():
    # Each way rounds a power of 2.4 at most: a few eps, relative.
    linear = np.concatenate([np.linspace(-2, 2, 1001), [1e-9, 0.0031308]])
    np.testing.assert_allclose(srgb_to_linear(linear_to_srgb(linear)), linear, rtol=1e-14, atol=0)
    # The standard's rounded constants leave a step below 1e-7 in value where the pieces meet.
    below, above = srgb_to_linear(np.nextafter(0.04045, [0.0, 1.0]))
    assert abs(above - below) < 1e-7
    # IEC 61966-2-1: 18 % grey is code 117.6 of 255, full is full.
    np.testing.assert_allclose(linear_to_srgb([0.0, 0.18, 1.0]) * 255, [0, 117.64, 255], atol=0.02)
    for dtype in (np.float32, np.float64):
        assert srgb_to_linear(np.ones(2, dtype)).dtype == linear_to_srgb(np.ones(2, dtype)).dtype == dtype


def test_8_bit_colours_are_decoded_from_srgb_and_alpha_does_not_darken(tmp_path):
    codes = np.arange(48, dtype=np.uint8).reshape(4, 4, 3) * 5
    for ending in (".png", ".tif"):
        Image.fromarray(codes).save(tmp_path / f"a{ending}")
        read = images.read_linear(tmp_path / f"a{ending}")
        assert read.dtype == np.float32, ending
        np.testing.assert_allclose(read, srgb_to_linear(codes / 255), rtol=4 * np.finfo(np.float32).eps)
    Image.fromarray(np.full((4, 6), 128, np.uint8)).save(tmp_path / "grey.jpg")
    assert images.read_linear(tmp_path / "grey.jpg").shape == (4, 6, 1)
    for mode, channels in (("RGBA", 3), ("LA", 1)):
        Image.new(mode, (3, 2), (255,) * channels + (64,)).save(tmp_path / "a.png")
        read = images.read_linear(tmp_path / "a.png")
        assert read.shape == (2, 3, channels) and (read == 1).all(), mode


def test_16_bits_come_back(tmp_path, ramp):
    for ending, encoding, channels in itertools.product((".png", ".tif", ".PNG"), ("Linear", "sRGB"), (1, 3)):
        path, written = tmp_path / f"a{ending}", ramp[:, :, :channels]
        images.write_16bit(path, written, {images.COLOR_SPACE: encoding, "note": 'é "quoted"'})
        stored, metadata = images.read_channels(path)
        np.testing.assert_array_equal(np.rint(np.stack(list(stored.values()), -1) * 65535), written)
        assert metadata["note"] == 'é "quoted"', (ending, encoding, channels)
        expected = written / 65535 if encoding == "Linear" else srgb_to_linear(written / 65535)
        np.testing.assert_allclose(images.read_linear(path), expected, atol=4 * np.finfo(np.float32).eps)
        # Data are not decoded whatever the file says.
        read = images.read_linear(path, encoding=Encoding.LINEAR)
        np.testing.assert_array_equal(np.rint(read * 65535), written)
        assert not left_over(tmp_path), (ending, encoding, channels)


def test_channels_keep_names_values_and_texts(tmp_path):
    random = np.random.default_rng(2)
    names = ["R", "G", "B", "error.R", "error.G", "error.B", "depth.Z", "odd"]
    written = {name: random.normal(size=(150, 7)).astype(np.float32) for name in names}
    # Infinities, zeros of both signs, nan with other bits than usual, and more rows than are compared at a time.
    written["depth.Z"][0] = 0.0, -0.0, np.inf, -np.inf, np.nan, 1e-45, 3e38
    written["odd"] = (np.arange(1050, dtype=np.uint32).reshape(150, 7) | 0x7FC00000).view(np.float32)
    images.write_channels(tmp_path / "a.exr", written, {"plenoptic:camera": "é" * 100_000})
    read, metadata = images.read_channels(tmp_path / "a.exr")
    assert set(read) == set(names)
    for name in names:
        np.testing.assert_array_equal(read[name].view(np.uint32), written[name].view(np.uint32), name)
    assert metadata["plenoptic:camera"] == "é" * 100_000
    picture = np.stack([written[name] for name in "RGB"], axis=-1)
    np.testing.assert_array_equal(images.read_linear(tmp_path / "a.exr"), picture)


def test_one_channel_of_a_file(tmp_path):
    planes = {name: np.full((2, 3), 0.25 * k) for k, name in enumerate("RGBA", 1)}
    images.write_channels(tmp_path / "colours.exr", planes)
    images.write_channels(tmp_path / "grey.exr", {"Z": planes["G"]})
    for channel in range(4):
        colours = images.read_linear(tmp_path / "colours.exr", channel=channel)
        assert colours.shape == (2, 3, 1) and (colours == 0.25 * (channel + 1)).all()
        grey = images.read_linear(tmp_path / "grey.exr", channel=channel)
        assert grey.shape == (2, 3, 1) and (grey == (1 if channel == 3 else 0.5)).all()
    # Beside it there may be an opacity.
    images.write_channels(tmp_path / "a.exr", {"Z": np.full((2, 3), np.pi), "A": np.zeros((2, 3))})
    read = images.read_linear(tmp_path / "a.exr")
    assert read.shape == (2, 3, 1) and (read == np.float32(np.pi)).all()
    images.write_channels(tmp_path / "a.exr", {"U": np.ones((2, 3)), "V": np.ones((2, 3))})
    with pytest.raises(FileError, match="holds the channels U, V; a picture needs R, G, B"):
        images.read_linear(tmp_path / "a.exr")


@pytest.mark.parametrize("gamma", [None, 100000, 45455, 55556, 35000])
def test_a_given_encoding_counts_whatever_a_png_states(tmp_path, gamma):
    """gAMA (PNG 1.2, 4.2.2.1) in 100000ths, before the pixels; glTF textures are decoded by their use too."""
    Image.new("RGB", (3, 2), (128, 64, 255)).save(tmp_path / "a.png")
    content = (tmp_path / "a.png").read_bytes()
    if gamma is not None:
        chunk = b"gAMA" + gamma.to_bytes(4, "big")
        content = content[:33] + bytes([0, 0, 0, 4]) + chunk + zlib.crc32(chunk).to_bytes(4, "big") + content[33:]
    (tmp_path / "a.png").write_bytes(content)
    codes = np.array([128, 64, 255]) / 255
    srgb = ((codes + 0.055) / 1.055) ** 2.4
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for read in (
            Texture.load(tmp_path / "a.png").texels,
            images.read_linear(tmp_path / "a.png", encoding=Encoding.SRGB),
            Texture.from_image(Image.open(tmp_path / "a.png")).texels,
        ):
            np.testing.assert_allclose(read[0, 0], srgb, rtol=1e-6)
        np.testing.assert_allclose(Texture.load(tmp_path / "a.png", encoding=Encoding.LINEAR).texels[0, 0], codes, 1e-6)
    assert [str(one.message).partition("states that its ")[2][:16] for one in caught] == ["codes are linear"] * (
        2 * (gamma == 100000)
    )
    stated = images.read_linear(tmp_path / "a.png")[0, 0]
    np.testing.assert_allclose(stated, codes if gamma == 100000 else srgb, rtol=1e-6)


# Rows and columns of data, its upper left pixel in the display window of 4 x 5, and the part of the window it covers.
WINDOWS = [
    ((2, 5), (2, 0), np.s_[2:4, 0:5], np.s_[:, :]),
    ((4, 2), (0, 3), np.s_[0:4, 3:5], np.s_[:, :]),
    ((6, 9), (-1, -2), np.s_[0:4, 0:5], np.s_[1:5, 2:7]),
    ((3, 3), (-2, 3), np.s_[0:1, 3:5], np.s_[2:3, 0:2]),
    ((2, 2), (7, 1), np.s_[0:0, 0:0], np.s_[0:0, 0:0]),
    ((4, 5), (0, 0), np.s_[0:4, 0:5], np.s_[:, :]),
]


@pytest.mark.parametrize("origin", [(0, 0), (10, -3)])
@pytest.mark.parametrize("window", WINDOWS)
def test_the_picture_of_an_exr_file_is_its_display_window(tmp_path, window, origin):
    shape, (top, left), shown, covered = window
    data = np.random.default_rng(3).uniform(1, 2, (*shape, 3)).astype(np.float32)
    write_exr(tmp_path / "a.exr", data, "RGB", (top + origin[0], left + origin[1]), origin, (4, 5))
    expected = np.zeros((4, 5, 3), dtype=np.float32)
    expected[shown] = data[covered]
    np.testing.assert_array_equal(images.read_linear(tmp_path / "a.exr"), expected)
    np.testing.assert_array_equal(images.read_channels(tmp_path / "a.exr")[0]["G"], expected[:, :, 1])
    assert images.read_header(tmp_path / "a.exr").shape == (4, 5)
    with pytest.raises(FileError, match="has 4 x 5 pixels; it must have at most 19"):
        images.read_linear(tmp_path / "a.exr", max_pixels=19)
    write_exr(tmp_path / "a.exr", data, "RGB", (0, 0), (0, 0), (1 << 20, 1 << 20))
    with pytest.raises(FileError, match="bytes of memory"):
        images.read_linear(tmp_path / "a.exr")


def write_exr(path, data, names, corner, origin, display):
    """An EXR file, uncompressed, byte by byte: "Technical Introduction to OpenEXR" (2013) and "OpenEXR File Layout"."""

    def attribute(name, kind, value):
        return name + b"\0" + kind + b"\0" + struct.pack("<i", len(value)) + value

    def box(corner, shape):
        return struct.pack("<4i", corner[1], corner[0], corner[1] + shape[1] - 1, corner[0] + shape[0] - 1)

    order = sorted(range(len(names)), key=lambda k: names[k])
    channels = b"".join(names[k].encode() + b"\0" + struct.pack("<iB3xii", 2, 0, 1, 1) for k in order) + b"\0"
    head = struct.pack("<ii", 20000630, 2) + attribute(b"channels", b"chlist", channels)
    head += attribute(b"compression", b"compression", b"\0") + attribute(b"lineOrder", b"lineOrder", b"\0")
    head += attribute(b"dataWindow", b"box2i", box(corner, data.shape))
    head += attribute(b"displayWindow", b"box2i", box(origin, display))
    head += attribute(b"pixelAspectRatio", b"float", struct.pack("<f", 1))
    head += attribute(b"screenWindowCenter", b"v2f", bytes(8))
    head += attribute(b"screenWindowWidth", b"float", struct.pack("<f", 1)) + b"\0"
    rows = [struct.pack("<ii", corner[0] + y, row.nbytes) + row[:, order].T.tobytes() for y, row in enumerate(data)]
    start = len(head) + 8 * len(rows)
    offsets = [start + sum(map(len, rows[:y])) for y in range(len(rows))]
    path.write_bytes(head + struct.pack(f"<{len(rows)}q", *offsets) + b"".join(rows))


@pytest.mark.parametrize(
    ("names", "picture", "alpha"),
    [
        (["r", "g", "b"], "rgb", None),
        (["r", "G", "b", "a"], ["r", "G", "b"], "a"),
        (["diffuse.R", "diffuse.G", "diffuse.B", "diffuse.A"], ["diffuse.R", "diffuse.G", "diffuse.B"], "diffuse.A"),
        (
            ["View.Combined.r", "View.Combined.g", "View.Combined.b", "View.Depth.Z"],
            ["View.Combined." + c for c in "rgb"],
            None,
        ),
        (["R", "G", "B", "error.R", "error.G", "error.B", "error.A"], "RGB", None),
        (["y", "a"], "y", "a"),
        (["Y", "error.R", "error.G", "error.B"], "Y", None),
        (
            ["left.R", "left.G", "left.B", "right.R", "right.G", "right.B"],
            "holds pictures in the layers left, right",
            None,
        ),
        (["X", "Y", "Z"], "holds the channels X, Y, Z; a picture needs", None),
        # OpenImageIO below 3.2 refuses them by itself: they are subsampled.
        (["Y", "RY", "BY"], "(holds the channels .*RY.*; a picture needs|is damaged: .*subsampling)", None),
        (["position.X", "position.Y", "position.Z", "n.R"], "holds the channels", None),
    ],
)
def test_channels_of_layers_and_in_lower_case(tmp_path, names, picture, alpha):
    data = np.random.default_rng(4).uniform(size=(2, 3, len(names))).astype(np.float32)
    write_exr(tmp_path / "a.exr", data, names, (0, 0), (0, 0), (2, 3))
    if isinstance(picture, str) and len(picture) > 3:
        with pytest.raises(FileError, match=rf"a\.exr' {picture}"):
            images.read_linear(tmp_path / "a.exr")
        return
    expected = data[:, :, [names.index(name) for name in picture]]
    np.testing.assert_array_equal(images.read_linear(tmp_path / "a.exr"), expected)
    assert images.read_header(tmp_path / "a.exr").picture == list(picture)
    opacity = np.ones((2, 3), np.float32) if alpha is None else data[:, :, names.index(alpha)]
    np.testing.assert_array_equal(images.read_linear(tmp_path / "a.exr", channel=3)[:, :, 0], opacity)


def write_parts(path, parts):
    """An EXR file of several parts, each a number for each of its channels."""
    import OpenImageIO as oiio

    specs = []
    for name, values in parts.items():
        specs.append(oiio.ImageSpec(4, 2, len(values), oiio.FLOAT))
        specs[-1].channelnames = tuple(values)
        specs[-1].attribute("oiio:subimagename", name)
    sink = oiio.ImageOutput.create(str(path))
    assert sink.open(str(path), tuple(specs))
    for number, values in enumerate(parts.values()):
        assert number == 0 or sink.open(str(path), specs[number], "AppendSubimage")
        assert sink.write_image(np.tile(np.array([*values.values()], dtype=np.float32), (2, 4, 1)))
    assert sink.close()


COLOURED, OTHER = {"R": 0.5, "G": 0.25, "B": 2.0, "A": 0.75}, {"R": 7.0, "G": 7.0, "B": 7.0}


def test_the_first_part_of_an_exr_file_that_has_colours_is_read(tmp_path):
    path, depth, listed = tmp_path / "a.exr", {"Z": 9.0}, r"a\.exr' has the parts "
    for parts, said in (
        ({"depth": depth, "beauty": COLOURED, "other": OTHER}, r"depth \(Z\), beauty .*; only beauty is read"),
        ({"beauty": COLOURED, "depth": depth}, r"beauty \(R, G, B, A\), depth \(Z\); only beauty is read"),
    ):
        write_parts(path, parts)
        with pytest.warns(FileWarning, match=listed + said):
            np.testing.assert_array_equal(images.read_linear(path), np.tile(np.float32([0.5, 0.25, 2.0]), (2, 4, 1)))
        with pytest.warns(FileWarning, match=listed + said):
            assert Texture.load(path).texels[1, 3].tolist() == [0.5, 0.25, 2.0]
        with pytest.warns(FileWarning, match=listed + said):
            assert EnvironmentMap.load(path).texels[0, 0].tolist() == [0.5, 0.25, 2.0]
        with pytest.warns(FileWarning, match=listed + said):
            assert images.read_linear(path, channel=3)[0, 0, 0] == 0.75
        with pytest.warns(FileWarning, match=listed + said):
            assert {name: plane[0, 0] for name, plane in images.read_channels(path)[0].items()} == COLOURED
        with pytest.warns(FileWarning, match=listed + said):
            assert images.read_header(path).picture == ["R", "G", "B"]
    write_parts(path, {"grey": {"Y": 0.5}, "depth": depth})
    with pytest.warns(FileWarning, match="only grey is read"):
        assert images.read_linear(path)[0, 0].tolist() == [0.5]
    write_parts(path, {"depth": depth, "position": {"X": 1.0, "Y": 2.0, "Z": 3.0}})
    with pytest.raises(FileError, match=listed + r"depth \(Z\), position \(X, Y, Z\); one needs R, G, B, or Y: write"):
        images.read_linear(path)


@pytest.mark.parametrize(("rows", "columns"), [*itertools.product("-+", "+-")])
def test_rows_and_columns_of_hdr_files_in_any_order(tmp_path, rows, columns):
    """Radiance: -Y N +X M stores the upper row first; code 128 of exponent 129 is 1."""
    codes = np.array([[[128, 0, 0, 129], [0, 128, 0, 129], [0, 0, 128, 129]], [[0, 128, 128, 129]] * 3], dtype=np.uint8)
    head = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n{rows}Y 2 {columns}X 3\n".encode()
    (tmp_path / "a.hdr").write_bytes(head + codes.tobytes())
    upright = codes[:: 1 if rows == "-" else -1, :: 1 if columns == "+" else -1, :3] / 128
    np.testing.assert_array_equal(images.read_linear(tmp_path / "a.hdr"), upright)
    (tmp_path / "a.hdr").write_bytes(head.replace(b"Y 2", b"X 2").replace(b"X 3", b"Y 3") + codes.tobytes())
    with pytest.raises(FileError, match=r"a\.hdr' stores columns in place of rows"):
        images.read_linear(tmp_path / "a.hdr")


def test_a_limit_on_pixels(tmp_path):
    images.write_channels(tmp_path / "a.exr", {"Y": np.ones((3, 4))})
    assert images.read_linear(tmp_path / "a.exr", max_pixels=12).shape == (3, 4, 1)
    with pytest.raises(FileError, match="a.exr' has 3 x 4 pixels; it must have at most 11 here, so scale it down"):
        images.read_linear(tmp_path / "a.exr", max_pixels=11)


def test_what_is_no_image(tmp_path, ramp):
    for ending, content in itertools.product((".png", ".exr", ".tif", ".jpg", ".xyz", ""), (b"", b"not an image")):
        (tmp_path / f"a{ending}").write_bytes(content)
        with pytest.raises(FileError, match="cannot be read as an image"):
            images.read_linear(tmp_path / f"a{ending}")
    images.write_channels(tmp_path / "a.exr", {"Y": ramp[:, :, 0]})
    images.write_16bit(tmp_path / "a.png", ramp)
    for path in (tmp_path / "a.exr", tmp_path / "a.png"):
        path.write_bytes(path.read_bytes()[:-40])
        with pytest.raises(FileError, match="is damaged"):
            images.read_linear(path)
    with pytest.raises(FileError, match="does not exist"):
        images.read_linear(tmp_path / "none.png")
    with pytest.raises(FileError, match="is a folder"):
        images.read_linear(tmp_path)


def test_damage_that_is_quoted_as_no_text_is_damage(tmp_path):
    # OpenImageIO quotes the type of a header attribute as it stands in the file: 0xff is in no UTF-8 text.
    path = tmp_path / "a.exr"
    images.write_channels(path, {"Y": np.ones((2, 2))})
    path.write_bytes(path.read_bytes().replace(b"chlist", b"chl\xffst"))
    for read in (images.read_linear, images.read_channels):
        with pytest.raises(FileError, match="a.exr' cannot be read as an image: (it is damaged|OpenEXR)"):
            read(path)


def test_names_that_no_file_can_have(tmp_path):
    plane = {"Y": np.ones((2, 2))}
    for path in (None, 5, b"a.exr"):
        for call, *more in ((images.read_linear,), (images.write_channels, plane)):
            with pytest.raises(FileError, match="is not a path; give the name of a file"):
                call(path, *more)
    for name in ("a\0b", "a" * 5000):
        with pytest.raises(FileError, match=r"cannot be read \(.*; check its name"):
            images.read_linear(tmp_path / f"{name}.exr")
        with pytest.raises(FileError, match=r"cannot be (read|used) \(.*; check its name"):
            images.write_channels(tmp_path / f"{name}.exr", plane)
    for name in ("", "a" * 300):  # of channels: OpenImageIO calls the first R and cuts the second at 255 characters
        with pytest.raises(FileError, match="the file does not hold the pixels written"):
            images.write_channels(tmp_path / "a.exr", {name: np.ones((2, 2)), **plane})
    assert not os.listdir(tmp_path)


def test_places_that_cannot_be_written(tmp_path, monkeypatch):
    plane, grey = {"Y": np.ones((2, 2))}, np.ones((2, 2, 1), np.uint16)
    (tmp_path / "folder.exr").mkdir()
    for write, name, content, text in (
        (images.write_channels, "none/a.exr", plane, "does not exist; make it first"),
        (images.write_channels, "a.xyz", plane, r"ends in '.xyz'; it must end in .exr"),
        (images.write_16bit, "a.exr", grey, "must end in .png or .tif or .tiff"),
        (images.write_channels, "folder.exr", plane, "is a folder"),
    ):
        with pytest.raises(FileError, match=text):
            write(tmp_path / name, content)
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(FileError, match="is not writable; choose another one"):
        images.write_channels(tmp_path / "a.exr", plane)


def test_a_link_stays_a_link(tmp_path):
    path = tmp_path / "a.exr"
    images.write_channels(path, {"Y": np.ones((2, 2))})
    (tmp_path / "link.exr").symlink_to(path)
    images.write_channels(tmp_path / "link.exr", {"Y": np.zeros((2, 2))})
    assert (tmp_path / "link.exr").is_symlink() and images.read_linear(path).max() == 0
    assert sorted(os.listdir(tmp_path)) == ["a.exr", "link.exr"]


def test_shapes_that_are_no_image(tmp_path):
    with pytest.raises(InvalidValueError, match="give at least one"):
        images.write_channels(tmp_path / "a.exr", {})
    with pytest.raises(InvalidValueError, match="all of one shape"):
        images.write_channels(tmp_path / "a.exr", {"R": np.ones((2, 2)), "G": np.ones((2, 3))})
    with pytest.raises(InvalidValueError, match="uint16"):
        images.write_16bit(tmp_path / "a.png", np.ones((2, 2, 3)))
    with pytest.raises(InvalidValueError, match="write an EXR file instead"):
        images.write_16bit(tmp_path / "a.png", np.ones((2, 2, 1), np.uint16), {"note": "x" * 70_000})
    assert not os.listdir(tmp_path)
