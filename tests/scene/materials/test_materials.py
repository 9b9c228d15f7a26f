import numpy as np
import pytest
from scene_helpers import GREY_MAP

import plenoptic as pl

COLOUR_MAP = pl.Texture(np.full((2, 3, 3), [0.25, 0.5, 1.0]))


def test_a_texture_that_reflects_too_much_is_refused():
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
    assert pl.Emissive(1) == pl.Emissive(1.0) != pl.Emissive(1.0, two_sided=True)
    assert pl.Conductor(np.float64(1), index=np.array([1 + 1j, 2, 3])) == pl.Conductor(index=(1 + 1j, 2 + 0j, 3 + 0j))
    assert type(pl.Conductor(index=np.complex64(1 + 1j)).index) is complex
    for make in (pl.Emissive, pl.MetallicRoughness):
        with pytest.raises(pl.errors.InvalidValueError, match="two_sided is .*; it must be True or False"):
            make(two_sided="no")
