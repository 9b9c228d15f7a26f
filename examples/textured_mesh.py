"""
A textured mesh from a file
===========================

``pl.Scene.load`` reads OBJ, glTF, PLY and STL files with vertex normals, texture coordinates and image textures. This
script writes a small labelled tin as an OBJ file and renders it; another file can be named on the command line::

    python examples/textured_mesh.py spot.obj cm
    python examples/textured_mesh.py spot.obj cm spot.png

The unit is that of the file; the image replaces the materials of the file.
"""

# %%
import os
import sys
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
PIXELS = 48 if SMALL else 512
SAMPLES = 8 if SMALL else 128

output = Path("output/textured_mesh")
output.mkdir(parents=True, exist_ok=True)

# %%
# A tin with a label
# ------------------
#
# The label goes round the tin once; its middle faces +z. Texture coordinates count from the lower left corner
# of the image.

label = Image.new("RGB", (96, 40), (200, 190, 160))
draw = ImageDraw.Draw(label)
draw.rectangle((0, 0, 95, 5), fill=(170, 30, 30))  # red above
draw.rectangle((0, 34, 95, 39), fill=(30, 60, 150))  # blue below
for text, y, ink in (("PEAS", 8, (20, 90, 30)), ("400 g", 20, (40, 40, 40))):
    draw.text((48 - draw.textlength(text) / 2, y), text, fill=ink)
label.resize((768, 320), Image.Resampling.NEAREST).save(output / "label.png")

segments = 64
turn = np.arange(segments + 1) / segments
angle = 2 * np.pi * (turn - 0.5)
x, z = np.sin(angle), np.cos(angle)
lines = ["mtllib tin.mtl", "usemtl label"]
for y, v in ((0.0, 0.0), (11.0, 1.0)):  # a tin 8 cm wide and 11 cm high; the file's unit is the centimetre
    lines += [f"v {4 * a:.6f} {y:.6f} {4 * b:.6f}" for a, b in zip(x, z, strict=True)]
    lines += [f"vt {u:.6f} {v:.6f}" for u in turn]
    lines += [f"vn {a:.6f} 0 {b:.6f}" for a, b in zip(x, z, strict=True)]
for i in range(1, segments + 1):
    below, above = (i, i + 1), (i + segments + 1, i + segments + 2)
    for triangle in ((below[0], below[1], above[1]), (below[0], above[1], above[0])):
        lines.append("f " + " ".join(f"{k}/{k}/{k}" for k in triangle))
(output / "tin.obj").write_text("\n".join(lines) + "\n")
(output / "tin.mtl").write_text("newmtl label\nKd 1 1 1\nmap_Kd label.png\n")

# A notebook has arguments of its own.
named = sys.argv[1:] if len(sys.argv) > 2 and not sys.argv[1].startswith("-") else [output / "tin.obj", "cm"]
path, unit = named[:2]
material = pl.Lambertian(pl.Texture.load(named[2])) if len(named) > 2 else None

# %%
# The scene
# ---------
#
# A file says nothing about its unit, so that has to be said. There is no light unless it is given: here a square
# lamp above on the left, and a dim world.

meshes = pl.load_meshes(path, unit=unit, material=material)
low, high = pl.Scene(meshes).bounds
middle, size = (low + high) / 2, float((high - low).max())
lamp = pl.QuadLight.facing(middle + size * np.array([-1.5, 2.0, 2.0]), middle, (size, size), radiance=25.0)
scene = pl.Scene.load(path, unit=unit, material=material, lights=[lamp], background=(0.10, 0.12, 0.15))
print(scene, f"size {size:.1f} mm")

# %%
# The camera
# ----------
#
# It stands where the mesh fills the sensor, a little above it, and is focused on its middle. The farther the mesh,
# the closer the array moves to the lens; a stop of 8 mm keeps the micro images from overlapping there.

camera = pl.PlenopticCamera(
    lens=pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=4.0)),
    microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)),
    sensor=pl.Sensor(shape=(PIXELS, PIXELS), pixel_pitch=5.12 / PIXELS),
    stop_to_microlenses=123.3,
    microlenses_to_sensor=1.7,
)
efl = pl.paraxial.cardinal_points(camera.lens).efl
distance = 1.3 * size * efl / 5.12 + efl
towards = np.array([0.15, 0.25, 1.0]) / np.linalg.norm([0.15, 0.25, 1.0])
camera = camera.focused_at(z=-distance).posed(position=middle + distance * towards, look_at=middle)
print(f"camera {distance:.0f} mm away, microlenses {camera.stop_to_microlenses:.2f} mm behind the iris")

# %%
shot = pl.render(scene, camera, samples=SAMPLES, progress=False)
print(shot)

# %%
# The same through a conventional camera
# --------------------------------------
#
# Without microlenses, the sensor stands where the main lens forms the image.

conventional = pl.PlenopticCamera(
    lens=camera.lens, sensor=camera.sensor, stop_to_microlenses=camera.stop_to_microlenses, pose=camera.pose
).focused_at(z=-distance)
photograph = pl.render(scene, conventional, samples=SAMPLES, progress=False)
print(photograph)

# %%
written = []
for name, exposure in (("raw", shot), ("conventional", photograph)):
    exposure.save(output / f"{name}.exr")
    exposure.save(output / f"{name}.png", scale=float(np.percentile(exposure.image, 99.8)))
    pl.plots.plot_exposure(exposure).savefig(output / f"{name}_overview.png", dpi=110)
    written += [output / f"{name}.exr", output / f"{name}.png", output / f"{name}_overview.png"]
print("written:", *written, sep="\n  ")
