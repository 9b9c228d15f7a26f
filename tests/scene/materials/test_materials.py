import dataclasses
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import plenoptic as pl

SHARE = st.floats(0, 1)
RADIANCE = st.floats(0, 1e300)
POSITIVE = st.floats(1e-300, 1e300)
INDEX = st.builds(complex, st.floats(1e-30, 1e30), st.floats(0, 1e30))
GREY_MAP = pl.Texture(np.full((2, 3, 1), 0.5))
COLOUR_MAP = pl.Texture(np.full((2, 3, 3), [0.25, 0.5, 1.0]))


def colours(part):
    return part | st.tuples(part, part, part)


SOME = st.one_of(
    st.builds(pl.Lambertian, colours(SHARE)),
    st.builds(pl.materials.RoughDiffuse, colours(SHARE), SHARE),
    st.builds(pl.Conductor, colours(SHARE), SHARE, st.none() | colours(INDEX)),
    st.builds(pl.Dielectric, POSITIVE, SHARE, colours(RADIANCE), POSITIVE),
    st.builds(pl.materials.ThinGlass, POSITIVE, colours(SHARE)),
    st.builds(
        pl.MetallicRoughness,
        colours(SHARE),
        SHARE,
        SHARE,
        emission=colours(RADIANCE),
        two_sided=st.booleans(),
        opacity=SHARE,
        cutoff=st.none() | SHARE,
    ),
    st.builds(pl.Emissive, colours(RADIANCE), st.booleans()),
    st.builds(pl.lights.ConstantBackground, colours(RADIANCE)),
)

TEXTURED = [
    pl.Lambertian(COLOUR_MAP),
    pl.materials.RoughDiffuse(COLOUR_MAP, 0.25),
    pl.Emissive(COLOUR_MAP),
    pl.MetallicRoughness(
        COLOUR_MAP, GREY_MAP, GREY_MAP, normal_map=COLOUR_MAP, emission=COLOUR_MAP, opacity=GREY_MAP, cutoff=0.5
    ),
]


@settings(max_examples=200)
@given(SOME)
def test_materials_compare_hash_and_pickle(material):
    again = pickle.loads(pickle.dumps(material))
    assert again == material and hash(again) == hash(material)
    # What is made of its own fields is the same, and nothing was rounded or put in another order.
    same = type(material)(**{f.name: getattr(material, f.name) for f in dataclasses.fields(material)})
    assert same == material and repr(same) == repr(material)


@pytest.mark.parametrize("material", TEXTURED)
def test_textured_materials_compare_hash_and_pickle(material):
    again = pickle.loads(pickle.dumps(material))
    assert again == material and hash(again) == hash(material)
    name = dataclasses.fields(material)[0].name
    assert dataclasses.replace(material, **{name: pl.Texture(np.zeros((2, 3, 3)))}) != material


DIFFERENT = [
    pl.Lambertian(0.5),
    pl.materials.RoughDiffuse(0.5, 0.0),
    pl.materials.RoughDiffuse(0.5, 0.5),
    pl.Emissive(0.5),
    pl.Emissive(0.5, two_sided=True),
    pl.Conductor(0.5),
    pl.Conductor(0.5, 0.1),
    pl.Conductor(0.5, index=1.5),
    pl.Conductor(0.5, index=1.5 + 1j),
    pl.Conductor((0.5, 0.5, 0.5)),
    pl.Dielectric(),
    pl.Dielectric(1.4),
    pl.Dielectric(exterior=1.5),
    pl.Dielectric(absorption=1.5),
    pl.Dielectric(alpha=0.5),
    pl.materials.ThinGlass(),
    pl.materials.ThinGlass(transmittance=0.5),
    pl.MetallicRoughness(),
    pl.MetallicRoughness(opacity=0.5),
    pl.MetallicRoughness(cutoff=0.5),
    pl.MetallicRoughness(emission=0.5),
    pl.MetallicRoughness(emission=0.5, two_sided=True),
    pl.MetallicRoughness(normal_map=COLOUR_MAP),
    pl.MetallicRoughness(metallic=0.5),
    pl.MetallicRoughness(metallic=GREY_MAP),
    pl.MetallicRoughness(roughness=GREY_MAP),
]


def test_different_materials_are_different():
    for i, one in enumerate(DIFFERENT):
        assert [one == other for other in DIFFERENT] == [i == j for j in range(len(DIFFERENT))]
    assert len(set(DIFFERENT)) == len(DIFFERENT)


@pytest.mark.parametrize(
    ("material", "shown"),
    [
        (pl.materials.RoughDiffuse((0.5, 0.25, 1)), "RoughDiffuse(albedo=(0.5, 0.25, 1.0))"),
        (pl.Conductor(), "Conductor()"),
        (pl.Conductor(index=[1 + 2j, 2, 3]), "Conductor(index=((1+2j), (2+0j), (3+0j)))"),
        (pl.Dielectric(1.33, exterior=1.5), "Dielectric(index=1.33, exterior=1.5)"),
        (pl.materials.ThinGlass(1.6), "ThinGlass(index=1.6)"),
        (
            pl.MetallicRoughness(1, roughness=GREY_MAP, cutoff=0.5, two_sided=True),
            "MetallicRoughness(base=1.0, roughness=Texture(texels=<2 x 3 x 1 float32>), two_sided=True, cutoff=0.5)",
        ),
    ],
)
def test_only_what_differs_from_the_defaults_is_shown(material, shown):
    assert repr(material) == shown


def test_materials_cannot_be_changed():
    for material in DIFFERENT:
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(material, dataclasses.fields(material)[0].name, 0.1)


# ---- what is refused ----

ALBEDOS = [
    (pl.Lambertian, "albedo"),
    (pl.materials.RoughDiffuse, "albedo"),
    (pl.Conductor, "reflectance"),
    (pl.materials.ThinGlass, "transmittance"),
    (pl.MetallicRoughness, "base"),
]


@settings(max_examples=50)
@given(st.sampled_from(ALBEDOS), colours(st.floats(allow_nan=True, allow_infinity=True)))
def test_nothing_reflects_more_than_it_gets(field, albedo):
    make, name = field
    if all(0 <= part <= 1 for part in np.ravel(albedo)):
        assert getattr(make(**{name: albedo}), name) == albedo
    else:
        with pytest.raises(pl.errors.InvalidValueError, match=name):
            make(**{name: albedo})


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (pl.Emissive, "radiance"),
        (pl.lights.ConstantBackground, "radiance"),
        (pl.MetallicRoughness, "emission"),
        (pl.Dielectric, "absorption"),
    ],
)
@pytest.mark.parametrize(
    "radiance", [-1, (1, 1, -1e-300), float("inf"), float("nan"), (1, 2), "white", None, [[1, 2, 3]], [1, [2, 3], 4]]
)
def test_impossible_radiances_and_absorptions_are_refused(make, name, radiance):
    with pytest.raises(pl.errors.InvalidValueError, match=name):
        make(**{name: radiance})


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (pl.materials.RoughDiffuse, "roughness"),
        (pl.Conductor, "alpha"),
        (pl.Dielectric, "alpha"),
        (pl.MetallicRoughness, "metallic"),
        (pl.MetallicRoughness, "roughness"),
        (pl.MetallicRoughness, "opacity"),
        (pl.MetallicRoughness, "cutoff"),
    ],
)
@pytest.mark.parametrize("share", [-1e-300, np.nextafter(1, 2), float("nan"), float("inf"), "half", (0.5, 0.5, 0.5)])
def test_shares_are_within_0_and_1(make, name, share):
    with pytest.raises(pl.errors.InvalidValueError, match=name):
        make(**{name: share})
    for possible in (0, 1, 0.5, np.float32(0.25)):
        kept = getattr(make(**{name: possible}), name)
        assert kept == possible and type(kept) is float


@pytest.mark.parametrize(
    ("make", "name"), [(pl.Dielectric, "index"), (pl.Dielectric, "exterior"), (pl.materials.ThinGlass, "index")]
)
@pytest.mark.parametrize("index", [0, -1.5, float("nan"), float("inf"), "glass", 1.5 + 1j, (1.5, 1.5, 1.5)])
def test_indices_of_what_is_transparent_are_above_0(make, name, index):
    with pytest.raises(pl.errors.InvalidValueError, match=f"{name} is"):
        make(**{name: index})


@pytest.mark.parametrize("index", [0, 1j, -1 + 1j, 1 - 1j, complex("nan"), complex("inf"), (1, 1, -1j), (1, 2), "gold"])
def test_indices_of_metals_absorb(index):
    with pytest.raises(pl.errors.InvalidValueError, match="index is"):
        pl.Conductor(index=index)


def test_a_texture_that_reflects_too_much_is_refused():
    assert pl.Lambertian(pl.Texture(np.ones((2, 2, 3)))).albedo.is_grey
    for make in (pl.Lambertian, pl.materials.RoughDiffuse, pl.MetallicRoughness):
        with pytest.raises(pl.errors.SceneError, match=r"1\.5.*scale"):
            make(pl.Texture(np.full((2, 2, 3), 1.5)))
    assert pl.MetallicRoughness(emission=pl.Texture(np.full((2, 2, 3), 1.5))).emission.texels.max() == 1.5


@pytest.mark.parametrize("name", ["metallic", "roughness", "opacity"])
def test_textures_of_numbers_have_one_channel_within_0_and_1(name):
    assert getattr(pl.MetallicRoughness(**{name: GREY_MAP}), name) == GREY_MAP
    with pytest.raises(pl.errors.InvalidValueError, match=f"{name} is a texture of 3 channels; it must have 1"):
        pl.MetallicRoughness(**{name: COLOUR_MAP})
    with pytest.raises(pl.errors.SceneError, match=rf"{name} has texels up to 1\.5"):
        pl.MetallicRoughness(**{name: pl.Texture(np.full((2, 2, 1), 1.5))})


@pytest.mark.parametrize("normal_map", [GREY_MAP, 0.5, (0.5, 0.5, 1.0), np.ones((1, 1, 3))])
def test_normal_maps_are_textures_of_three_channels(normal_map):
    with pytest.raises(
        pl.errors.InvalidValueError, match="normal_map is .*; it must be a texture of 3 channels, or None"
    ):
        pl.MetallicRoughness(normal_map=normal_map)


@pytest.mark.parametrize("make", [pl.Conductor, pl.materials.ThinGlass, pl.Dielectric])
def test_what_takes_no_texture_says_so(make):
    name = {pl.Conductor: "reflectance", pl.materials.ThinGlass: "transmittance", pl.Dielectric: "absorption"}[make]
    with pytest.raises(pl.errors.InvalidValueError, match=name):
        make(**{name: COLOUR_MAP})


def test_arrays_and_lists_become_plain_numbers():
    assert pl.Lambertian(np.array([0.1, 0.2, 0.3])) == pl.Lambertian([0.1, 0.2, 0.3]) == pl.Lambertian((0.1, 0.2, 0.3))
    assert type(pl.Emissive(np.float32(2)).radiance) is float
    assert pl.Emissive(1) == pl.Emissive(1.0) != pl.Emissive(1.0, two_sided=True)
    assert pl.Conductor(np.float64(1), index=np.array([1 + 1j, 2, 3])) == pl.Conductor(index=(1 + 1j, 2 + 0j, 3 + 0j))
    assert type(pl.Conductor(index=np.complex64(1 + 1j)).index) is complex
    assert type(pl.Dielectric(np.float32(1.5)).index) is float


@pytest.mark.parametrize("make", [pl.Emissive, pl.MetallicRoughness])
@pytest.mark.parametrize("two_sided", ["no", 1, None, [True], np.array([True, False])])
def test_two_sided_is_yes_or_no(make, two_sided):
    with pytest.raises(pl.errors.InvalidValueError, match="two_sided is .*; it must be True or False"):
        make(two_sided=two_sided)
    assert make(two_sided=np.bool_(True)).two_sided is True
