"""
Scenes from Blender
===================

Scenes are modelled in a program for that, and come here as glTF files: meshes with materials and textures, lights, and
cameras. What must be set when exporting, what comes through, in which units, and how to find out whether a rendering
is what it should be. The file is made by this script, as Blender would write it, so that nothing else is needed.
"""

# %%
# From Blender
# ------------
#
# File > Export > glTF 2.0 (.glb/.gltf), and there:
#
# * Include: *Cameras* and *Punctual Lights*, which are both off at first; *Selected Objects* where not all is wanted.
# * Transform: *+Y Up*, as it is. What is up in Blender (z) is up here (y).
# * Mesh: *Apply Modifiers*, *UVs*, *Normals*; *Tangents* are not read.
# * Lighting: *Standard* writes candela and lux, *Unitless* Blender's own numbers. Either is fine, since what a scene's
#   unit of radiance is, is up to you; the sensor model turns it into electrons.
#
# Model in true size: Blender's unit is the metre, and so is that of the file. ``load`` makes millimetres of it. Point
# lights, spots and suns come through; area lights and the world's background do not, and are given here in Python.
# Materials are those of the *Principled BSDF* node; its textures must be images, not procedures: bake those.

# %%
import json
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import trimesh
from PIL import Image

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
ROWS = 96 if SMALL else 360  # pixels
SAMPLES = (8, 16) if SMALL else (8, 32, 128)

output = Path("output/blender_scene")
output.mkdir(parents=True, exist_ok=True)

# %%
# A file as from Blender
# ----------------------
#
# A table of 90 mm with a texture, a plaster cube of 10 mm, a gold ball and a lacquered one, all in metres. trimesh
# writes meshes and materials; lights and cameras are a few lines of JSON. ``intensity`` is candela.

random = np.random.default_rng(4)
frequency = np.hypot(*np.meshgrid(4 * np.fft.fftfreq(256), np.fft.fftfreq(256)))  # grain along x
grey = np.fft.ifft2(np.fft.fft2(random.normal(size=(256, 256))) / np.maximum(frequency, 1 / 256)).real
share = np.clip(0.5 + 0.25 * grey / grey.std(), 0, 1)[..., np.newaxis]
wood = Image.fromarray(np.uint8(255 * ((1 - share) * (0.42, 0.25, 0.14) + share * (0.85, 0.66, 0.44))))
paint = trimesh.visual.material.PBRMaterial
LIGHT, INTENSITY = (0.04, 0.09, 0.06), 0.02  # m, candela
ALBEDO = 0.6


def placed(mesh, material, shift, uv=None, turn=0.0):
    """A mesh with its material, turned about the vertical and shifted."""
    mesh.visual = trimesh.visual.TextureVisuals(
        uv=np.zeros((len(mesh.vertices), 2)) if uv is None else uv, material=material
    )
    mesh.apply_transform(trimesh.transformations.rotation_matrix(turn, (0, 1, 0)))
    return mesh.apply_translation(shift)


corners = np.array([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)]) * 0.045
table = trimesh.Trimesh(corners, [(0, 1, 2), (0, 2, 3)], process=False)
plaster = paint(name="plaster", baseColorFactor=(ALBEDO, ALBEDO, ALBEDO, 1.0), metallicFactor=0.0, roughnessFactor=1.0)
gold = paint(name="gold", baseColorFactor=(1.0, 0.77, 0.34, 1.0), metallicFactor=1.0, roughnessFactor=0.3)
lacquer = paint(name="lacquer", baseColorFactor=(0.6, 0.03, 0.03, 1.0), metallicFactor=0.0, roughnessFactor=0.5)
wooden = paint(name="wood", baseColorTexture=wood, metallicFactor=0.0, roughnessFactor=0.8)
cube = trimesh.creation.box((0.010,) * 3)
cube.unmerge_vertices()  # sharp edges: each face has normals of its own
things = {
    "table": placed(table, wooden, (0, 0, 0), uv=[(0, 0), (1, 0), (1, 1), (0, 1)]),
    "cube": placed(cube, plaster, (-0.007, 0.005, -0.004), turn=0.6),
    "gold": placed(trimesh.creation.icosphere(4, 0.0045), gold, (0.006, 0.0045, -0.010)),
    "lacquer": placed(trimesh.creation.icosphere(4, 0.003), lacquer, (0.005, 0.003, 0.006)),
}
files = trimesh.Scene(things).export(file_type="gltf", include_normals=True, merge_buffers=True)
document = json.loads(files["model.gltf"])

eye, aim = np.array((0.0, 0.16, 0.38)), np.array((0.0, 0.003, 0.0))
back = (eye - aim) / np.linalg.norm(eye - aim)
right = np.cross((0, 1, 0), back) / np.linalg.norm(np.cross((0, 1, 0), back))
seat = np.eye(4)
seat[:3, :3], seat[:3, 3] = np.stack([right, np.cross(back, right), back], axis=1), eye
FIELD = 0.075  # radians, from the lower to the upper edge
document["cameras"] = [{"type": "perspective", "perspective": {"yfov": FIELD, "aspectRatio": 4 / 3, "znear": 0.01}}]
document["extensions"] = {
    "KHR_lights_punctual": {"lights": [{"type": "point", "name": "bulb", "color": [1, 1, 1], "intensity": INTENSITY}]}
}
document["extensionsUsed"] = ["KHR_lights_punctual", "KHR_materials_clearcoat"]
for material in document["materials"]:
    if material["name"] == "lacquer":
        material["extensions"] = {"KHR_materials_clearcoat": {"clearcoatFactor": 1.0, "clearcoatRoughnessFactor": 0.05}}
document["nodes"] += [
    {"name": "camera", "camera": 0, "matrix": seat.T.ravel().tolist()},
    {"name": "bulb", "extensions": {"KHR_lights_punctual": {"light": 0}}, "translation": LIGHT},
]
document["scenes"][0]["nodes"] += [len(document["nodes"]) - 2, len(document["nodes"]) - 1]
files["model.gltf"] = json.dumps(document).encode()
folder = output / "model"
folder.mkdir(exist_ok=True)
for name, content in files.items():
    (folder / name).write_bytes(content)

# %%
# What came through
# -----------------
#
# ``load_file`` gives all that the file holds. The first look is at the size: a table that is 90 mm wide in Blender is
# 90 mm wide here, and not 90 m or 90 um.

contents = pl.load_file(folder / "model.gltf")
file_scene = pl.Scene(contents.meshes, contents.lights)
low, high = file_scene.bounds
print(file_scene, f"{high[0] - low[0]:.1f} mm wide, {high[1] - low[1]:.1f} mm high")
for mesh in contents.meshes:
    print(f"  {mesh.name:10s} {type(mesh.material).__name__:18s} {np.round(mesh.bounds[1] - mesh.bounds[0], 3)} mm")
view = contents.views[0]
ahead = (view.look_at - view.position) / np.linalg.norm(view.look_at - view.position)
print(*contents.lights, f"camera at {view.position} mm, looks towards {np.round(ahead, 3)}", sep="\n")

# %%
# The camera of the file
# ----------------------
#
# A camera of Blender is a pinhole: it has a place, a direction and a field of view, and no optics. Our lens stands so
# that the centre of its entrance pupil is where the pinhole was, which gives the same perspective. It is focused on
# the cube, and the sensor is as high as the magnification there makes the field of view.

lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=6.0))
pupil = pl.paraxial.cardinal_points(lens).entrance_pupil
middle = np.array([-7.0, 5.0, -4.0])
distance = float((middle - view.position) @ ahead)
height = abs(pl.paraxial.magnification(lens, pupil - distance)) * 2 * distance * np.tan(view.vertical_field_of_view / 2)
columns = round(ROWS * view.aspect_ratio)
sensor = pl.Sensor((ROWS, columns), height / ROWS)
pose = {"position": view.position + pupil * ahead, "look_at": view.look_at, "up": view.up}
image = pl.aberrations.best_focus(lens, z_object=pupil - distance)
conventional = pl.PlenopticCamera(lens=lens, sensor=sensor, stop_to_microlenses=image).posed(**pose)
print(
    f"{distance:.1f} mm from the entrance pupil to the cube, sensor {columns * sensor.pixel_pitch:.2f} mm x "
    f"{height:.2f} mm"
)

# %%
# The lamp that the file does not have
# ------------------------------------
#
# An area light and a background are added here. What is rendered says what it costs; error beside time:

lamp = pl.QuadLight.facing((-90, 150, 60), (0, 0, 0), (60, 60), radiance=3.0)
scene = pl.Scene(contents.meshes, (*contents.lights, lamp), background=(0.20, 0.24, 0.30))
print("samples   error %   CPU s   wall s")
pl.render(scene, conventional, samples=2, progress=False)  # compiles, if this is the first time
for samples in SAMPLES:
    photograph = pl.render(scene, conventional, samples=samples, truth=pl.Truth.DEPTH | pl.Truth.OBJECT, progress=False)
    print(
        f"{samples:7d} {100 * photograph.relative_error:9.1f} {photograph.stats.cpu_seconds:7.1f} "
        f"{photograph.stats.seconds:8.1f}"
    )

# %%
# Is everything where it should be?
# ---------------------------------
#
# The corners of the cube, by the pinhole of the file and traced through the real lens. What differs is distortion:
# both have the same perspective.

cube = next(mesh for mesh in contents.meshes if mesh.name.startswith("cube"))
points = np.unique(cube.vertices.round(9), axis=0)
axes_of_view = np.stack([right, np.cross(back, right), back])
local = (points - view.position) @ axes_of_view.T
scale = ROWS / 2 / np.tan(view.vertical_field_of_view / 2)
by_pinhole = np.stack([
    (ROWS - 1) / 2 - scale * local[:, 1] / -local[:, 2], (columns - 1) / 2 + scale * local[:, 0] / -local[:, 2]
], axis=1)  # fmt: skip
traced = conventional.project(points, progress=False)
off = traced.pixel - by_pinhole[traced.point]
print(f"{len(points)} corners of the cube: traced minus pinhole, at most {np.abs(off).max():.2f} of {ROWS} pixels")

figure, axes = plt.subplots(1, 2, figsize=(12.6, 4.7), layout="constrained")
bright = np.percentile(photograph.image, 99.3)
axes[0].imshow(pl.images.linear_to_srgb(np.clip(photograph.image / bright, 0, 1)))
axes[0].plot(*by_pinhole.T[::-1], "o", fillstyle="none", color="white", label="by the file's pinhole")
axes[0].plot(*traced.pixel.T[::-1], "+", color="cyan", label="traced")
axes[0].legend(fontsize=9, loc="upper left")
axes[0].set_title("The file through a conventional camera")
depth = axes[1].imshow(np.ma.masked_invalid(photograph.depth), cmap="viridis")
axes[1].set_title("depth")
figure.colorbar(depth, ax=axes[1], label="mm", shrink=0.85)
for ax in axes:
    ax.set(xlabel="column / pixel", ylabel="row / pixel")
figure.savefig(output / "photograph.png", dpi=120)

# %%
# Is it as bright as it should be?
# --------------------------------
#
# Light of a point of intensity I at the distance d (in the unit of the file, metres) under the angle t to the normal
# makes a matt surface of albedo A as bright as A / pi I cos t / d^2. Rendered with one bounce, the top of
# the cube must be that, to a part in a thousand: over a pixel and the depth of field d differs a little. Plaster is
# glTF's material, which reflects 4 % of the light at its surface, more at grazing angles, before the albedo acts. For
# the comparison the cube gets a Lambertian material, and its own beside that.

matt = pl.Scene([cube.with_material(pl.Lambertian(ALBEDO))], contents.lights)
glossy = pl.Scene([cube], contents.lights)
truth = pl.ground_truth(matt, conventional, truth=pl.Truth.POSITION | pl.Truth.NORMAL, progress=False)
white = pl.render_white(conventional, samples=SAMPLES[-1], seed=1, progress=False)
top = (truth.normal[..., 1] > 0.999) & np.isfinite(truth.position[..., 0])
inner = top & np.roll(top, 3, 0) & np.roll(top, -3, 0) & np.roll(top, 3, 1) & np.roll(top, -3, 1)
way = np.array(LIGHT) - truth.position[inner] / 1000
expected = ALBEDO / np.pi * INTENSITY * way[:, 1] / np.linalg.norm(way, axis=1) ** 3
for name, one in {"Lambertian": matt, "plaster of the file": glossy}.items():
    shot = pl.render(one, conventional, samples=SAMPLES[-1], max_bounces=1, progress=False)
    value, clear = shot.image[inner], white.image[inner]
    radiance = (value / clear).mean(axis=1)
    relative = np.hypot(shot.standard_error[inner] / value, white.standard_error[inner] / clear).mean(axis=1)
    error = np.sqrt(np.sum((relative * radiance) ** 2, dtype=float)) / inner.sum()
    print(
        f"top of the cube, {name}: {radiance.mean():.5f} +- {error:.5f}, expected of a matt one {expected.mean():.5f}"
    )

# %%
# Through a plenoptic camera
# --------------------------
#
# The same place, the same lens, and microlenses. The raw image with its depth is what the file was made for.

design = pl.design_camera(
    lens,
    sensor=sensor,
    kind=pl.CameraKind.GALILEAN,
    z=pupil - distance,
    pitch=20 * sensor.pixel_pitch,
    focal_length=150 * sensor.pixel_pitch,
    virtual_depth=4.0,
    image_fill=0.8,
)
camera = design.camera.posed(**pose)
shot = pl.render(scene, camera, samples=SAMPLES[-1], truth=pl.Truth.DEPTH | pl.Truth.CHORD_DISPARITY, progress=False)
white = pl.render_white(camera, samples=SAMPLES[-1], seed=1, progress=False)
picture = pl.lightfield.render_view(shot, white, shot.truth.chord_disparity, progress=False).picture
print(
    f"raw image: error {100 * shot.relative_error:.1f} %, {shot.stats.cpu_seconds:.1f} CPU s, "
    f"{shot.stats.seconds:.1f} s"
)
figure, axes = plt.subplots(1, 3, figsize=(14, 3.9), layout="constrained")
bright = np.percentile(shot.image, 99.3)
axes[0].imshow(pl.images.linear_to_srgb(np.clip(shot.image / bright, 0, 1)), interpolation="nearest")
axes[0].set(title="raw image", xlabel="column / pixel", ylabel="row / pixel")
depth = axes[1].imshow(np.ma.masked_invalid(shot.depth), cmap="viridis", interpolation="nearest")
axes[1].set(title="depth of each raw pixel", xlabel="column / pixel")
figure.colorbar(depth, ax=axes[1], label="mm", shrink=0.85)
axes[2].imshow(pl.images.linear_to_srgb(np.clip(np.nan_to_num(picture) / np.nanpercentile(picture, 99.3), 0, 1)))
axes[2].set(title="put together, sharp everywhere", xlabel="column / sixth of a pitch")
figure.savefig(output / "raw_image.png", dpi=120)
print("written:", *sorted(path for path in output.iterdir()), sep="\n  ")
