import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import plenoptic as pl

SHARE = st.floats(0, 1)
RADIANCE = st.floats(0, 1e300)


def colours(part):
    return part | st.tuples(part, part, part)


@settings(max_examples=50, deadline=None)
@given(colours(SHARE), colours(RADIANCE), st.booleans())
def test_materials_keep_their_numbers_compare_and_pickle(albedo, radiance, two_sided):
    for material in (pl.Lambertian(albedo), pl.Emissive(radiance, two_sided), pl.ConstantBackground(radiance)):
        again = pickle.loads(pickle.dumps(material))
        assert again == material and hash(again) == hash(material)
    assert pl.Lambertian(albedo).albedo == albedo
    assert pl.Emissive(radiance).radiance == radiance


@settings(max_examples=50, deadline=None)
@given(colours(st.floats(allow_nan=True, allow_infinity=True)))
def test_nothing_reflects_more_than_it_gets(albedo):
    possible = all(0 <= part <= 1 for part in np.ravel(albedo))
    if possible:
        pl.Lambertian(albedo)
    else:
        with pytest.raises(pl.InvalidValueError, match="albedo"):
            pl.Lambertian(albedo)


@pytest.mark.parametrize("make", [pl.Emissive, pl.ConstantBackground])
@pytest.mark.parametrize(
    "radiance", [-1, (1, 1, -1e-300), float("inf"), float("nan"), (1, 2), "white", None, [[1, 2, 3]], [1, [2, 3], 4]]
)
def test_impossible_radiances_are_refused(make, radiance):
    with pytest.raises(pl.InvalidValueError, match="radiance"):
        make(radiance)


def test_a_texture_that_reflects_too_much_is_refused():
    assert pl.Lambertian(pl.Texture(np.ones((2, 2, 3)))).albedo.is_grey
    with pytest.raises(pl.SceneError, match=r"1\.5.*scale"):
        pl.Lambertian(pl.Texture(np.full((2, 2, 3), 1.5)))


def test_arrays_and_lists_become_plain_numbers():
    assert pl.Lambertian(np.array([0.1, 0.2, 0.3])) == pl.Lambertian([0.1, 0.2, 0.3]) == pl.Lambertian((0.1, 0.2, 0.3))
    assert type(pl.Emissive(np.float32(2)).radiance) is float
    assert pl.Emissive(1) == pl.Emissive(1.0) != pl.Emissive(1.0, two_sided=True)


@pytest.mark.parametrize("two_sided", ["no", 1, None, [True], np.array([True, False])])
def test_two_sided_is_yes_or_no(two_sided):
    with pytest.raises(pl.InvalidValueError, match="two_sided is .*; it must be True or False"):
        pl.Emissive(1.0, two_sided=two_sided)
    assert pl.Emissive(1.0, np.bool_(True)).two_sided is True
