"""
Scenes from files
=================

``load_file`` reads meshes, materials, lights and cameras; glTF files have all of them. This script writes such a file
and renders it through its own camera. Then it shows well-known meshes, where they are there: the folder that the
environment variable PLENOPTIC_SHARED names should hold ``assets/Duck.glb``, ``assets/BoxTextured.glb`` (both from
Khronos' sample assets), ``assets/spot_triangulated.obj`` with ``assets/spot_texture.png`` (Keenan Crane) and
``assets/stanford-bunny.obj`` (Stanford Computer Graphics Laboratory).
"""

# %%
import base64
import json
import math
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from PIL import Image, ImageDraw

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
PIXELS = 48 if SMALL else 384
SAMPLES = 8 if SMALL else 64

output = Path("output/file_gallery")
output.mkdir(parents=True, exist_ok=True)

# %%
# A file with everything
# ----------------------
#
# A card of 20 x 12 cm stands on the ground, a point light hangs above on the left, and a camera looks at it. Lengths
# are in metres. The origin of texture coordinates is the upper left corner of the image, as glTF has it.

label = Image.new("RGB", (80, 48), (240, 235, 220))
draw = ImageDraw.Draw(label)
draw.rectangle((0, 0, 79, 7), fill=(30, 90, 170))  # blue above
draw.text((6, 14), "glTF", fill=(20, 20, 20))
draw.polygon([(60, 40), (68, 14), (76, 40)], fill=(200, 60, 20))  # pointing up, on the right
label.resize((640, 384), Image.Resampling.NEAREST).save(output / "card.png")

card = np.array([(-0.1, 0, 0), (0.1, 0, 0), (0.1, 0.12, 0), (-0.1, 0.12, 0)], dtype="<f4")
uv = np.array([(0, 1), (1, 1), (1, 0), (0, 0)], dtype="<f4")
ground = np.array([(-0.5, 0, 0.5), (0.5, 0, 0.5), (0.5, 0, -0.5), (-0.5, 0, -0.5)], dtype="<f4")
corners = np.array([0, 1, 2, 0, 2, 3], dtype="<u2")
arrays = [card, uv, ground, corners]
starts = np.cumsum([0] + [array.nbytes for array in arrays]).tolist()
data = base64.b64encode(b"".join(array.tobytes() for array in arrays)).decode()


def accessor(number, component, kind):
    return {"bufferView": number, "componentType": component, "count": len(arrays[number]), "type": kind}


def mesh(position, material, **more):
    return {"primitives": [{"attributes": {"POSITION": position, **more}, "indices": 3, "material": material}]}


tilt = -0.1  # the camera looks a little down: a turn about x, as a quaternion
file = {
    "asset": {"version": "2.0"},
    "buffers": [{"uri": f"data:application/octet-stream;base64,{data}", "byteLength": starts[-1]}],
    "bufferViews": [
        {"buffer": 0, "byteOffset": start, "byteLength": array.nbytes}
        for start, array in zip(starts, arrays, strict=False)
    ],
    "accessors": [accessor(k, 5126, kind) for k, kind in enumerate(("VEC3", "VEC2", "VEC3"))]
    + [accessor(3, 5123, "SCALAR")],
    "images": [{"uri": "card.png"}],
    "textures": [{"source": 0}],
    "materials": [
        {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicFactor": 0, "roughnessFactor": 0.6}},
        {"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.6, 0.5, 1], "metallicFactor": 0, "roughnessFactor": 0.25}},
    ],
    "meshes": [mesh(0, 0, TEXCOORD_0=1), mesh(2, 1)],
    "cameras": [{"type": "perspective", "perspective": {"yfov": 0.45, "aspectRatio": 1, "znear": 0.01}}],
    "extensionsUsed": ["KHR_lights_punctual"],
    "extensions": {"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 1.5, "color": [1, 0.9, 0.8]}]}},
    "nodes": [
        {"mesh": 0},
        {"mesh": 1},
        {"extensions": {"KHR_lights_punctual": {"light": 0}}, "translation": [-0.3, 0.4, 0.4]},
        {
            "name": "front",
            "camera": 0,
            "translation": [0, 0.12, 0.6],
            "rotation": [math.sin(tilt / 2), 0, 0, math.cos(tilt / 2)],
        },
    ],
}
(output / "card.gltf").write_text(json.dumps(file, indent=1))

# %%
contents = pl.load_file(output / "card.gltf")
print(*contents.meshes, *contents.lights, *contents.views, sep="\n")

# %%
# A view says where the camera stands and how much it sees. A camera with a small hole sees as much if the sensor is
# 2 b tan(angle / 2) high at the distance b behind it.

(view,) = contents.views
height = 2 * 50.0 * math.tan(view.vertical_field_of_view / 2)
camera = pl.PlenopticCamera(
    lens=pl.no_lens(semi_diameter=0.2),
    sensor=pl.Sensor(shape=(PIXELS, PIXELS), pixel_pitch=height / PIXELS),
    stop_to_microlenses=50.0,
).posed(position=view.position, look_at=view.look_at, up=view.up)
scene = pl.Scene(contents.meshes, contents.lights, background=0.2)
shot = pl.render(scene, camera, samples=SAMPLES, progress=False)
shot.save(output / "card.exr")
pictures = {"card.gltf": shot.image}

# %%
# Well-known meshes
# -----------------
#
# Files rarely have lights. These get a square lamp above on the left, and a dim world. The camera stands where the mesh
# fills the picture; ``towards`` is the direction from the mesh to the camera. It sees the box from behind: on its front
# and right sides the file itself mirrors the picture.

shared = os.environ.get("PLENOPTIC_SHARED")
assets = None if shared is None else Path(shared) / "assets"
wanted = [
    ("Duck.glb", None, (0.4, 0.3, 1.0)),
    ("BoxTextured.glb", None, (-0.5, 0.4, -1.0)),
    ("spot_triangulated.obj", "spot_texture.png", (-0.6, 0.3, -1.0)),
    ("stanford-bunny.obj", None, (0.0, 0.2, 1.0)),
]


def portrait(meshes, towards):
    """A picture of meshes that fills the sensor."""
    low, high = pl.Scene(meshes).bounds
    middle, size = (low + high) / 2, float(np.linalg.norm(high - low))
    direction = np.array(towards) / np.linalg.norm(towards)
    aside = np.array([0.0, 1.2, 0.0]) - np.cross((0, 1, 0), direction)
    lamp = pl.QuadLight.facing(middle + 1.5 * size * (direction + aside), middle, (size, size), radiance=12.0)
    conventional = pl.PlenopticCamera(
        lens=pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=2.0)),
        sensor=pl.Sensor(shape=(PIXELS, PIXELS), pixel_pitch=20.0 / PIXELS),
        stop_to_microlenses=120.0,
    )
    # The picture of a plane at this distance is as many times smaller as the sensor is than the mesh.
    focal_length = pl.paraxial.cardinal_points(conventional.lens).efl
    distance = focal_length * (1 + size / 20.0)
    conventional = conventional.focused_at(z=-distance).posed(position=middle + distance * direction, look_at=middle)
    return pl.render(pl.Scene(meshes, [lamp], background=0.15), conventional, samples=SAMPLES, progress=False).image


for name, texture, towards in wanted:
    missing = [part for part in (name, texture) if part is not None and not (assets and (assets / part).exists())]
    if missing:
        print(f"{name} is left out: {missing[0]} is not in the folder assets of PLENOPTIC_SHARED")
        continue
    material = None if texture is None else pl.Lambertian(pl.Texture.load(assets / texture))
    meshes = pl.load_file(assets / name, unit="m", material=material).meshes
    print(*meshes)
    pictures[name] = portrait(meshes, towards)

# %%
figure, axes = plt.subplots(1, len(pictures), figsize=(4 * len(pictures), 4.3), squeeze=False)
for axis, (name, image) in zip(axes[0], pictures.items(), strict=True):
    shown = np.broadcast_to(image / np.percentile(image, 99.5), (*image.shape[:2], 3))
    axis.imshow(pl.images.linear_to_srgb(np.clip(shown, 0, 1)))
    axis.set_title(name)
    axis.axis("off")
figure.tight_layout()
figure.savefig(output / "file_gallery.png", dpi=110)
names = ("card.png", "card.gltf", "card.exr", "file_gallery.png")
print("written:", *(output / name for name in names), sep="\n  ")
