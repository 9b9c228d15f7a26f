import io
import itertools
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


def test_a_pair_of_wraps_and_grey_are_known():
    one = np.ones((2, 1, 1))
    assert pl.Texture(one, wrap=(Wrap.CLAMP, Wrap.CLAMP)) == pl.Texture(one, wrap=Wrap.CLAMP) != pl.Texture(one)
    assert pl.Texture(one, wrap=[1, 2]).wraps == (Wrap.CLAMP, Wrap.MIRROR)
    assert pl.Texture(one, wrap=Wrap.MIRROR).wraps == (Wrap.MIRROR, Wrap.MIRROR)
    for how in ({"wrap": (Wrap.MIRROR, Wrap.CLAMP)}, {"filter": TextureFilter.NEAREST}):
        texture = pl.Texture(one, **how)
        assert restore(describe(texture)) == texture
    assert not pl.Texture([[[1.0, 1.0, 2.0]]]).is_grey and pl.Texture(np.ones((1, 2, 3))).is_grey


def test_impossible_textures_are_refused():
    one = np.ones((1, 1, 1))
    # A view that repeats one number: 268 451 840 texels without their memory.
    vast = np.broadcast_to(np.float32(0), (2**14 + 1, 2**14, 1))
    for texels, options, said in (
        (one, {"wrap": "repeat"}, "Wrap.REPEAT or Wrap.CLAMP or Wrap.MIRROR"),
        (one, {"wrap": (Wrap.CLAMP,)}, "has 1 entries; it must be one Wrap, or a pair"),
        (one, {"filter": 2}, "TextureFilter.NEAREST or TextureFilter.BILINEAR"),
        (np.zeros((2, 2, 4)), {}, "drop alpha"),
        (np.zeros((0, 2, 3)), {}, "at least 1 row"),
        (-0.1 * one, {}, "0 or more"),
        (1e39 * one, {}, "finite"),
        (vast, {}, "16385 x 16384 .* at most 268435456, so"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=said):
            pl.Texture(texels, **options)


def decoded(code, white=255):
    # IEC 61966-2-1
    s = code / white
    return s / 12.92 if s <= 0.04045 else ((s + 0.055) / 1.055) ** 2.4


def test_every_mode_of_pillow_is_decoded():
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


def test_files_that_are_no_images_are_named(tmp_path):
    with pytest.raises(pl.errors.FileError, match="absent.png"):
        pl.Texture.load(tmp_path / "absent.png")
    whole = io.BytesIO()
    noise = np.random.default_rng(0).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    PIL.Image.fromarray(noise).save(whole, "PNG")
    # An image that is opened lazily and damaged.
    damaged = PIL.Image.open(io.BytesIO(whole.getvalue()[:3000]))
    with pytest.raises(pl.errors.FileError, match="cannot be decoded"):
        pl.Texture.from_image(damaged)
    # Options are kept or refused.
    image = PIL.Image.new("RGB", (1, 1))
    image.save(tmp_path / "a.png")
    for make, source in ((pl.Texture.load, tmp_path / "a.png"), (pl.Texture.from_image, image)):
        for channel in (-1, 4, 1.0):
            with pytest.raises(pl.errors.InvalidValueError, match="channel is"):
                make(source, channel=channel)
        made = make(source, wrap=Wrap.MIRROR, filter=TextureFilter.NEAREST)
        assert (made.wrap, made.filter) == (Wrap.MIRROR, TextureFilter.NEAREST)


CODES = np.random.default_rng(3).integers(0, 256, (4, 5, 4), dtype=np.uint8)


def test_each_channel_alone(tmp_path):
    for mode, channel in itertools.product(("RGBA", "RGB", "LA", "L"), range(4)):
        stored = CODES[:, :, : len(mode)]
        image = PIL.Image.fromarray(stored[:, :, 0] if mode == "L" else stored)
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


def test_floats_are_linear_whatever_the_encoding(tmp_path):
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
    # The limit holds for all that texels come from.
    monkeypatch.setattr(module, "MAX_TEXELS", 6)
    for columns in (3, 4):
        image, texels = PIL.Image.new("RGB", (columns, 2)), np.ones((2, columns, 1))
        image.save(tmp_path / "a.png")
        for make, source in (
            (pl.Texture, texels),
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
