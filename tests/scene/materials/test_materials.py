import dataclasses
import pickle

import numpy as np
import pytest

import plenoptic as pl

GREY_MAP = pl.Texture(np.full((2, 3, 1), 0.5))
COLOUR_MAP = pl.Texture(np.full((2, 3, 3), [0.25, 0.5, 1.0]))


PLASTICS = [{}, {"opacity": 0.5}, {"cutoff": 0.5}, {"emission": (0.1, 2e3, 0.0)}, {"two_sided": True}]
PLASTICS += [{"normal_map": COLOUR_MAP}, {"metallic": 0.5}, {"metallic": GREY_MAP}, {"roughness": GREY_MAP}]
PLASTICS += [{"emission": 0.5}, {"emission": 0.5, "two_sided": True}, {"clearcoat": 0.5}]
DIFFERENT = [pl.MetallicRoughness(**fields) for fields in PLASTICS]
DIFFERENT += [pl.Lambertian(0.5), pl.Lambertian(COLOUR_MAP), pl.Emissive(0.5), pl.Emissive(0.5, two_sided=True)]
DIFFERENT += [pl.materials.RoughDiffuse(0.5, roughness) for roughness in (0.0, 0.5)]
DIFFERENT += [pl.Conductor(0.5), pl.Conductor((0.5, 0.5, 0.5)), pl.Conductor(0.5, 0.1), pl.Conductor(0.5, index=1.5)]
DIFFERENT += [pl.Dielectric(**fields) for fields in ({}, {"index": 1.4}, {"exterior": 1.5}, {"absorption": 1.5})]
DIFFERENT += [pl.Conductor(0.5, index=1.5 + 1j), pl.materials.RoughDiffuse(COLOUR_MAP, 0.25)]
DIFFERENT += [pl.lights.ConstantBackground((0.1, 1e300, 0.5)), pl.materials.ThinGlass(1e-300)]
DIFFERENT += [pl.Dielectric(alpha=0.5), pl.materials.ThinGlass(), pl.materials.ThinGlass(transmittance=0.5)]


def test_materials_compare_hash_and_pickle():
    for i, one in enumerate(DIFFERENT):
        assert [one == other for other in DIFFERENT] == [i == j for j in range(len(DIFFERENT))]
        again = pickle.loads(pickle.dumps(one))
        assert again == one and hash(again) == hash(one)
        # What is made of its own fields is the same, and nothing was rounded or put in another order.
        first, *_ = fields = [f.name for f in dataclasses.fields(one)]
        same = type(one)(**{name: getattr(one, name) for name in fields})
        assert same == one and repr(same) == repr(one)
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(one, first, 0.1)
    assert len(set(DIFFERENT)) == len(DIFFERENT)
    # A texture that reflects too much is refused.
    assert pl.Lambertian(pl.Texture(np.ones((2, 2, 3)))).albedo.is_grey
    for make in (pl.Lambertian, pl.materials.RoughDiffuse, pl.MetallicRoughness):
        with pytest.raises(pl.errors.SceneError, match=r"1\.5.*scale"):
            make(pl.Texture(np.full((2, 2, 3), 1.5)))
    assert pl.MetallicRoughness(emission=pl.Texture(np.full((2, 2, 3), 1.5))).emission.texels.max() == 1.5


INF, NAN = float("inf"), float("nan")
ALBEDOS = [-1e-300, np.nextafter(1, 2), NAN, INF, -INF, (0.5, 0.5, 1.1), (0.5, -0.1, 0.5), (0.5, 0.5, NAN), (1, 1)]
RADIANCES = [-1, (1, 1, -1e-300), INF, NAN, (1, 2), "white", None, [[1, 2, 3]], [1, [2, 3], 4]]
SHARES = [-1e-300, np.nextafter(1, 2), NAN, INF, "half", (0.5, 0.5, 0.5)]
INDICES = [0, -1.5, NAN, INF, "glass", 1.5 + 1j, (1.5, 1.5, 1.5)]
METALS = [0, 1j, -1 + 1j, 1 - 1j, complex("nan"), complex("inf"), (1, 1, -1j), (1, 2), "gold"]
IMPOSSIBLE = [
    (pl.Lambertian, {"albedo": ALBEDOS}),
    (pl.Emissive, {"radiance": RADIANCES}),
    (pl.lights.ConstantBackground, {"radiance": RADIANCES}),
    (pl.materials.RoughDiffuse, {"albedo": ALBEDOS, "roughness": SHARES}),
    (pl.Conductor, {"reflectance": ALBEDOS, "alpha": SHARES, "index": METALS}),
    (pl.Dielectric, {"absorption": RADIANCES, "alpha": SHARES, "index": INDICES, "exterior": INDICES}),
    (pl.materials.ThinGlass, {"transmittance": ALBEDOS, "index": INDICES}),
    (pl.MetallicRoughness, {"base": ALBEDOS, "emission": RADIANCES}),
    (pl.MetallicRoughness, dict.fromkeys(["metallic", "roughness", "opacity", "cutoff"], SHARES)),
]


def test_impossible_numbers_are_refused():
    for make, fields in IMPOSSIBLE:
        for name, numbers in fields.items():
            for number in numbers:
                with pytest.raises(pl.errors.InvalidValueError, match=name):
                    make(**{name: number})
            if numbers is SHARES:
                kept = [getattr(make(**{name: possible}), name) for possible in (0, 1, 0.5, np.float32(0.25))]
                assert kept == [0, 1, 0.5, 0.25] and {type(number) for number in kept} == {float}


def test_textures_of_numbers_have_one_channel_and_normal_maps_three():
    for name in ("metallic", "roughness", "opacity"):
        assert getattr(pl.MetallicRoughness(**{name: GREY_MAP}), name) == GREY_MAP
        with pytest.raises(pl.errors.InvalidValueError, match=f"{name} is a texture of 3 channels; it must have 1"):
            pl.MetallicRoughness(**{name: COLOUR_MAP})
        with pytest.raises(pl.errors.SceneError, match=rf"{name} has texels up to 1\.5"):
            pl.MetallicRoughness(**{name: pl.Texture(np.full((2, 2, 1), 1.5))})
    for normal_map in (GREY_MAP, 0.5, (0.5, 0.5, 1.0), np.ones((1, 1, 3))):
        with pytest.raises(pl.errors.InvalidValueError, match="normal_map is .*; it must be a texture of 3 channels"):
            pl.MetallicRoughness(normal_map=normal_map)
    plain = {pl.Conductor: "reflectance", pl.materials.ThinGlass: "transmittance", pl.Dielectric: "absorption"}
    for make, name in plain.items():
        with pytest.raises(pl.errors.InvalidValueError, match=name):
            make(**{name: COLOUR_MAP})


def test_arrays_and_lists_become_plain_numbers():
    assert pl.Lambertian(np.array([0.1, 0.2, 0.3])) == pl.Lambertian([0.1, 0.2, 0.3]) == pl.Lambertian((0.1, 0.2, 0.3))
    assert type(pl.Emissive(np.float32(2)).radiance) is float
    assert pl.Emissive(1) == pl.Emissive(1.0) != pl.Emissive(1.0, two_sided=True)
    assert pl.Conductor(np.float64(1), index=np.array([1 + 1j, 2, 3])) == pl.Conductor(index=(1 + 1j, 2 + 0j, 3 + 0j))
    assert type(pl.Conductor(index=np.complex64(1 + 1j)).index) is complex
    assert type(pl.Dielectric(np.float32(1.5)).index) is float
    for make in (pl.Emissive, pl.MetallicRoughness):
        for two_sided in ("no", 1, None, [True], np.array([True, False])):
            with pytest.raises(pl.errors.InvalidValueError, match="two_sided is .*; it must be True or False"):
                make(two_sided=two_sided)
        assert make(two_sided=np.bool_(True)).two_sided is True
    assert repr(pl.Conductor()) == "Conductor()"
    assert repr(pl.Conductor(index=[1 + 2j, 2, 3])) == "Conductor(index=((1+2j), (2+0j), (3+0j)))"
    plastic = pl.MetallicRoughness(1, roughness=GREY_MAP, cutoff=0.5, two_sided=True)
    shown = "base=1.0, roughness=Texture(texels=<2 x 3 x 1 float32>), two_sided=True, cutoff=0.5"
    assert repr(plastic) == f"MetallicRoughness({shown})"
