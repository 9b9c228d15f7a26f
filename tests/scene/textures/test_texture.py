import io
import itertools
import pickle
import zlib

import numpy as np
import PIL.Image
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import plenoptic as pl
from plenoptic.core.color.srgb import Encoding, srgb_to_linear
from plenoptic.core.files import images
from plenoptic.core.files.serialization import describe, restore
from plenoptic.scene.textures import texture as module
from plenoptic.scene.textures.texture import TextureFilter, Wrap

EPS = float(np.finfo(np.float32).eps)


def test_wrap_and_filter_belong_to_the_value():
    texels = np.random.default_rng(1).uniform(0, 9, (2, 1, 1))
    for wrap in (Wrap.REPEAT, Wrap.CLAMP, (Wrap.MIRROR, Wrap.CLAMP)):
        for between in TextureFilter:
            texture = pl.Texture(texels, wrap=wrap, filter=between)
            assert texture.wraps == (wrap if isinstance(wrap, tuple) else (wrap, wrap))
            again = pickle.loads(pickle.dumps(texture))
            assert again == texture and hash(again) == hash(texture)
            is_default = (wrap, between) == (Wrap.REPEAT, TextureFilter.BILINEAR)
            assert (texture == pl.Texture(texels)) == is_default
            assert ("wrap" in repr(texture), "filter" in repr(texture)) == (wrap != Wrap.REPEAT, between != 1)
            assert restore(describe(texture)) == texture
    assert pl.Texture(texels, wrap=(Wrap.CLAMP, Wrap.CLAMP)) == pl.Texture(texels, wrap=Wrap.CLAMP)
    assert pl.Texture(texels, wrap=[1, 2]).wraps == (Wrap.CLAMP, Wrap.MIRROR)
    # Texels are a copy that cannot be written to.
    texels[...] = 7
    assert texture == again and not texture.texels.flags.writeable and not again.texels.flags.writeable
    assert texture.is_grey and not pl.Texture([[[1.0, 1.0, 2.0]]]).is_grey and pl.Texture(np.ones((1, 2, 3))).is_grey


def test_impossible_textures_are_refused():
    one, invalid, beyond = np.ones((1, 1, 1)), pl.errors.InvalidValueError, pl.errors.SceneError
    # A view that repeats one number: 268 451 840 texels without their memory.
    vast = np.broadcast_to(np.float32(0), (2**14 + 1, 2**14, 1))
    for texels, options, kind, said in (
        (one, {"wrap": "repeat"}, invalid, "Wrap.REPEAT or Wrap.CLAMP or Wrap.MIRROR"),
        (one, {"wrap": (Wrap.CLAMP,)}, invalid, "has 1 entries; it must be one Wrap, or a pair"),
        (one, {"wrap": (Wrap.CLAMP, None)}, invalid, "wrap is None"),
        (one, {"filter": 2}, invalid, "TextureFilter.NEAREST or TextureFilter.BILINEAR"),
        (np.zeros((2, 2, 4)), {}, invalid, "drop alpha"),
        (np.zeros((2, 2, 3), dtype=np.uint8), {}, invalid, "from_image"),
        (np.zeros((0, 2, 3)), {}, beyond, "at least 1 row"),
        (-0.1 * one, {}, beyond, "0 or more"),
        (np.nan * one, {}, beyond, "finite"),
        (1e39 * one, {}, beyond, "finite"),
        (vast, {}, beyond, "16385 x 16384 .* at most 268435456, so"),
    ):
        with pytest.raises(kind, match=said):
            pl.Texture(texels, **options)


def decoded(code, white=255):
    # IEC 61966-2-1
    s = code / white
    return s / 12.92 if s <= 0.04045 else ((s + 0.055) / 1.055) ** 2.4


def test_every_mode_of_pillow_is_decoded(tmp_path):
    for mode, colour, expected in (
        ("RGB", (255, 128, 0), [1.0, decoded(128), 0.0]),
        ("RGBA", (255, 128, 0, 3), [1.0, decoded(128), 0.0]),
        ("L", 10, [decoded(10)]),
        ("LA", (10, 0), [decoded(10)]),
        ("1", 1, [1.0]),
        ("I;16", 30000, [decoded(30000, 65535)]),
        ("I", 70000, [1.0]),
        ("I", -5, [0.0]),
        ("F", 2.5, [2.5]),
    ):
        texels = pl.Texture.from_image(PIL.Image.new(mode, (3, 2), colour)).texels
        assert texels.shape == (2, 3, len(expected)), mode
        np.testing.assert_allclose(texels[1, 2], expected, rtol=EPS, err_msg=mode)
    palette = PIL.Image.new("RGB", (2, 1), (0, 255, 0)).convert("P")
    np.testing.assert_allclose(pl.Texture.from_image(palette).texels[0, 1], [0, 1, 0])
    # Row 0 is the top of the image.
    image = PIL.Image.new("RGB", (2, 2))
    image.putpixel((1, 0), (255, 0, 0))
    image.save(tmp_path / "corner.png")
    for texture in (pl.Texture.from_image(image), pl.Texture.load(tmp_path / "corner.png")):
        assert texture.texels[0, 1].tolist() == [1, 0, 0]
        assert texture.texels.sum() == 1


def test_files_that_are_no_images_are_named(tmp_path):
    (tmp_path / "broken.png").write_bytes(b"no image")
    for name in ("absent.png", "broken.png"):
        with pytest.raises(pl.errors.FileError, match=name):
            pl.Texture.load(tmp_path / name)
    whole = io.BytesIO()
    noise = np.random.default_rng(0).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    PIL.Image.fromarray(noise).save(whole, "PNG")
    # An image that is opened lazily and damaged.
    damaged = PIL.Image.open(io.BytesIO(whole.getvalue()[:3000]))
    with pytest.raises(pl.errors.FileError, match="cannot be decoded"):
        pl.Texture.from_image(damaged)
    with pytest.raises(pl.errors.InvalidValueError, match="Pillow"):
        pl.Texture.from_image(noise)
    # Options are kept or refused.
    image = PIL.Image.new("RGB", (1, 1))
    image.save(tmp_path / "a.png")
    for make in (lambda **k: pl.Texture.load(tmp_path / "a.png", **k), lambda **k: pl.Texture.from_image(image, **k)):
        for channel in (-1, 4, 1.0, "R", True):
            with pytest.raises(pl.errors.InvalidValueError, match="channel is"):
                make(channel=channel)
        with pytest.raises(pl.errors.InvalidValueError, match="Encoding.SRGB or Encoding.LINEAR"):
            make(encoding="sRGB")
        made = make(wrap=Wrap.MIRROR, filter=TextureFilter.NEAREST)
        assert (made.wrap, made.filter) == (Wrap.MIRROR, TextureFilter.NEAREST)


CODES = np.random.default_rng(3).integers(0, 256, (4, 5, 4), dtype=np.uint8)


def test_each_channel_alone(tmp_path):
    for mode, channel in itertools.product(("RGBA", "RGB", "LA", "L"), range(4)):
        count = len(mode)
        stored = CODES[:, :, :count]
        image = PIL.Image.fromarray(stored[:, :, 0] if count == 1 else stored)
        assert image.mode == mode
        image.save(tmp_path / "a.png")
        if channel == 3:
            codes = stored[:, :, -1] if mode.endswith("A") else np.full((4, 5), 255)
        else:
            codes = stored[:, :, channel if mode.startswith("RGB") else 0]
        for encoding in Encoding:
            linear = codes / 255 if channel == 3 or encoding is Encoding.LINEAR else srgb_to_linear(codes / 255)
            for texture in (
                pl.Texture.from_image(image, encoding=encoding, channel=channel),
                pl.Texture.load(tmp_path / "a.png", encoding=encoding, channel=channel),
            ):
                assert texture.texels.shape == (4, 5, 1)
                # A file is decoded in float32: a power of 2.4 costs a few roundings.
                np.testing.assert_allclose(texture.texels[:, :, 0], linear, rtol=4 * EPS, err_msg=f"{mode} {channel}")


def test_a_transparent_colour_is_alpha(tmp_path):
    for mode in ("L", "RGB", "P"):
        image = PIL.Image.new("RGB", (2, 1), (9, 9, 9))
        image.putpixel((1, 0), (200, 200, 200))
        image = image.quantize(2) if mode == "P" else image.convert(mode)
        image.save(tmp_path / "a.png", transparency=(200,) * 3 if mode == "RGB" else image.getpixel((1, 0)))
        for texture in (
            pl.Texture.from_image(PIL.Image.open(tmp_path / "a.png"), channel=3),
            pl.Texture.load(tmp_path / "a.png", channel=3),
        ):
            assert texture.texels[0, :, 0].tolist() == [1, 0], mode
    # Alpha that an image lacks is 1.
    for mode, colour in (("I;16", 30000), ("F", 2.5), ("1", 0), ("CMYK", (0, 0, 0, 9))):
        texels = pl.Texture.from_image(PIL.Image.new(mode, (3, 2), colour), channel=3).texels
        assert texels.shape == (2, 3, 1) and (texels == 1).all(), mode
    # 100 / 200 and 64 / 128, which Pillow rounds to a code of 8 bits.
    for mode, colour in (("RGBa", (100, 50, 0, 200)), ("La", (64, 128))):
        image = PIL.Image.new(mode, (1, 1), colour)
        red, alpha = (pl.Texture.from_image(image, encoding=Encoding.LINEAR, channel=c).texels for c in (0, 3))
        assert red[0, 0, 0] == pytest.approx(0.5, abs=1 / 255)
        assert alpha[0, 0, 0] == pytest.approx(colour[-1] / 255, rel=EPS)


def test_16_bits_keep_all_of_them_and_floats_are_linear(tmp_path):
    codes = np.random.default_rng(4).integers(0, 65536, (3, 4, 3)).astype(np.uint16)
    for path in (tmp_path / "a.png", tmp_path / "a.tif"):
        images.write_16bit(path, codes)
        data = pl.Texture.load(path, encoding=Encoding.LINEAR)
        np.testing.assert_array_equal(np.rint(data.texels * 65535), codes)
        np.testing.assert_allclose(pl.Texture.load(path).texels, srgb_to_linear(codes / 65535), rtol=4 * EPS)
    # Floats are linear whatever the encoding.
    written = np.random.default_rng(5).uniform(0, 50, (2, 3, 4)).astype(np.float32)
    images.write_channels(tmp_path / "a.exr", dict(zip("RGBA", np.moveaxis(written, 2, 0), strict=True)))
    grey = PIL.Image.fromarray(written[:, :, 0], "F")
    for encoding in Encoding:
        np.testing.assert_array_equal(pl.Texture.load(tmp_path / "a.exr", encoding=encoding).texels, written[:, :, :3])
        opacity = pl.Texture.load(tmp_path / "a.exr", encoding=encoding, channel=3)
        np.testing.assert_array_equal(opacity.texels[:, :, 0], written[:, :, 3])
        found = pl.Texture.from_image(grey, encoding=encoding).texels
        np.testing.assert_array_equal(found[:, :, 0], written[:, :, 0])
    # Radiance's RGBE: a pixel is mantissa / 256 x 2^(exponent - 128).
    pixels = bytes([128, 64, 32, 129, 0, 0, 0, 0])
    (tmp_path / "a.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n" + pixels)
    # The middle of a step of mantissa may be meant, too: half a step of 1 / 256 x 2.
    np.testing.assert_allclose(pl.Texture.load(tmp_path / "a.hdr").texels[0, 0], [1, 0.5, 0.25], atol=1 / 256)
    assert (pl.Texture.load(tmp_path / "a.hdr").texels[0, 1] == 0).all()


def png_header(width, height):
    """A PNG file that ends after saying how large it is."""
    head = b"IHDR" + width.to_bytes(4, "big") + height.to_bytes(4, "big") + bytes([8, 0, 0, 0, 0])
    return b"\x89PNG\r\n\x1a\n\x00\x00\x00\r" + head + zlib.crc32(head).to_bytes(4, "big") + b"\x00\x00\x00\x00IDAT"


def test_a_file_that_is_too_large_is_refused_by_its_header(tmp_path, monkeypatch):
    (tmp_path / "huge.png").write_bytes(png_header(2**14, 2**14 + 1))
    said = r"huge.png' has 16385 x 16384 pixels; .* at most 268435456 .* scale it down"
    with pytest.raises(pl.errors.FileError, match=said):
        pl.Texture.load(tmp_path / "huge.png", limits=pl.images.FileLimits(memory=2**40))
    # One within the limit is read, and found to be without pixels.
    (tmp_path / "empty.png").write_bytes(png_header(64, 64))
    with pytest.raises(pl.errors.FileError, match="damaged"):
        pl.Texture.load(tmp_path / "empty.png")
    # The limit holds for all that texels come from.
    monkeypatch.setattr(module, "MAX_TEXELS", 6)
    for columns in (3, 4):
        image, texels = PIL.Image.new("RGB", (columns, 2)), np.ones((2, columns, 1))
        image.save(tmp_path / "a.png")
        for make, source in (
            (pl.Texture, texels),
            (pl.Texture, texels.tolist()),
            (pl.Texture.from_image, image),
            (pl.Texture.load, tmp_path / "a.png"),
        ):
            if columns == 3:
                assert make(source).texels.shape[:2] == (2, columns)
            else:
                with pytest.raises(pl.PlenopticError, match=r"2 x 4 .* at most 6.* scale it down"):
                    make(source)


def overlaps(n):
    """(m, n): the share of each of n equal intervals in the mean over each of m = n // 2, found by intersection."""
    m = max(n // 2, 1)
    old, new = np.arange(n + 1) / n, np.arange(m + 1) / m
    shared = np.minimum(new[1:, None], old[None, 1:]) - np.maximum(new[:-1, None], old[None, :-1])
    return m * np.maximum(shared, 0)


@settings(max_examples=100)
@given(
    hnp.arrays(
        np.float32,
        st.tuples(st.integers(1, 9), st.integers(1, 9), st.sampled_from([1, 3])),
        elements=st.floats(0, 2.0**127, width=32),
    )
)
def test_halved_is_the_mean_over_areas_and_keeps_the_mean(texels):
    half = pl.Texture(texels, wrap=Wrap.CLAMP, filter=TextureFilter.NEAREST).halved()
    assert (half.wrap, half.filter) == (Wrap.CLAMP, TextureFilter.NEAREST)
    rows, columns, _ = texels.shape
    assert half.texels.shape[:2] == (max(rows // 2, 1), max(columns // 2, 1))
    expected = np.einsum("ir,jc,rck->ijk", overlaps(rows), overlaps(columns), texels.astype(np.float64))
    # One rounding to float32, which below its smallest normal number is absolute; the reference cancels to 1e-15.
    tiny = float(np.finfo(np.float32).smallest_subnormal)
    np.testing.assert_allclose(half.texels, expected, rtol=EPS, atol=tiny + 1e-14 * float(texels.max()))
    mean = texels.mean(dtype=np.float64)
    assert half.texels.mean(dtype=np.float64) == pytest.approx(mean, rel=EPS, abs=tiny)


def test_halved_is_the_mean_over_areas_again_and_again():
    texture = pl.Texture(np.random.default_rng(6).uniform(size=(37, 100, 3)))
    mean = texture.texels.mean(axis=(0, 1), dtype=np.float64)
    for size in ((18, 50), (9, 25), (4, 12), (2, 6), (1, 3), (1, 1), (1, 1)):
        texture = texture.halved()
        assert texture.texels.shape[:2] == size
    # Seven roundings.
    np.testing.assert_allclose(texture.texels[0, 0], mean, rtol=7 * EPS)
