import numpy as np
from scene_helpers import GREY_MAP, LAMP, SKY, UV, corners_of, square

import plenoptic as pl

UP = np.tile([0.0, 0.0, 1.0], (4, 1))
PLACES = np.array([np.eye(4), np.diag([-1.0, 1.0, 1.0, 1.0])])


def layered(**fields):
    return square(pl.MetallicRoughness(**fields), uv=UV)


def arrays(tables, before=""):
    """All arrays by name, those of nested tables too; everything else is None, a number or a point."""
    found = {}
    for name, entry in zip(tables._fields, tables, strict=True):
        if hasattr(entry, "_fields"):
            found |= arrays(entry, f"{before}{name}.")
        elif isinstance(entry, np.ndarray):
            found[before + name] = entry
        else:
            assert entry is None or isinstance(entry, int | float | tuple)
    return found


def column(name):
    return {f"{name}.{part}" for part in ("row", "textures", "texels")}


MESHES = {"geometry.middle", "geometry.vertices", "geometry.triangles", "geometry.triangle_material", "triangle_mesh"}
REFLECTING = {"bsdf.scatters", "bsdf.takes_light", "bsdf.base_color"}
EMITTING = {"emission.radiance", "emission.two_sided"}
DRAWN = {"lights.cdf", "lights.items"}
LAMPS = {"lights.areas", "emission.pdf"}
KINDS = {"bsdf.kind", "bsdf.roughness"}
LAYERED = KINDS | {"bsdf.coupling", "bsdf.metallic"}
MAPPED = {"geometry.uv"}
INSTANCES = {"geometry.instance_to_world"} | {f"instances.{name}" for name in ("matrices", "first", "faces")}
WORLD = {f"lights.sky.environment.{name}" for name in ("texels", "rows_cdf", "columns_cdf", "pdf", "edges")}
WORLD |= {f"lights.sky.environment.{name}_guide" for name in ("rows", "columns")}
POINTS = {"lights.points", "lights.point_colors"}
SUNS = {"lights.sky.suns", "lights.sky.sun_colors"}
PLAIN = MESHES | REFLECTING

GLASS = PLAIN | KINDS | {"bsdf.glass_index"}
OPACITY = {"alpha.opacity", "alpha.cutoff"}
BUMP = pl.Texture(np.ones((1, 1, 3)))

SCENES = {
    "black world": (pl.Scene(background=0.0), set()),
    "bright world": (pl.Scene(background=0.5), {"lights.sky.background"}),
    "black map": (pl.Scene(background=pl.EnvironmentMap(np.zeros((2, 4, 1)))), set()),
    "map": (pl.Scene(background=SKY), WORLD),
    "turned map": (pl.Scene(background=SKY.rotated((0, 1, 0), 1.0)), WORLD | {"lights.sky.environment.rotation"}),
    "sun": (pl.Scene(lights=[pl.SunLight((0, 0, -1))]), SUNS),
    "matt": (pl.Scene([square()]), PLAIN),
    "black": (pl.Scene([square(pl.Lambertian(0.0))]), MESHES),
    "uv without a texture": (pl.Scene([square(uv=UV)]), PLAIN),
    "geometry.normals": (pl.Scene([square(normals=UP), square()]), PLAIN | {"geometry.normals"}),
    "only emissive": (pl.Scene([square(pl.Emissive(1.0)), square(pl.Lambertian(0.0))]), MESHES | EMITTING),
    "black emitter": (pl.Scene([square(pl.Emissive(0.0)), square()]), PLAIN),
    "lamp": (pl.Scene([square()], [LAMP]), PLAIN | EMITTING | DRAWN | LAMPS),
    "lamp in black": (pl.Scene([square(pl.Lambertian(0.0))], [LAMP]), MESHES | EMITTING),
    "point": (pl.Scene([square()], [pl.lights.PointLight((0, 0, 9))]), PLAIN | DRAWN | POINTS),
    "dark point": (pl.Scene([square()], [pl.lights.PointLight((0, 0, 9), 0.0)]), PLAIN | POINTS),
    "matt under a sun": (pl.Scene([square()], [pl.SunLight((0, 0, -1))]), PLAIN | DRAWN | SUNS),
    "matt under a map": (pl.Scene([square()], (), SKY), PLAIN | DRAWN | WORLD),
    "instances": (pl.Scene([pl.scene.Instances(square(), PLACES)]), PLAIN | INSTANCES),
    "rough": (pl.Scene([square(pl.materials.RoughDiffuse())]), PLAIN | KINDS),
    "metal": (pl.Scene([square(pl.Conductor())]), PLAIN | KINDS | {"bsdf.metal_index"}),
    "glass": (pl.Scene([square(pl.Dielectric())]), GLASS),
    "dark glass": (pl.Scene([square(pl.Dielectric(absorption=0.1))]), GLASS | {"absorption"}),
    "pane": (pl.Scene([square(pl.materials.ThinGlass())]), PLAIN | KINDS | {"bsdf.pane_index"}),
    "layered": (pl.Scene([layered()]), PLAIN | LAYERED),
    "alpha.opacity": (pl.Scene([layered(opacity=0.5)]), PLAIN | LAYERED | OPACITY),
    "cutoff without opacity": (pl.Scene([layered(cutoff=0.5)]), PLAIN | LAYERED),
    "texture": (pl.Scene([square(pl.Lambertian(GREY_MAP), uv=UV)]), PLAIN | MAPPED | column("textures.base_color")),
    "roughness": (pl.Scene([layered(roughness=GREY_MAP)]), PLAIN | LAYERED | MAPPED | column("textures.roughness")),
    "metallic": (pl.Scene([layered(metallic=GREY_MAP)]), PLAIN | LAYERED | MAPPED | column("textures.metallic")),
    "normal map": (pl.Scene([layered(normal_map=BUMP)]), PLAIN | LAYERED | MAPPED | column("textures.normal")),
    "opacity": (pl.Scene([layered(opacity=GREY_MAP)]), PLAIN | LAYERED | MAPPED | OPACITY | column("alpha.texture")),
    "emission": (
        pl.Scene([square(pl.Emissive(GREY_MAP), uv=UV)]),
        MESHES | EMITTING | MAPPED | column("emission.texture"),
    ),
}


def test_what_is_absent_is_none_and_tables_are_read_only_and_contiguous():
    for name, (scene, expected) in SCENES.items():
        found = arrays(scene.tables())
        assert set(found) == expected, name
        assert all(table.flags.c_contiguous and not table.flags.writeable for table in found.values()), name


def test_indices_are_global_and_lights_come_last():
    first, second = square(), square(pl.Lambertian(0.1)).translated(z=5)
    tables = pl.Scene([first, second], [LAMP]).tables()
    geometry, found = tables.geometry, tables.geometry.vertices[tables.geometry.triangles]
    assert geometry.triangles.dtype == np.int32
    np.testing.assert_array_equal(found, np.concatenate([corners_of(mesh) for mesh in (first, second, LAMP.mesh())]))
    assert tables.triangle_mesh.tolist() == geometry.triangle_material.tolist() == [0, 0, 1, 1, 2, 2]
    # A mesh without normals has rows of zeros.
    tables = pl.Scene([square(), square(normals=UP)]).tables()
    np.testing.assert_array_equal(tables.geometry.normals, np.concatenate([np.zeros((4, 3)), UP]))


def test_instanced_triangles_come_after_lights_once_each():
    red, blue = square(pl.Lambertian((1, 0, 0))), square(pl.Lambertian((0, 0, 1))).translated(z=1)
    groups = [pl.scene.Instances(mesh, places) for mesh, places in ((red, PLACES), (blue, PLACES), (red, PLACES[:1]))]
    scene = pl.Scene([groups[0], square(), *groups[1:]], [LAMP, pl.lights.SphereLight((9, 9, 9), 1.0)])
    tables = scene.tables()
    # Meshes 0 to 3, then the two lights: plain ones first, then each instanced mesh under its first number.
    assert tables.triangle_mesh.tolist() == [1, 1, 4, 4, *[5] * 1280, 0, 0, 2, 2]
    plain = 2 + 2 + 1280
    assert tables.instances.plain == plain
    assert tables.instances.first.tolist() == [plain, plain, plain + 2, plain + 2, plain]
    assert tables.instances.faces.tolist() == [2] * 5
    np.testing.assert_array_equal(tables.geometry.vertices[tables.geometry.triangles[-2:]], corners_of(blue))
    colours = tables.bsdf.base_color[tables.geometry.triangle_material[-4:]]
    np.testing.assert_array_equal(colours, [[1, 0, 0]] * 2 + [[0, 0, 1]] * 2)


def test_materials_keep_their_numbers():
    kinds = [
        pl.Lambertian(0.1),
        pl.materials.RoughDiffuse(0.2, roughness=0.9),
        pl.Conductor(0.3, alpha=0.25),
        pl.Conductor(0.4, index=1.5 + 3j),
        pl.Dielectric(1.6, alpha=0.5, absorption=0.7, exterior=1.3),
        pl.materials.ThinGlass(1.7, transmittance=0.6),
        pl.MetallicRoughness(0.7, 0.8, 0.9, emission=2.0, two_sided=True, opacity=0.25, cutoff=0.125),
        pl.Emissive(3.0),
    ]
    tables = pl.Scene([square(material) for material in kinds]).tables()
    bsdf, emission = tables.bsdf, tables.emission
    assert bsdf.kind.tolist() == [0, 1, 2, 2, 3, 4, 5, 0]
    assert bsdf.base_color[:, 0].tolist() == [0.1, 0.2, 0.3, 0.4, 1.0, 0.6, 0.7, 0.0]
    assert bsdf.roughness.tolist() == [0.0, 0.9, 0.25, 0.0, 0.5, 0.0, 0.9, 0.0]
    assert bsdf.metallic.tolist() == [0.0] * 6 + [0.8, 0.0]
    assert bsdf.scatters.tolist() == [1] * 7 + [0]
    assert bsdf.takes_light.tolist() == [1, 1, 1, 0, 1, 0, 1, 0]
    assert tables.absorption[:, 0].tolist() == [0.0] * 4 + [0.7, 0.0, 0.0, 0.0]
    assert tables.alpha.opacity.tolist() == [1.0] * 6 + [0.25, 1.0]
    assert tables.alpha.cutoff.tolist() == [-1.0] * 6 + [0.125, -1.0]
    assert emission.radiance[:, 0].tolist() == [0.0] * 6 + [2.0, 3.0]
    assert emission.two_sided.tolist() == [0] * 6 + [1, 0]
    assert bsdf.metal_index[:, 0].tolist() == [[0, 0]] * 3 + [[1.5, 3.0]] + [[0, 0]] * 4
    assert bsdf.glass_index.tolist() == [[0, 0]] * 4 + [[1.6, 1.3]] + [[0, 0]] * 3
    assert bsdf.pane_index.tolist() == [0] * 5 + [1.7, 0, 0]


def test_textures_lie_one_after_the_other_row_by_row():
    one = np.arange(6, dtype=np.float32).reshape(2, 3, 1) / 10
    two = np.arange(12, dtype=np.float32).reshape(2, 2, 3) / 20
    meshes = [square(pl.Lambertian(pl.Texture(t)), uv=UV) for t in (one, two)] + [square(pl.Lambertian(0.3))]
    tables = pl.Scene(meshes).tables()
    assert tables.channels == 3 and tables.textures.base_color.row.tolist() == [0, 1, -1]
    np.testing.assert_array_equal(tables.textures.base_color.texels, np.concatenate([one.ravel(), two.ravel()]))
    np.testing.assert_array_equal(tables.geometry.uv, np.concatenate([UV, UV, np.zeros((4, 2))]))
    # Each use of a texture names its row, and equal ones share it.
    bump, shine = pl.Texture(np.full((1, 1, 3), 0.75)), pl.Texture(np.full((2, 2, 3), [1.0, 2.0, 6.0]))
    material = pl.MetallicRoughness(GREY_MAP, GREY_MAP, GREY_MAP, normal_map=bump, emission=shine, opacity=GREY_MAP)
    tables = pl.Scene([square(), square(material, uv=UV)]).tables()
    assert len(tables.textures.base_color.textures) == 3
    grey = int(tables.textures.base_color.row[1])
    for column in (tables.textures.metallic, tables.textures.roughness, tables.alpha.texture):
        assert column.row.tolist() == [-1, grey]
    assert tables.textures.base_color.row[0] == -1
    assert {grey, int(tables.textures.normal.row[1]), int(tables.emission.texture.row[1])} == {0, 1, 2}
    # Equal materials are one row.
    copies = [pl.Lambertian(pl.Texture(np.full((2, 3, 1), 0.5))), pl.Lambertian(0.2), pl.Lambertian(GREY_MAP)]
    equal = pl.Scene([square(material, uv=UV) for material in copies]).tables()
    assert equal.geometry.triangle_material.tolist() == [0, 0, 1, 1, 0, 0]
    assert equal.bsdf.base_color.tolist() == [[1.0], [0.2]] and len(equal.textures.base_color.texels) == 6
    # Lights are drawn by the mean of a texture.
    assert tables.emission.radiance.tolist() == [[0, 0, 0], [1, 2, 6]]


RED, TINT = (1, 0, 0), (0.5, 0.5, 0.4)
COLOURLESS = [pl.Lambertian(pl.Texture(np.full((2, 2, 3), 0.25))), pl.Conductor(index=(2 + 1j, 2 + 1j, 2 + 1j))]
COLOURLESS += [pl.MetallicRoughness(normal_map=pl.Texture(np.array([[[0.5, 0.5, 1.0]]])))]
GREY_SCENES = [
    pl.Scene([square(pl.Lambertian((0.5, 0.5, 0.5)))], background=(1, 1, 1)),
    *(pl.Scene([square(material, uv=UV)]) for material in COLOURLESS),
    pl.Scene([square()], background=pl.EnvironmentMap(np.full((1, 2, 3), 0.5))),
]
COLOURED = [pl.Emissive((1, 2, 3)), pl.Lambertian(pl.Texture(np.array([[[0, 0, 0.1]]]))), pl.Conductor(TINT)]
COLOURED += [pl.materials.RoughDiffuse(TINT), pl.Conductor(index=(2 + 1j, 2 + 1j, 2 + 2j)), pl.MetallicRoughness(TINT)]
COLOURED += [pl.Dielectric(absorption=(0, 0, 1)), pl.materials.ThinGlass(transmittance=TINT)]
COLOURED += [pl.MetallicRoughness(emission=(0, 0, 1))]
COLOURED_LIGHTS = [pl.QuadLight((0, 0, 9), (1, 0, 0), (0, 1, 0), RED), pl.lights.SphereLight((0, 0, 9), 1.0, RED)]
COLOURED_LIGHTS += [pl.lights.PointLight((0, 0, 9), RED), pl.SunLight((0, 0, -1), RED)]
COLOURED_LIGHTS += [pl.lights.SpotLight((0, 0, 9), (0, 0, -1), RED)]
COLOURED_SCENES = [
    *(pl.Scene([square(material, uv=UV)]) for material in COLOURED),
    *(pl.Scene([square()], [light]) for light in COLOURED_LIGHTS),
    pl.Scene([square()], background=(1, 1, 0.9)),
    pl.Scene([square()], background=pl.EnvironmentMap(np.array([[[0.5, 0.5, 0.4]]]))),
    pl.Scene([pl.scene.Instances(square(pl.Lambertian(TINT)), PLACES)]),
]


def test_three_channels_only_where_something_is_coloured():
    last = ("bsdf.base_color", "absorption", "emission.radiance", "lights.point_colors", "lights.sky.sun_colors")
    axes = dict.fromkeys([*last, "lights.sky.background"], -1)
    axes |= {"lights.sky.environment.texels": 2, "bsdf.metal_index": 1}
    for scenes, channels in ((GREY_SCENES, 1), (COLOURED_SCENES, 3)):
        for scene in scenes:
            tables = scene.tables()
            assert tables.channels == channels, scene
            for name, table in arrays(tables).items():
                assert name not in axes or table.shape[axes[name]] == channels, (scene, name)
