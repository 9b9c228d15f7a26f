"""Textures at points, against exact arithmetic."""

import itertools
import math
from fractions import Fraction

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

import plenoptic as pl
from plenoptic.core.numba.jit import kernel
from plenoptic.scene.scene_record import atlas
from plenoptic.scene.textures import texture_records
from plenoptic.scene.textures.kernels.lookup import fill_texel
from plenoptic.scene.textures.texture import TextureFilter, Wrap

WRAPS = [(u, v) for u in Wrap for v in Wrap]


@kernel
def fill_all(values, texels, row, points):
    for i in range(points.shape[0]):
        fill_texel(values[i], texels, row, points[i, 0], points[i, 1])


def looked_up(texture, points, *, channels=3):
    """(n, channels): the texture between two others in an atlas, whose neighbours no lookup may see."""
    fence = pl.Texture(np.full((3, 5, 3), 1e30) * [1, 2, 3])
    texels, rows = atlas([fence, texture, fence])
    points = np.array(points, dtype=np.float64).reshape(-1, 2)
    values = np.full((len(points), channels), np.nan)
    fill_all(values, texels, rows[1], points)
    return values


def folded(i, n, wrap):
    """The index of the texel that stands at place i of an endless row."""
    if wrap == Wrap.REPEAT:
        return i % n
    if wrap == Wrap.CLAMP:
        return min(max(i, 0), n - 1)
    i %= 2 * n
    return i if i < n else 2 * n - 1 - i


def exact(texture, s, t):
    """The texture at (s, t) in rational arithmetic, texel by texel as the wrap modes define it."""
    rows, columns, channels = texture.texels.shape
    wrap_u, wrap_v = texture.wraps

    def texel(i, j):  # column and row from below, on an endless plane
        return texture.texels[rows - 1 - folded(j, rows, wrap_v), folded(i, columns, wrap_u)]

    x, y = Fraction(s) * columns, Fraction(t) * rows
    if texture.filter is TextureFilter.NEAREST:
        return texel(math.floor(x), math.floor(y)).astype(np.float64)
    x, y = x - Fraction(1, 2), y - Fraction(1, 2)
    i, j = math.floor(x), math.floor(y)
    fx, fy = x - i, y - j
    found = []
    for k in range(channels):
        p = [[Fraction(float(texel(i + a, j + b)[k])) for a in (0, 1)] for b in (0, 1)]
        found.append(float((1 - fy) * ((1 - fx) * p[0][0] + fx * p[0][1]) + fy * ((1 - fx) * p[1][0] + fx * p[1][1])))
    return np.array(found)


def random_texture(seed, shape, **how):
    return pl.Texture(np.random.default_rng(seed).uniform(size=shape), **how)


# In between the borders of texels, of which there are up to 8, and without rounding.
inside = st.integers(-(2**50), 2**50).map(lambda k: (2 * k + 1) * 2.0**-31)
borders = st.integers(-24, 24).map(lambda k: k / 8)
near = st.floats(-3, 3) | borders
anywhere = near | st.floats(-1e15, 1e15) | st.integers(-(2**40), 2**40).map(lambda k: k / 16)


@settings(max_examples=400)
@given(
    s=anywhere,
    t=anywhere,
    wrap=st.sampled_from(WRAPS),
    shape=st.tuples(st.integers(1, 5), st.integers(1, 5), st.sampled_from([1, 3])),
)
def test_bilinear_lookups_are_exact(s, t, wrap, shape):
    texture = random_texture(1, shape, wrap=wrap)
    # Each coordinate costs a rounding of s - floor(s) and one of the place, which n scales: n eps each. A texture
    # in [0, 1] changes by 1 from one texel to the next at most; the interpolation adds a few eps.
    tolerance = (2 * shape[0] + 2 * shape[1] + 6) * np.finfo(float).eps
    expected = np.broadcast_to(exact(texture, s, t), 3)
    np.testing.assert_allclose(looked_up(texture, (s, t))[0], expected, rtol=0, atol=tolerance)


POWERS_OF_TWO = st.tuples(st.sampled_from([1, 2, 4, 8]), st.sampled_from([1, 2, 4]), st.sampled_from([1, 3]))
WHOLE_TEXELS = st.tuples(inside, inside, st.sampled_from(WRAPS))
AT_BORDERS = st.tuples(borders, borders, st.sampled_from([Wrap.REPEAT, Wrap.CLAMP]))


@settings(max_examples=500)
@given(WHOLE_TEXELS | AT_BORDERS, POWERS_OF_TWO)
def test_nearest_lookups_are_exact_and_borders_belong_to_the_texel_above_and_to_the_right(place, shape):
    s, t, wrap = place
    # Powers of two scale without rounding.
    texture = random_texture(2, shape, wrap=wrap, filter=TextureFilter.NEAREST)
    np.testing.assert_array_equal(looked_up(texture, (s, t))[0], np.broadcast_to(exact(texture, s, t), 3))


WILD = [math.nan, math.inf, -math.inf, 1e15, -1e15, 1e300, -1e300, 5e-324, -5e-324, -1e-20, 0.0, -0.0, 1.0]
WILD += [np.nextafter(1.0, 0.0), np.nextafter(1.0, 2.0), 2.0**31, -(2.0**63), 2.0**64 + 1e5, 0.1 - 1e15]


def test_any_number_gives_a_value_of_the_texture():
    for shape, wrap, between in itertools.product(((1, 1, 3), (3, 5, 1), (257, 1, 3)), Wrap, TextureFilter):
        texture = random_texture(9, shape, wrap=wrap, filter=between)
        values = looked_up(texture, list(itertools.product(WILD, WILD)))
        # Interpolation may leave the range of its corners by rounding alone.
        low, high = texture.texels.min() - 1e-15, texture.texels.max() + 1e-15
        assert (values >= low).all() and (values <= high).all(), (shape, wrap, between)
    # A constant is constant to the last bit.
    points = np.random.default_rng(10).normal(size=(1000, 2)) * 10
    assert (looked_up(pl.Texture(np.full((3, 7, 3), 0.3)), points) == np.float32(0.3)).all()
    # Grey among colours.
    points = np.random.default_rng(11).uniform(-2, 2, (50, 2))
    for between in TextureFilter:
        grey = random_texture(12, (4, 3, 1), filter=between)
        colours = pl.Texture(np.repeat(grey.texels, 3, axis=2), filter=between)
        expected = looked_up(grey, points, channels=1)
        for texture in (grey, colours):
            np.testing.assert_array_equal(looked_up(texture, points, channels=1), expected)
            np.testing.assert_array_equal(looked_up(texture, points), np.repeat(expected, 3, axis=1))
    # A colour in a row of one is its first channel.
    texture = random_texture(13, (4, 3, 3))
    np.testing.assert_array_equal(looked_up(texture, points, channels=1), looked_up(texture, points)[:, :1])


def test_an_atlas_holds_every_texel_once():
    random = np.random.default_rng(15)
    textures = [
        pl.Texture(random.uniform(size=(2, 3, 3)), wrap=(Wrap.CLAMP, Wrap.MIRROR)),
        pl.Texture(random.uniform(size=(4, 1, 1)), filter=TextureFilter.NEAREST),
        pl.Texture(np.repeat(random.uniform(size=(2, 2, 1)), 3, axis=2)),
    ]
    texels, rows = atlas(textures)
    assert rows.tolist() == [(0, 2, 3, 3, 1, 2, 1), (18, 4, 1, 1, 0, 0, 0), (22, 2, 2, 1, 0, 0, 1)]
    assert (texels.dtype, rows.dtype) == (np.float32, texture_records.TEXTURE)
    joined = [textures[0].texels.ravel(), textures[1].texels.ravel(), textures[2].texels[..., 0].ravel()]
    np.testing.assert_array_equal(texels, np.concatenate(joined))
    # The kernels' numbers are those of the enums.
    assert list(Wrap) == [texture_records.REPEAT, texture_records.CLAMP, texture_records.MIRROR]
    assert texture_records.NEAREST == TextureFilter.NEAREST
    assert atlas([]) == (None, None)
