"""
Dual pixels: a pair and its disparity
=====================================

Each pixel of a phone's sensor has a left and a right half under one on-chip lens. Points out of focus are displaced
between the images of both halves: nearer ones to one side, farther ones to the other. The disparity of a pair is
matched here, and compared with that of rays through the lens.
"""

# %%
import math
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
SAMPLES, SHAPE, BINNING = (32, (96, 144), 3) if SMALL else (128, (288, 432), 1)

output = Path("output/dual_pixel")
output.mkdir(parents=True, exist_ok=True)

# %%
# Camera
# ------
#
# The preset of a phone with a part of its sensor, focused at 300 mm; on-chip lenses are shifted for the chief rays of
# that part.

phone = pl.load_camera("google-pixel-2-like").focused_at(-300.0)
pitch = BINNING * phone.sensor.pixel_pitch
half_diagonal = pl.Sensor(SHAPE, pitch).half_diagonal
sensor = pl.sensor.dual_pixel(
    pitch, SHAPE, cra=math.atan(half_diagonal / phone.report().exit_pupil_distance), gap=0.07 * pitch, crosstalk=0.02
)
camera = pl.PlenopticCamera(phone.lens, sensor, phone.stop_to_microlenses)

# %%
# Scene
# -----
#
# Three boards of random grey squares side by side: before the plane in focus, in it, and behind it.

random = np.random.default_rng(1)
s = phone.report().exit_pupil_distance
DEPTHS = (200.0, 300.0, 600.0)


def board(number, depth):
    """Board that fills a third of the image, with more beyond the image's edges and behind the board before it."""
    rows, columns = SHAPE
    pixel = depth * pitch / s
    left, right = ((-0.6, -1 / 6), (-0.3, 1 / 6), (0.0, 0.6))[number]
    width, height = (right - left) * columns * pixel, 1.2 * rows * pixel
    texels = random.uniform(0.1, 0.9, (int(0.24 * rows), int(0.2 * (right - left) * columns), 1)).repeat(3, axis=2)
    material = pl.Lambertian(pl.Texture(texels))  # squares of five pixels
    return pl.quad((left * columns * pixel, -height / 2, -depth), (width, 0, 0), (0, height, 0), material=material)


scene = pl.Scene([board(number, depth) for number, depth in enumerate(DEPTHS)], background=1.0)

# %%
# A pair
# ------

halves = [pl.render(scene, well, samples=SAMPLES) for well in pl.sensor.well_cameras(camera)]
pair = pl.sensor.read_wells(halves)
for name, half in zip(("left", "right"), pair.exposures, strict=True):
    half.save(output / f"{name}.exr")
    print(output / f"{name}.exr", f"relative error {100 * half.relative_error:.1f} %")

# %%
# Disparity and depth
# -------------------
#
# The truth is the disparity of rays through the lens for the true depth of each pixel.

geometry = pl.sensor.pair_geometry(camera)
truth = pl.ground_truth(scene, camera, truth=pl.Truth.DEPTH).depth
disparity = geometry.disparity(truth)
limit = 1.3 * float(np.abs(disparity[np.isfinite(truth)]).max())
matched = pl.lightfield.depth(pair, disparity_range=(-limit, limit))

print("\ndepth     of rays   matched   matched depth")
for number, depth in enumerate(DEPTHS):
    part = np.s_[
        SHAPE[0] // 4 : -SHAPE[0] // 4, (2 * number + 1) * SHAPE[1] // 6 - 8 : (2 * number + 1) * SHAPE[1] // 6 + 8
    ]
    values = (np.nanmedian(each[part]) for each in (disparity, matched.disparity, matched.depth))
    print("{:3.0f} mm {:8.2f} {:9.2f} {:11.1f} mm".format(depth, *values))

# %%
# Figure
# ------

figure, axes = plt.subplots(2, 2, figsize=(11, 8), layout="constrained")
brightest = np.percentile(pair.left, 99.5)
for ax, title, half in zip(axes[0], ("left half", "right half"), (pair.left, pair.right), strict=True):
    ax.imshow(half / brightest, cmap="gray", vmin=0, vmax=1)
    ax.set_title(f"image of the {title}")
for ax, title, values in zip(axes[1], ("of rays", "matched"), (disparity, matched.disparity), strict=True):
    shown = ax.imshow(values, cmap="RdBu", vmin=-limit, vmax=limit)
    ax.set_title(f"disparity {title}: boards at 200, 300 and 600 mm")
for ax in axes.flat:
    ax.set_xlabel("column / pixels")
    ax.set_ylabel("row / pixels")
figure.colorbar(shown, ax=axes[1], label="disparity, left minus right column / pixels")
figure.suptitle(f"Dual pixels of {1e3 * pitch:.1f} um behind f/1.8, focused at 300 mm")
figure.savefig(output / "pair.png", dpi=120)
print(output / "pair.png")
