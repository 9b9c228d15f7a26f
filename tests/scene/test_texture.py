import io
import pickle

import numpy as np
import PIL.Image
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import plenoptic as pl

TEXELS = hnp.arrays(
    np.float32,
    st.tuples(st.integers(1, 5), st.integers(1, 5), st.sampled_from([1, 3])),
    elements=st.floats(0, 1e6, width=32),
)


@settings(max_examples=50, deadline=None)
@given(TEXELS)
def test_a_texture_is_a_read_only_copy_that_compares_hashes_and_pickles(texels):
    texture = pl.Texture(texels)
    again = pickle.loads(pickle.dumps(texture))
    assert again == texture and hash(again) == hash(texture)
    assert not texture.texels.flags.writeable and not again.texels.flags.writeable
    texels[...] = 7
    assert texture == again
    assert texture.is_grey == (texture.texels == texture.texels[..., :1]).all()


@pytest.mark.parametrize(
    ("texels", "kind", "said"),
    [
        (np.zeros((2, 2)), pl.InvalidValueError, "shape"),
        (np.zeros((2, 2, 4)), pl.InvalidValueError, "drop alpha"),
        (np.zeros((2, 2, 3), dtype=np.uint8), pl.InvalidValueError, "from_image"),
        (np.zeros((0, 2, 3)), pl.SceneError, "at least 1 row"),
        (np.full((1, 1, 1), -0.1), pl.SceneError, "0 or more"),
        (np.full((1, 2, 1), np.nan), pl.SceneError, "finite"),
        (np.full((1, 1, 3), np.inf), pl.SceneError, "finite"),
        (np.full((1, 1, 3), 1e39), pl.SceneError, "finite"),
    ],
)
def test_impossible_texels_are_refused(texels, kind, said):
    with pytest.raises(kind, match=said):
        pl.Texture(texels)


def decoded(code, white=255):
    # IEC 61966-2-1
    s = code / white
    return s / 12.92 if s <= 0.04045 else ((s + 0.055) / 1.055) ** 2.4


@pytest.mark.parametrize(
    ("mode", "colour", "expected"),
    [
        ("RGB", (255, 128, 0), [1.0, decoded(128), 0.0]),
        ("RGBA", (255, 128, 0, 3), [1.0, decoded(128), 0.0]),
        ("L", 10, [decoded(10)]),
        ("LA", (10, 0), [decoded(10)]),
        ("1", 1, [1.0]),
        ("I;16", 30000, [decoded(30000, 65535)]),
        ("F", 2.5, [2.5]),
    ],
)
def test_every_mode_of_pillow_is_decoded(mode, colour, expected):
    texels = pl.Texture.from_image(PIL.Image.new(mode, (3, 2), colour)).texels
    assert texels.shape == (2, 3, len(expected))
    np.testing.assert_allclose(texels[1, 2], expected, rtol=np.finfo(np.float32).eps)


def test_a_palette_is_resolved():
    image = PIL.Image.new("RGB", (2, 1), (0, 255, 0)).convert("P")
    np.testing.assert_allclose(pl.Texture.from_image(image).texels[0, 1], [0, 1, 0])


def test_row_0_is_the_top_of_the_image(tmp_path):
    image = PIL.Image.new("RGB", (2, 2))
    image.putpixel((1, 0), (255, 0, 0))
    image.save(tmp_path / "corner.png")
    for texture in (pl.Texture.from_image(image), pl.Texture.load(tmp_path / "corner.png")):
        assert texture.texels[0, 1].tolist() == [1, 0, 0]
        assert texture.texels.sum() == 1


def test_files_that_are_no_images_are_named(tmp_path):
    with pytest.raises(pl.FileError, match=r"absent\.png"):
        pl.Texture.load(tmp_path / "absent.png")
    (tmp_path / "broken.png").write_bytes(b"no image")
    with pytest.raises(pl.FileError, match=r"broken\.png"):
        pl.Texture.load(tmp_path / "broken.png")


def test_a_lazily_opened_damaged_image_is_refused():
    whole = io.BytesIO()
    noise = np.random.default_rng(0).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    PIL.Image.fromarray(noise).save(whole, "PNG")
    damaged = PIL.Image.open(io.BytesIO(whole.getvalue()[:3000]))
    with pytest.raises(pl.FileError, match="cannot be decoded"):
        pl.Texture.from_image(damaged)
    with pytest.raises(pl.InvalidValueError, match="Pillow"):
        pl.Texture.from_image(noise)
