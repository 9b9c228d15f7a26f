"""glTF materials: each number and texture of the format in its place."""

import json
import warnings

import numpy as np
import PIL.features
import PIL.Image
import pytest
from scene_helpers import POINTS, Writer

import plenoptic as pl
from plenoptic.core.color.srgb import Encoding
from plenoptic.scene.files.load import load_file
from plenoptic.scene.textures.texture import TextureFilter, Wrap

UV = [(0, 1), (1, 1), (1, 0), (0, 0)]  # v down, so that the image stands upright
CODES = np.array([[[255, 0, 0, 255], [0, 255, 0, 128]], [[0, 0, 255, 51], [188, 100, 20, 0]]], dtype=np.uint8)


def quad(tmp_path, material, *, codes=CODES, sampler=None, more_uv=None, colours=None, tangents=None):
    """The mesh of a square of this material, whose textures 0 and 1 are images of `codes`."""
    writer, attributes = Writer(), {"TEXCOORD_0": UV, "TEXCOORD_1": more_uv, "COLOR_0": colours, "TANGENT": tangents}
    given = {name: writer.array(numbers) for name, numbers in attributes.items() if numbers is not None}
    writer.node(mesh=writer.mesh(POINTS, [[0, 1, 2], [0, 2, 3]], material=0, **given))
    described = {
        "materials": [{"name": "skin"} | material],
        "textures": [{"source": 0} | ({} if sampler is None else {"sampler": 0}), {"source": 1}],
        "images": [{"uri": "skin%20a.png"}, {"uri": "skin b.png"}],
        "samplers": [sampler or {}],
    }
    for name in ("skin a.png", "skin b.png"):
        PIL.Image.fromarray(codes).save(tmp_path / name)
    (mesh,) = load_file(writer.save(tmp_path / "quad.gltf", **described), unit="mm").meshes
    return mesh


def material_of(tmp_path, material, **more):
    return quad(tmp_path, material, **more).material


def texture(codes=CODES, **options):
    return pl.Texture.from_image(PIL.Image.fromarray(codes), **options)


IMAGE = {"index": 0}
DECODED = texture().texels
DATA = CODES[..., :3] / 255


def test_plain_numbers(tmp_path):
    assert material_of(tmp_path, {}) == pl.MetallicRoughness(1.0, 1.0, 1.0)
    pbr = {"baseColorFactor": [0.1, 0.2, 0.3, 0.4], "metallicFactor": 0.25, "roughnessFactor": 0.75}
    expected = pl.MetallicRoughness((0.1, 0.2, 0.3), 0.25, 0.75)
    assert material_of(tmp_path, {"pbrMetallicRoughness": pbr}) == expected


def test_base_colour_is_srgb_times_its_factor_and_its_image_stands_upright(tmp_path):
    pbr = {"baseColorTexture": IMAGE, "baseColorFactor": [0.5, 1.0, 0.25, 1.0]}
    mesh = quad(tmp_path, {"pbrMetallicRoughness": pbr})
    np.testing.assert_allclose(mesh.material.base.texels, DECODED * [0.5, 1.0, 0.25], rtol=1e-7)
    assert mesh.material.opacity == 1.0
    np.testing.assert_array_equal(mesh.uv, mesh.vertices[:, :2])
    assert mesh.material.base.texels[0, 0].tolist() == [0.5, 0, 0]  # (0, 1), the upper left corner, is red


def test_metallic_is_blue_and_roughness_green_both_linear(tmp_path):
    pbr = {"metallicRoughnessTexture": IMAGE, "metallicFactor": 0.5, "roughnessFactor": 0.8}
    found = material_of(tmp_path, {"pbrMetallicRoughness": pbr})
    np.testing.assert_allclose(found.metallic.texels[..., 0], 0.5 * DATA[..., 2], rtol=1e-6)
    np.testing.assert_allclose(found.roughness.texels[..., 0], 0.8 * DATA[..., 1], rtol=1e-6)
    # What is multiplied by zero or constant is a number.
    pbr = {"metallicRoughnessTexture": IMAGE, "metallicFactor": 0.0, "baseColorTexture": IMAGE}
    pbr["baseColorFactor"] = [0, 0, 0, 1]
    flat = np.full((2, 2, 3), 51, dtype=np.uint8)
    material = {"pbrMetallicRoughness": pbr, "emissiveTexture": IMAGE}
    assert material_of(tmp_path, material, codes=flat) == pl.MetallicRoughness(0.0, 0.0, float(np.float32(0.2)))


def test_emission_is_srgb_times_factor_times_strength_and_two_sided_where_the_file_says_so(tmp_path):
    strong = {"KHR_materials_emissive_strength": {"emissiveStrength": 8.0}}
    material = {"emissiveFactor": [1.0, 0.5, 0.25], "extensions": strong, "doubleSided": True}
    found = material_of(tmp_path, material)
    assert found.emission == (8.0, 4.0, 2.0) and found.two_sided
    found = material_of(tmp_path, material | {"emissiveTexture": IMAGE})
    np.testing.assert_allclose(found.emission.texels, DECODED * [8, 4, 2], rtol=1e-6)
    black = np.zeros((2, 2, 3), dtype=np.uint8)
    assert material_of(tmp_path, material | {"emissiveTexture": IMAGE}, codes=black).emission == 0.0
    assert not material_of(tmp_path, {"emissiveFactor": [1, 1, 1]}).two_sided


def test_the_slopes_of_normals_are_multiplied_by_their_scale(tmp_path):
    tilted = np.array([[[128, 128, 255], [200, 90, 220]]], dtype=np.uint8)
    before = 2 * texture(tilted, encoding=Encoding.LINEAR).texels.astype(float) - 1
    for scale in (1.0, 0.25, 3.0, 0.0, -1.0):
        found = material_of(tmp_path, {"normalTexture": IMAGE | {"scale": scale}}, codes=tilted)
        after = 2 * found.normal_map.texels.astype(float) - 1
        # Texels are float32 within 0 and 1: 2^-25 each, doubled twice.
        slopes = scale * before[..., :2] / before[..., 2:]
        np.testing.assert_allclose(after[..., :2] / after[..., 2:], slopes, atol=1e-6)
        if scale != 1:
            np.testing.assert_allclose(np.linalg.norm(after, axis=2), 1.0, atol=3e-7)
    with pytest.raises(pl.errors.FileError, match=r"quad\.gltf.*normal texture of material 'skin' is grey"):
        material_of(tmp_path, {"normalTexture": IMAGE}, codes=np.zeros((2, 2), dtype=np.uint8))


def test_tangents_that_differ_from_the_texture_are_spoken_of(tmp_path):
    told, plain = {"normalTexture": IMAGE}, quad(tmp_path, {"normalTexture": IMAGE})
    for turn, hand, share in ((0, 1, 0), (8, 1, 0), (-8, 1, 0), (12, 1, 100), (90, 1, 100), (0, -1, 100)):
        tangents = [[np.cos(np.radians(turn)), np.sin(np.radians(turn)), 0, hand]] * 4
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            assert quad(tmp_path, {}, tangents=tangents).material.normal_map is None
            if not share:
                assert quad(tmp_path, told, tangents=tangents) == plain
        if share:
            with pytest.warns(pl.errors.FileWarning, match=f"on {share} % of its triangles they differ .* 10 degrees"):
                assert quad(tmp_path, told, tangents=tangents) == plain
    along, across = [1, 0, 0, 1], [0, 1, 0, 1]
    with pytest.warns(pl.errors.FileWarning, match="on 50 % of its triangles"):
        # Only the second triangle has the last corner.
        quad(tmp_path, told, tangents=[along, along, along, across])


def test_opacity_by_a_number_and_by_an_image(tmp_path):
    for told, opacity, cutoff in (
        ({}, 1.0, None),
        ({"alphaMode": "OPAQUE"}, 1.0, None),
        ({"alphaMode": "BLEND"}, 0.4, None),
        ({"alphaMode": "MASK"}, 0.0, None),  # 0.4 is below 0.5, the cutoff of the standard
        ({"alphaMode": "MASK", "alphaCutoff": 0.4}, 1.0, None),
    ):
        found = material_of(tmp_path, told | {"pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.4]}})
        assert (found.opacity, found.cutoff) == (opacity, cutoff), told
    # That of an image is linear alpha times the factor.
    pbr = {"baseColorTexture": IMAGE, "baseColorFactor": [1, 1, 1, 0.5]}
    for told, cutoff in (({"alphaMode": "BLEND"}, None), ({"alphaMode": "MASK", "alphaCutoff": 0.3}, 0.3)):
        found = material_of(tmp_path, told | {"pbrMetallicRoughness": pbr})
        np.testing.assert_allclose(found.opacity.texels[..., 0], 0.5 * CODES[..., 3] / 255, rtol=1e-6)
        assert found.cutoff == cutoff
    # An image without alpha is opaque at no cost, and a cutoff above 1 hides all.
    told = {"alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorTexture": IMAGE}}
    assert material_of(tmp_path, told, codes=CODES[..., :3]).opacity == 1.0
    assert material_of(tmp_path, told | {"alphaMode": "MASK", "alphaCutoff": 1.5}).opacity == 0.0


def test_wrap_and_filter_of_the_sampler(tmp_path):
    told = {"pbrMetallicRoughness": {"baseColorTexture": IMAGE}}
    assert material_of(tmp_path, told).base.wraps == (Wrap.REPEAT, Wrap.REPEAT)
    sampler = {"wrapS": 33071, "wrapT": 33648, "magFilter": 9728}
    found = material_of(tmp_path, told, sampler=sampler).base
    assert found.wraps == (Wrap.CLAMP, Wrap.MIRROR) and found.filter is TextureFilter.NEAREST
    assert material_of(tmp_path, told, sampler={"magFilter": 9729}).base.filter is TextureFilter.BILINEAR
    # Textures that lie in several ways are refused.
    told = moved(scale=[2, 2])
    shifted = {"index": 1, "extensions": {"KHR_texture_transform": {"scale": [2, 2]}}}
    assert material_of(tmp_path, told | {"normalTexture": shifted}).normal_map is not None
    with pytest.raises(pl.errors.FileError, match=r"quad\.gltf.*'skin' moves its textures in 2 ways.*bake"):
        quad(tmp_path, told | {"normalTexture": {"index": 1}})
    # Without emissiveFactor this one is black.
    assert quad(tmp_path, told | {"emissiveTexture": {"index": 1}}).material.emission == 0.0


def moved(**transform):
    return {"pbrMetallicRoughness": {"baseColorTexture": IMAGE | {"extensions": {"KHR_texture_transform": transform}}}}


def test_texture_transforms_are_baked_into_uv(tmp_path):
    for transform, expected in (
        ({}, [(0, 0), (1, 0), (1, 1), (0, 1)]),
        # The upper left quarter: v down, so it begins at 0.5 upwards.
        ({"scale": [0.5, 0.5]}, [(0, 0.5), (0.5, 0.5), (0.5, 1), (0, 1)]),
        ({"offset": [0.25, 0.25]}, [(0.25, -0.25), (1.25, -0.25), (1.25, 0.75), (0.25, 0.75)]),
        # The two examples in the text of the extension: the lower left quarter, its image turned clockwise by 90
        # degrees; and the image upside down.
        ({"offset": [0, 1], "rotation": np.pi / 2, "scale": [0.5, 0.5]}, [(0.5, 0), (0.5, 0.5), (0, 0.5), (0, 0)]),
        ({"offset": [0, 1], "scale": [1, -1]}, [(0, 1), (1, 1), (1, 0), (0, 0)]),
    ):
        np.testing.assert_allclose(quad(tmp_path, moved(**transform)).uv, expected, atol=1e-15)
    # The second set of uv.
    other = [(0.5, 0.5), (0.6, 0.5), (0.6, 0.4), (0.5, 0.4)]
    told = {"pbrMetallicRoughness": {"baseColorTexture": IMAGE | {"texCoord": 1}}}
    expected = np.array(other) * (1, -1) + (0, 1)
    # uv of files are float32.
    np.testing.assert_allclose(quad(tmp_path, told, more_uv=other).uv, expected, atol=1e-7)
    np.testing.assert_allclose(quad(tmp_path, moved(texCoord=1), more_uv=other).uv, expected, atol=1e-7)
    with pytest.raises(pl.errors.FileError, match=r"quad\.gltf.*uv is None"):
        quad(tmp_path, told)


def coated(**coat):
    return {"extensions": {"KHR_materials_clearcoat": coat}}


def test_a_clear_coat_is_red_and_its_roughness_green_both_linear(tmp_path):
    told = coated(clearcoatFactor=0.5, clearcoatRoughnessFactor=0.25)
    expected = pl.MetallicRoughness(1.0, 1.0, 1.0, clearcoat=0.5, clearcoat_roughness=0.25)
    assert material_of(tmp_path, told) == expected
    images = {"clearcoatTexture": IMAGE, "clearcoatRoughnessTexture": IMAGE}
    told["extensions"]["KHR_materials_clearcoat"] |= images
    found = material_of(tmp_path, told)
    np.testing.assert_allclose(found.clearcoat.texels[..., 0], 0.5 * DATA[..., 0], rtol=1e-6)
    np.testing.assert_allclose(found.clearcoat_roughness.texels[..., 0], 0.25 * DATA[..., 1], rtol=1e-6)
    # One of factor 0 is none.
    told = coated(**images, clearcoatRoughnessFactor=0.5)
    assert material_of(tmp_path, told) == pl.MetallicRoughness(1.0, 1.0, 1.0)


def transmitting(share=1.0, base=(1, 1, 1, 1), **more):
    extensions = {"KHR_materials_transmission": {"transmissionFactor": share}} | more
    pbr = {"metallicFactor": 0.0, "roughnessFactor": 0.0, "baseColorFactor": list(base)}
    return {"pbrMetallicRoughness": pbr, "extensions": extensions}


def test_a_surface_that_transmits_all_light_without_a_volume_is_a_pane(tmp_path):
    assert material_of(tmp_path, transmitting()) == pl.materials.ThinGlass(1.5)
    tinted = transmitting(base=(0.5, 1, 0.5, 1), KHR_materials_ior={"ior": 1.4})
    assert material_of(tmp_path, tinted) == pl.materials.ThinGlass(1.4, (0.5, 1.0, 0.5))
    # What transmits a part is there in part, and metal entirely.
    found = material_of(tmp_path, transmitting(0.25))
    assert isinstance(found, pl.MetallicRoughness) and found.opacity == 0.75
    for metallic, opacity in ((1.0, 1.0), (0.75, 0.75)):
        metal = transmitting(1.0)
        metal["pbrMetallicRoughness"]["metallicFactor"] = metallic
        assert material_of(tmp_path, metal).opacity == opacity
    # By a texture it is left out.
    told = transmitting()
    told["extensions"]["KHR_materials_transmission"]["transmissionTexture"] = IMAGE
    with pytest.warns(UserWarning, match="'skin' transmits light through parts"):
        assert material_of(tmp_path, told).opacity == 1.0
    told = transmitting()
    told["pbrMetallicRoughness"]["baseColorTexture"] = IMAGE
    with pytest.warns(UserWarning, match="'skin' are replaced by their means"):
        found = material_of(tmp_path, told)
    np.testing.assert_allclose(found.transmittance, DECODED.mean(axis=(0, 1)), rtol=1e-6)


def test_a_volume_transmits_its_attenuation_colour_after_the_attenuation_distance(tmp_path):
    volume = {"thicknessFactor": 2.0, "attenuationDistance": 5.0, "attenuationColor": [0.5, 0.25, 1.0]}
    told = transmitting(KHR_materials_volume=volume, KHR_materials_ior={"ior": 1.33})
    found = material_of(tmp_path, told)
    assert isinstance(found, pl.Dielectric) and (found.index, found.alpha) == (1.33, 0.0)
    np.testing.assert_allclose(np.exp(-np.array(found.absorption) * 5.0), [0.5, 0.25, 1.0], rtol=1e-15)
    inches = load_file(tmp_path / "quad.gltf", unit="inch").meshes[0].material
    np.testing.assert_allclose(inches.absorption, np.array(found.absorption) / 25.4, rtol=1e-14)
    # The tint of both surfaces over its thickness, and their roughness.
    volume = {"KHR_materials_volume": {"thicknessFactor": 2.0}}
    told = transmitting(base=(0.9, 0.6, 1, 1), **volume)
    told["pbrMetallicRoughness"]["roughnessFactor"] = 0.5
    found = material_of(tmp_path, told)
    assert found.alpha == 0.25
    np.testing.assert_allclose(np.exp(-np.array(found.absorption) * 2.0), np.square([0.9, 0.6, 1]), rtol=1e-14)
    # Clear glass absorbs nothing, and black glass a finite amount.
    assert material_of(tmp_path, transmitting(**volume)) == pl.Dielectric(1.5)
    assert 5 < material_of(tmp_path, transmitting(base=(0, 0, 0, 1), **volume)).absorption < 50


def test_unlit_materials_shine_and_specular_glossiness_becomes_plastic(tmp_path):
    told = {"extensions": {"KHR_materials_unlit": {}}, "pbrMetallicRoughness": {"baseColorTexture": IMAGE}}
    assert material_of(tmp_path, told) == pl.Emissive(texture())
    found = material_of(tmp_path, told | {"alphaMode": "MASK", "doubleSided": True})
    assert found.emission == texture() and found.cutoff == 0.5 and found.two_sided and found.base == 0.0
    older = {"diffuseFactor": [0.5, 0.5, 0.25, 1], "glossinessFactor": 0.75}
    told = {"extensions": {"KHR_materials_pbrSpecularGlossiness": older}}
    assert material_of(tmp_path, told) == pl.MetallicRoughness((0.5, 0.5, 0.25), 0.0, 0.25)


def test_the_one_colour_of_all_vertices_is_a_factor_and_several_are_left_out_beside_textures(tmp_path):
    told = {"pbrMetallicRoughness": {"baseColorFactor": [0.5, 1, 1, 1]}, "alphaMode": "BLEND"}
    found = material_of(tmp_path, told, colours=[(0.5, 0.25, 1, 0.5)] * 4)
    assert found.base == (0.25, 0.25, 1.0) and found.opacity == 0.5
    several = [(0, 0, 0, 1), *[(1, 1, 1, 1)] * 3]
    textured = {"pbrMetallicRoughness": {"baseColorTexture": IMAGE}}
    with pytest.warns(UserWarning, match="colours that vary from vertex to vertex are left out: its material"):
        assert material_of(tmp_path, textured, colours=several).base == texture()
    with pytest.warns(UserWarning, match="opacities that vary"):
        found = material_of(tmp_path, told, colours=[(0.5, 0.25, 1, 0.5), *[(0.5, 0.25, 1, 1)] * 3])
    assert found.base == (0.25, 0.25, 1.0) and found.opacity == 1.0


def test_an_image_is_one_texture_in_all_materials_that_use_it_alike(tmp_path):
    quad(tmp_path, {"pbrMetallicRoughness": {"baseColorTexture": IMAGE}})
    header = json.loads((tmp_path / "quad.gltf").read_text())
    header["materials"] *= 2
    header["meshes"][0]["primitives"].append(header["meshes"][0]["primitives"][0] | {"material": 1})
    (tmp_path / "quad.gltf").write_text(json.dumps(header))
    one, other = load_file(tmp_path / "quad.gltf").meshes
    assert one.material.base is other.material.base
    if PIL.features.check("webp"):
        PIL.Image.fromarray(CODES[..., :3]).save(tmp_path / "skin.webp", lossless=True)
        header["images"].append({"uri": "skin.webp"})
        header["textures"][0] = {"extensions": {"EXT_texture_webp": {"source": 2}}}
        (tmp_path / "quad.gltf").write_text(json.dumps(header))
        assert load_file(tmp_path / "quad.gltf").meshes[0].material.base == texture(CODES[..., :3])
    # A material of one's own needs none of the files.
    quad(tmp_path, moved(scale=[2, 2]))
    (tmp_path / "skin a.png").unlink()
    with pytest.raises(pl.errors.FileError, match=r"'skin' is missing or not an image.*'skin a\.png'.*material="):
        load_file(tmp_path / "quad.gltf")
    (mesh,) = load_file(tmp_path / "quad.gltf", material=pl.Conductor(0.5), unit="mm").meshes
    assert mesh.material == pl.Conductor(0.5)
    np.testing.assert_array_equal(mesh.uv, mesh.vertices[:, :2])
