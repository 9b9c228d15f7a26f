"""Scenes and thin-lens cameras as Cycles has them (Blender as the Python module `bpy`), 1 mm as one of its units."""

import functools
import tempfile
from pathlib import Path

import bpy
import mathutils
import numpy as np
from mitsuba_scenes import thin_camera

import plenoptic as pl

FAR = 1e7
APART = 1e-3
"""mm. From an area light to the black surface behind it."""

bpy.ops.preferences.addon_enable(module="cycles")


def renderer(scene, camera, *, max_bounces, threads):
    """A function of a number of samples and a seed: what pixels see, (H, W, 3), through Cycles' own sampler.

    What would bias is switched off: denoising, adaptive sampling, clamping, filtered reflections, dim lights left out.
    """
    shown = bpy.data.scenes.new("shown")
    shown.render.engine = "CYCLES"
    _set(shown.render, threads_mode="FIXED", threads=threads, use_persistent_data=True, use_sequencer=False)
    _set(shown.render, resolution_x=camera.sensor.shape[1], resolution_y=camera.sensor.shape[0])
    _set(shown.render.image_settings, file_format="OPEN_EXR", color_depth="32", color_mode="RGB", exr_codec="NONE")
    _set(shown.cycles, use_denoising=False, use_adaptive_sampling=False, use_auto_tile=False, pixel_filter_type="BOX")
    _set(shown.cycles, sample_clamp_indirect=0.0, blur_glossy=0.0, light_sampling_threshold=0.0)
    most = max_bounces - 1  # Cycles does not count the light that a surface reflects as a bounce
    _set(shown.cycles, max_bounces=most, diffuse_bounces=most, glossy_bounces=most, transmission_bounces=most)
    rotation = np.asarray(camera.pose.rotation)
    origin = np.asarray(camera.pose.position) + thin_camera(camera).z * rotation[:, 2]
    shown.camera = _added(shown, _described_camera(camera), _standing(rotation, origin))
    _show_background(shown, scene.background)
    for part in (*scene.meshes, *scene.lights):
        _add(part, shown)

    def render(samples, seed):
        _set(shown.cycles, samples=samples, seed=seed)
        with tempfile.TemporaryDirectory() as folder:
            bpy.ops.render.render(scene=shown.name)
            file = str(Path(folder) / "shown.exr")
            bpy.data.images["Render Result"].save_render(file, scene=shown)
            image = bpy.data.images.load(file)
            pixels = np.empty((*camera.sensor.shape, 4), np.float32)
            image.pixels.foreach_get(pixels.ravel())
            bpy.data.images.remove(image)
        return pixels[::-1, :, :3]

    return render


def _described_camera(camera):
    thin = thin_camera(camera)
    made = bpy.data.cameras.new("camera")
    width = camera.sensor.shape[1] * camera.sensor.pixel_pitch
    _set(made, sensor_fit="HORIZONTAL", sensor_width=width, lens=thin.image_distance, clip_start=1.0, clip_end=FAR)
    stop = 1e-3 * thin.image_distance / (2 * thin.aperture_radius)  # Blender's lens is in mm, all else in m
    _set(made.dof, use_dof=True, focus_distance=thin.object_distance, aperture_fstop=stop)
    return made


@functools.singledispatch
def _add(part, shown):
    raise TypeError(f"no counterpart in Cycles is known for a {type(part).__name__}")


@_add.register
def _(mesh: pl.Mesh, shown):
    made = bpy.data.meshes.new("mesh")
    made.from_pydata(mesh.vertices.tolist(), [], mesh.faces.tolist())
    if mesh.uv is not None:
        made.uv_layers.new().data.foreach_set("uv", mesh.uv[mesh.faces].astype(np.float32).ravel())
    if mesh.normals is not None:
        made.normals_split_custom_set_from_vertices(mesh.normals.tolist())
    material = bpy.data.materials.new("material")
    material.use_nodes = True
    material.node_tree.nodes.clear()
    _node(material, "OutputMaterial", Surface=_surface(material, mesh.material))
    made.materials.append(material)
    _added(shown, made).shadow_terminator_geometry_offset = 0.0


@_add.register
def _(light: pl.QuadLight, shown):
    """Area lights, which Cycles samples best and lets light pass, before a black surface."""
    u, v, n = (vector / np.linalg.norm(vector) for vector in (light.edge_u, light.edge_v, light.normal))
    assert abs(u @ v) < 1e-9, "Cycles has rectangles"
    radiance = np.broadcast_to(light.radiance, 3)
    for side in (1, -1) if light.two_sided else (1,):
        made = bpy.data.lights.new("lamp", "AREA")
        _set(made, shape="RECTANGLE", size=np.linalg.norm(light.edge_u), size_y=np.linalg.norm(light.edge_v))
        _set(made, color=radiance / radiance.max(), energy=np.pi * light.area * radiance.max())
        axes = np.column_stack([u, -side * v, -side * n])
        _added(shown, made, _standing(axes, light.center + side * APART * n))
    corner = light.center - (light.edge_u + light.edge_v) / 2
    _add(pl.quad(corner, light.edge_u, light.edge_v, material=pl.Lambertian(0.0)), shown)


def _surface(tree, material):
    """The output of nodes that stand for a material."""
    if isinstance(material, pl.Lambertian):
        return _node(tree, "BsdfDiffuse", Color=_colour(tree, material.albedo), Roughness=0.0)
    if isinstance(material, pl.Conductor):
        return _conductor(tree, material)
    if isinstance(material, pl.Dielectric) and not np.any(material.absorption):
        shape = {"Roughness": np.sqrt(material.alpha), "IOR": material.index / material.exterior}
        return _node(tree, "BsdfGlass", distribution="GGX", Color=_colour(tree, 1.0), **shape)
    if isinstance(material, pl.materials.ThinGlass):
        return _thin_glass(tree, material)
    if isinstance(material, pl.Emissive):
        shines = _node(tree, "Emission", Color=_colour(tree, material.radiance))
        back = 0.0 if material.two_sided else _node(tree, "NewGeometry", "Backfacing")
        return _mixed(tree, back, shines, _black(tree))
    raise TypeError(f"no counterpart in Cycles is known for {material!r}")


def _conductor(tree, material):
    shape = {"distribution": "GGX", "Roughness": np.sqrt(material.alpha)}
    if material.index is None:
        return _node(tree, "BsdfAnisotropic", Color=_colour(tree, material.reflectance), **shape)
    index = np.broadcast_to(material.index, 3)
    metal = {"fresnel_type": "PHYSICAL_CONDUCTOR", "IOR": index.real, "Extinction": index.imag}
    whole = _node(tree, "BsdfMetallic", **shape, **metal)
    return _mixed(tree, float(material.reflectance), _black(tree), whole)


def _thin_glass(tree, material):
    """All orders of reflection between two sides: 2 R / (1 + R). Cycles' Fresnel node inverts the index at backs."""
    back = _node(tree, "NewGeometry", "Backfacing")
    index = _sum(tree, "MULTIPLY_ADD", back, 1 / material.index - material.index, material.index)
    once = _node(tree, "Fresnel", IOR=index)
    share = _sum(tree, "DIVIDE", _sum(tree, "MULTIPLY", once, 2.0), _sum(tree, "ADD", once, 1.0))
    through = _node(tree, "BsdfTransparent", Color=_colour(tree, material.transmittance))
    return _mixed(tree, share, through, _node(tree, "BsdfAnisotropic", Color=_colour(tree, 1.0), Roughness=0.0))


def _black(tree):
    return _node(tree, "BsdfDiffuse", Color=_colour(tree, 0.0))


def _show_background(shown, background):
    shown.world = world = bpy.data.worlds.new("world")
    world.use_nodes = True
    world.node_tree.nodes.clear()
    if isinstance(background, pl.EnvironmentMap):
        # Cycles' maps begin at -x and turn to y, with z up; ours begin at z and turn to -x, with y up.
        turn = np.array([[0, 0, -1], [-1, 0, 0], [0, 1, 0]], float)
        turn = turn if background.rotation is None else turn @ background.rotation.T
        direction = _node(world, "TexCoord", "Generated")
        euler = mathutils.Matrix(turn.tolist()).to_euler("XYZ")
        turned = _node(world, "Mapping", vector_type="POINT", Vector=direction, Rotation=euler)
        seen = _node(world, "TexEnvironment", image=_image(background.texels), Vector=turned)
    else:
        seen = _colour(world, 0.0 if background is None else background.radiance)
    _node(world, "OutputWorld", Surface=_node(world, "Background", Color=seen))


def _colour(tree, given):
    if isinstance(given, pl.Texture):
        return _node(tree, "TexImage", image=_image(given.texels))
    return (*map(float, np.broadcast_to(given, 3)), 1.0)


def _image(texels):
    rows, columns = texels.shape[:2]
    made = bpy.data.images.new("texels", columns, rows, float_buffer=True, is_data=True)
    pixels = np.ones((rows, columns, 4), np.float32)
    pixels[..., :3] = texels[::-1]
    made.pixels.foreach_set(pixels.ravel())
    made.pack()
    return made


def _mixed(tree, *share_and_both):
    return _in_order(tree, "MixShader", share_and_both)


def _sum(tree, operation, *values):
    return _in_order(tree, "Math", values, operation=operation)


def _in_order(tree, kind, values, **attributes):
    """An output of a new node with these inputs."""
    node = tree.node_tree.nodes.new("ShaderNode" + kind)
    _set(node, **attributes)
    for socket, value in zip(node.inputs, values, strict=False):
        _give(tree, socket, value)
    return node.outputs[0]


def _node(tree, kind, output=0, **given):
    """An output of a new node; what is given are inputs, by name, or else attributes."""
    node = tree.node_tree.nodes.new("ShaderNode" + kind)
    for name, value in given.items():
        if name in node.inputs:
            _give(tree, node.inputs[name], value)
        else:
            setattr(node, name, value)
    return node.outputs[output] if node.outputs else node


def _give(tree, socket, value):
    if isinstance(value, bpy.types.NodeSocket):
        tree.node_tree.links.new(value, socket)
    else:
        socket.default_value = value


def _added(shown, data, matrix=None):
    made = bpy.data.objects.new(data.name, data)
    if matrix is not None:
        made.matrix_world = matrix
    shown.collection.objects.link(made)
    return made


def _standing(rotation, place):
    matrix = np.eye(4)
    matrix[:3] = np.column_stack([rotation, place])
    return mathutils.Matrix(matrix.tolist())


def _set(thing, **values):
    for name, value in values.items():
        setattr(thing, name, value)
