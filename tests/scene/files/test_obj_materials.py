"""MTL: each row of the table in `obj_material`, and what its images become."""

import math

import numpy as np
import PIL.Image
import pytest

import plenoptic as pl
from plenoptic.core.color.srgb import Encoding
from plenoptic.core.files.file_limits import FileLimits, FileReader
from plenoptic.scene.files.obj import obj_material, read_mtl
from plenoptic.scene.textures.texture import Wrap

CODES = np.array([[[255, 0, 0, 255], [0, 255, 0, 128]], [[0, 0, 255, 51], [188, 100, 20, 0]]], dtype=np.uint8)

DECODED = pl.Texture.from_image(PIL.Image.fromarray(CODES)).texels


def read(folder, *lines):
    PIL.Image.fromarray(CODES).save(folder / "a b.png")
    PIL.Image.fromarray(CODES[..., 0]).save(folder / "grey.png")
    (described,) = read_mtl("\n".join(["newmtl skin", *lines])).values()
    return obj_material("skin", described, FileReader(folder / "skin.obj", FileLimits()))


def assert_is_image(found, *, encoding=Encoding.SRGB, wrap=Wrap.REPEAT):
    expected = pl.Texture.from_image(PIL.Image.fromarray(CODES), encoding=encoding)
    # Two libraries decode it. In float32 code / 255, + 0.055 and / 1.055 are rounded by 2^-24 each; the power makes 2.4
    # times as much of that: 4.3e-7.
    np.testing.assert_allclose(found.texels, expected.texels, rtol=5e-7)
    assert found.wrap is wrap


SMOOTH = math.sqrt(math.sqrt(2 / 200))  # roughness for Ns 198: alpha is 0.1

TABLE = [
    ([], pl.Lambertian(1.0)),
    (["Kd 0.1 0.2 0.3"], pl.Lambertian((0.1, 0.2, 0.3))),
    (["Kd 0.5"], pl.Lambertian(0.5)),
    (["Kd 0.5 0.5 0.5", "Ks 0 0 0", "illum 2"], pl.Lambertian(0.5)),
    (["Kd 0.5 0.5 0.5", "Ks 1 1 1", "Ns 198", "illum 1"], pl.Lambertian(0.5)),
    (["Kd 0.5 0.5 0.5", "Ks 1 1 1", "Ns 198", "illum 2"], pl.MetallicRoughness(0.5, 0.0, SMOOTH)),
    (["Kd 0.5 0.5 0.5", "Ks 1 1 1", "Ns 198"], pl.MetallicRoughness(0.5, 0.0, SMOOTH)),
    (["Kd 0.5 0.5 0.5", "Ks 1 1 1"], pl.MetallicRoughness(0.5, 0.0, 1.0)),
    (["Kd 0 0 0", "Ks 0.9 0.8 0.7", "Ns 198", "illum 3"], pl.Conductor((0.9, 0.8, 0.7), 0.1)),
    (["Kd 0.3 0.3 0.3", "Ks 0.1 0.1 0.1", "Ns 198", "illum 3"], pl.MetallicRoughness(0.4, 0.25, SMOOTH)),
    (["Kd 0.9 0.9 0.9", "Ks 0.9 0.9 0.9", "Ns 198", "illum 5"], pl.MetallicRoughness(1.0, 0.5, SMOOTH)),
    (["Kd 0.5 0.5 0.5", "Pr 0.25", "Pm 0.75"], pl.MetallicRoughness(0.5, 0.75, 0.25)),
    (["Kd 0.5 0.5 0.5", "Pm 1", "Ns 198"], pl.MetallicRoughness(0.5, 1.0, SMOOTH)),
    (["illum 6", "d 0.5", "Ni 1.3"], pl.Dielectric(1.3)),
    (["illum 7", "Tf 1 1 1"], pl.Dielectric(1.5)),
    (["illum 4", "Tf 0.5 1 0.5", "Ni 1.4"], pl.materials.ThinGlass(1.4, (0.5, 1.0, 0.5))),
    (["illum 7", "Kd 0.5 0.5 0.5"], pl.Lambertian(0.5)),
    (["Kd 0.5 0.5 0.5", "d 0.25"], pl.MetallicRoughness(0.5, 0.0, 1.0, opacity=0.25)),
    (["Kd 0.5 0.5 0.5", "Tr 0.25"], pl.MetallicRoughness(0.5, 0.0, 1.0, opacity=0.75)),
    (["Kd 0.5 0.5 0.5", "d 1", "Tr 1"], pl.Lambertian(0.5)),
    (["Kd 0.5", "illum 9", "d 0.25"], pl.MetallicRoughness(0.5, 0.0, 1.0, opacity=0.25)),
    (["Kd 0 0 0", "Ks 1 1 1", "d 0.25"], pl.MetallicRoughness(0.0, 0.0, 1.0, opacity=0.25)),
    (["Ke 3 2 1"], pl.Emissive((3.0, 2.0, 1.0))),
    (["Kd 0 0 0", "Ke 5 5 5"], pl.Emissive(5.0)),
    (["Kd 0.5 0.5 0.5", "Ke 5 5 5"], pl.MetallicRoughness(0.5, 0.0, 1.0, emission=5.0)),
    (["Kd 0.5 0.5 0.5", "Ke 0 0 0"], pl.Lambertian(0.5)),
]


def test_every_row_of_the_table(tmp_path):
    for lines, expected in TABLE:
        found = read(tmp_path, *lines)
        assert type(found) is type(expected), lines
        for name in expected.__dataclass_fields__:
            given, wanted = getattr(found, name), getattr(expected, name)
            # Ns goes through two square roots.
            assert given == (wanted if wanted is None else pytest.approx(wanted, rel=1e-14)), (lines, name)


def test_colours_are_srgb_images_times_their_colour(tmp_path):
    for keyword, name in (("Kd", "albedo"), ("Ke", "radiance")):
        found = read(tmp_path, f"{keyword} 0.5 1 0.25", f"map_{keyword} a b.png")
        np.testing.assert_allclose(getattr(found, name).texels, DECODED * [0.5, 1, 0.25], rtol=1e-6)
        # An image alone counts fully.
        assert_is_image(getattr(read(tmp_path, f"map_{keyword} a b.png"), name))
    assert_is_image(read(tmp_path, "map_Kd a b.png", "Ke 0 0 0", "map_Ke a b.png").albedo)
    # A textured gloss keeps its texture.
    found = read(tmp_path, "Kd 0.5 0.5 0.5", "Ks 0.5 0.5 0.5", "map_Kd a b.png", "illum 3")
    assert_is_image(found.base)
    assert found.metallic == 0.5


def test_roughness_metal_normals_and_opacity_are_linear(tmp_path):
    found = read(tmp_path, "Pr 0.5", "map_Pr a b.png", "map_Pm grey.png", "norm a b.png")
    np.testing.assert_allclose(found.roughness.texels[..., 0], 0.5 * CODES[..., 0] / 255, rtol=1e-6)
    np.testing.assert_allclose(found.metallic.texels[..., 0], CODES[..., 0] / 255, rtol=1e-6)
    assert_is_image(found.normal_map, encoding=Encoding.LINEAR)
    # Opacity is alpha or grey.
    found = read(tmp_path, "map_Kd a b.png", "map_d a b.png", "d 0.5")
    np.testing.assert_allclose(found.opacity.texels[..., 0], 0.5 * CODES[..., 3] / 255, rtol=1e-6)
    found = read(tmp_path, "map_Kd a b.png", "map_d grey.png")
    np.testing.assert_allclose(found.opacity.texels[..., 0], CODES[..., 0] / 255, rtol=1e-6)
    # An image that is its own mask and has no alpha hides nothing.
    assert read(tmp_path, "map_Kd grey.png", "map_d grey.png").albedo.texels.shape == (2, 2, 1)
    # Clamped images, backslashes, comments and indents.
    (tmp_path / "images").mkdir()
    PIL.Image.fromarray(CODES).save(tmp_path / "images" / "a.png")
    assert_is_image(read(tmp_path, r"  map_Kd -clamp on images\a.png   # skin").albedo, wrap=Wrap.CLAMP)


def test_what_cannot_be_understood_is_refused(tmp_path):
    options = r"'-s 2 2 1 a b\.png'.*options; bake them"
    for line, said in (
        ("Kd 0.5 0.4", r"Kd 0\.5 0\.4 of 'skin'.*one number or three.*correct it"),
        ("Kd spectral a.rfl", r"Kd spectral"),
        ("map_Kd -s 2 2 1 a b.png", options),
        ("map_Kd -clamp on -s 2 2 1 a b.png", options),
        ("map_Kd absent.png", r"'absent\.png' of material 'skin' is missing.*beside the file"),
        ("Kd 2 2 2", r"albedo is 2\.0; it must be within 0 and 1"),
    ):
        with pytest.raises(pl.PlenopticError, match=said):
            read(tmp_path, line)
