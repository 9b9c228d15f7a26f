"""
First light
===========

What the library is, in one picture: a still life of toy blocks through a focused plenoptic camera. The raw image and a
detail of it, a picture that is put together from the raw image and sharp everywhere, two that are refocused afterwards,
and the depth that the simulation knows.

The camera is the one of T. Michels et al., "Simulation of Plenoptic Cameras" (2018), with smaller pixels: a 100 mm
double Gauss, microlenses of focal length 2 mm that are 0.217 mm apart in a hexagonal lattice, and a sensor 1.7 mm
behind them.
"""

# %%
import os
import time
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib import font_manager
from PIL import Image, ImageDraw, ImageFont

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
SHAPE = (96, 120) if SMALL else (840, 1200)
SAMPLES = 8 if SMALL else 24

output = Path("output/first_light")
output.mkdir(parents=True, exist_ok=True)
began = time.perf_counter()

# %%
# The scene
# ---------
#
# Lengths are in mm and y points up. Blocks of 4.3 mm with letters stand on a wooden table, the L 67 mm nearer than the
# T; with them a glazed vase, and balls of glass, gold and red plastic. Light comes from a window on the left, and some
# from everywhere.


def wood(rows=768, columns=512):
    """Planks: noise that is stretched along the grain, another brightness in each, and dark gaps."""
    random = np.random.default_rng(1)
    coarse = random.normal(size=(rows // 16, columns)).astype(np.float32)
    grain = np.asarray(Image.fromarray(coarse).resize((columns, rows), Image.Resampling.BICUBIC))
    plank = np.arange(columns) // 64
    value = 0.5 + 0.13 * np.sin(3.1 * plank**2) + 0.14 * grain + 0.05 * random.normal(size=grain.shape)
    value = np.where(np.arange(columns) % 64 < 2, 0.1, np.clip(value, 0.02, 1.0))
    return pl.Texture(value[:, :, np.newaxis] * (0.78, 0.50, 0.28))


def block(letter, ink):
    """A block with a letter on each face."""
    tile = Image.new("RGB", (160, 160), (236, 214, 172))
    draw = ImageDraw.Draw(tile)
    draw.rectangle((7, 7, 152, 152), outline=ink, width=11)
    font = ImageFont.truetype(font_manager.findfont("DejaVu Sans:bold"), 112)
    draw.text((80, 82), letter, fill=ink, font=font, anchor="mm")
    return pl.box(4.3, material=pl.MetallicRoughness(pl.Texture.from_image(tile), roughness=0.35))


planks = pl.MetallicRoughness(wood(), roughness=0.45)
table = pl.quad((-45, 0, 75), (90, 0, 0), (0, 0, -150), material=planks)
wall = pl.quad((-60, -10, -62), (120, 0, 0), (0, 70, 0), material=pl.Lambertian((0.50, 0.57, 0.62)))

inks = ((178, 24, 43), (214, 96, 0), (0, 120, 80), (0, 80, 160), (110, 50, 120))
places = ((-8.8, 31, 18), (-4.5, 15, -14), (-0.1, -1, 10), (4.3, -18, -20), (8.6, -36, 12))  # x, z, degrees
blocks = [
    block(letter, ink).rotated_deg((0, 1, 0), turn).translated(x, 2.15, z)
    for letter, ink, (x, z, turn) in zip("LIGHT", inks, places, strict=True)
]

up = np.linspace(0, 1, 49)
swell = 1.15 + 1.1 * np.sin(1.15 * np.pi * up + 0.35) ** 2
glaze = pl.MetallicRoughness((0.05, 0.20, 0.45), roughness=0.15)
gold = pl.Conductor(index=(0.18 + 3.42j, 0.42 + 2.35j, 1.37 + 1.77j), alpha=0.12)
things = [
    pl.shapes.turned(np.stack([swell, 7.6 * up], axis=1), material=glaze).translated(-7.2, 0, -20),
    pl.sphere(1.9, center=(4.6, 1.9, 22), material=pl.Dielectric(1.5)),
    pl.sphere(1.5, center=(9.0, 1.5, 10), material=gold),
    pl.sphere(1.2, center=(-1.4, 1.2, -24), material=pl.MetallicRoughness((0.7, 0.05, 0.04), roughness=0.2)),
]
window = pl.QuadLight.facing((-45, 60, 60), (0, 2, 0), (50, 50), radiance=7.0)
scene = pl.Scene([table, wall, *blocks, *things], [window], background=(0.22, 0.24, 0.28))
print(scene)

# %%
# The camera
# ----------
#
# It stands 404 mm from the G, where its microlenses are focused, and looks down by 10 degrees.

middle, tilt = np.array([0.0, 2.6, 0.0]), np.radians(10.0)
camera = pl.PlenopticCamera(
    lens=pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=5.0)),
    microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,), lattice=pl.Lattice.HEXAGONAL),
    sensor=pl.Sensor(shape=SHAPE, pixel_pitch=0.007),
    stop_to_microlenses=123.3,
    microlenses_to_sensor=1.7,
).posed(position=middle + 404 * np.array([0, np.sin(tilt), np.cos(tilt)]), look_at=middle)

# %%
# Raw image and white image
# -------------------------
#
# The white image is that of a scene of radiance 1: what vignetting and microlenses leave of it. The first run on a
# machine compiles for some seconds; compiled code is kept for later ones.

shot = pl.render(scene, camera, samples=SAMPLES, truth=pl.Truth.DEPTH)
white = pl.render_white(camera, samples=8)
for name, exposure in (("raw image", shot), ("white image", white)):
    print(f"{name}: relative error {100 * exposure.relative_error:.2f} %, {exposure.stats.seconds:.1f} s")

# %%
# Pictures from the raw image
# ---------------------------
#
# Neighbouring microlenses see a point of the scene at different places. This disparity, in pixels, says how to put
# their images together. ``depth`` finds it where there is texture; ``fill`` interpolates it on the bare wall.
# Planes to refocus on are in mm of the camera's frame, which looks along -z.

FINE = 0.217 / 8  # mm on the array from pixel to pixel of a picture
found = pl.lightfield.depth(shot, white)
sharp = pl.lightfield.render_view(shot, white, found, spacing=FINE, fill=True)
near, far = (pl.lightfield.render_view(shot, white, z=z, spacing=FINE) for z in (-374.0, -438.0))
depth = sharp.truth(scene, truth=pl.Truth.DEPTH).depth
for name, view in (("sharp everywhere", sharp), ("near", near), ("far", far)):
    error = np.nanmedian(view.standard_error) / np.nanmean(view.picture)
    print(f"{name}: {view}, error {100 * error:.2f} %")
print(f"depth: {np.nanmin(depth):.1f} mm to {np.nanmax(depth):.1f} mm")

# %%
# All of it
# ---------

NEAR_THE_G = (0.42, 0.64), (0.37, 0.59)  # parts of the rows and of the columns
brightest = np.nanpercentile(sharp.picture, 99.7)
rows, columns = (slice(*(length * np.array(part)).astype(int)) for length, part in zip(SHAPE, NEAR_THE_G, strict=True))


def for_the_screen(picture, top):
    return pl.images.linear_to_srgb(np.clip(np.nan_to_num(picture) / top, 0, 1))


raw = for_the_screen(shot.image, np.percentile(shot.image, 99.5))
detail = raw[rows, columns]
figure, axes = plt.subplots(2, 3, figsize=(16, 8.1), layout="constrained")
pictures = {
    f"raw image, {SHAPE[1]} x {SHAPE[0]} pixels": raw,
    f"detail, {detail.shape[1]} x {detail.shape[0]} pixels": detail,
    "put together: sharp everywhere": for_the_screen(sharp.picture, brightest),
    "refocused at 374 mm": for_the_screen(near.picture, brightest),
    "refocused at 438 mm": for_the_screen(far.picture, brightest),
}
for ax, (title, picture) in zip(axes.flat, pictures.items(), strict=False):
    ax.imshow(picture, interpolation="nearest" if picture is detail else "antialiased")
    ax.set_title(title, fontsize=15)
corner = (columns.start - 0.5, rows.start - 0.5)
axes[0, 0].add_patch(plt.Rectangle(corner, *detail.shape[1::-1], fill=False, edgecolor="white", linewidth=2))
drawn = axes[1, 2].imshow(depth, cmap="viridis_r", interpolation="nearest")
axes[1, 2].set_title("depth, ground truth", fontsize=15)
figure.colorbar(drawn, ax=axes[1, 2], label="mm", pad=0.01)
for ax in axes.flat:
    ax.set(xticks=[], yticks=[])

# %%
# EXR files keep everything: image, standard error, depth, the camera and the statistics; ``pl.Exposure.load`` gives
# them back. The JPEG is for looking at.

written = [output / name for name in ("raw.exr", "white.exr", "first_light.jpg")]
shot.save(written[0])
white.save(written[1])
figure.savefig(written[2], dpi=100, pil_kwargs={"quality": 72, "optimize": True})
print(f"{time.perf_counter() - began:.0f} s in all; written:", *(path.resolve() for path in written), sep="\n  ")
