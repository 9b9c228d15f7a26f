# %% [markdown]
# # First light
#
# A small still life through a plenoptic camera: the raw image with its standard error and its depth, and the
# white image of the same camera. The camera is the one of T. Michels et al., "Simulation of Plenoptic Cameras"
# (2018): a 100 mm double Gauss, 0.217 mm microlenses of focal length 2 mm in a hexagonal lattice, and a sensor
# 1.7 mm behind them, so that the microlenses look at the main lens's image 11.3 mm behind them ("plenoptic 2.0").

# %%
import os
from pathlib import Path

import matplotlib

matplotlib.use("Agg")  # pictures go to files; leave this out in a notebook
import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
PIXELS = 48 if SMALL else 512
SAMPLES = 16 if SMALL else 128

output = Path("output/first_light")
output.mkdir(parents=True, exist_ok=True)

# %% [markdown]
# ## Camera and scene
#
# Lengths are in mm. The camera looks along -z; the still life that comes with the package stands about 404 mm
# in front of the iris, where this camera is focused.

# %%
camera = pl.PlenopticCamera(
    lens=pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=5.0)),
    microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,), lattice=pl.Lattice.HEXAGONAL),
    sensor=pl.Sensor(shape=(PIXELS, PIXELS), pixel_pitch=0.010),
    stop_to_microlenses=123.3,
    microlenses_to_sensor=1.7,
)
scene = pl.still_life()
print(scene)
print(pl.plan(scene, camera, samples=SAMPLES))

# %% [markdown]
# ## Raw image, error and depth
#
# All processors work. The first run on a machine compiles for some seconds; later runs find the compiled
# kernels in the user's cache folder.

# %%
shot = pl.render(scene, camera, samples=SAMPLES)
print(f"raw: relative error {100 * shot.relative_error:.2f} %, {shot.stats.seconds:.1f} s")
print(shot.stats)

# %% [markdown]
# ## White image
#
# A scene of radiance 1 everywhere: what vignetting and microlenses leave of it. The raw image divided by the
# white image is radiance. In this camera only the rims of microlens images are not known beforehand: few samples do.

# %%
white = pl.render_white(camera, samples=16)
print(f"white: relative error {100 * white.relative_error:.2f} %, {white.stats.seconds:.1f} s")

# %% [markdown]
# ## What is written
#
# EXR files keep everything: image, standard error, depth, the camera and the statistics. `pl.Exposure.load`
# gives them back. PNG files of 16 bits are for looking at.

# %%
names = ("raw.exr", "raw.png", "white.exr", "white.png", "depth.png", "overview.png", "first_light.png")
raw_exr, raw_png, white_exr, white_png, depth_png, overview_png, picture_png = (output / name for name in names)
shot.save(raw_exr)
shot.save(raw_png, scale=float(np.percentile(shot.image, 99.9)))
white.save(white_exr)
white.save(white_png)

# Depth as a picture: near is bright, and black is where nothing is met.
met = np.isfinite(shot.depth)
near, far = shot.depth[met].min(), shot.depth[met].max()
print(f"depth: {near:.2f} mm to {far:.2f} mm")
nearness = np.where(met, 0.1 + 0.9 * (far - shot.depth) / max(far - near, 1e-9), 0.0)
pl.Exposure(nearness[:, :, np.newaxis]).save(depth_png, scale=1.0)

pl.plots.plot_exposure(shot).savefig(overview_png, dpi=110)

# %% [markdown]
# ## Raw image, a detail of it, and depth

# %%
seen = pl.images.linear_to_srgb(np.clip(shot.image / np.percentile(shot.image, 99.9), 0, 1))
low, high = 3 * PIXELS // 8, 5 * PIXELS // 8
figure, axes = plt.subplots(1, 3, figsize=(10.2, 3.3), layout="constrained")
axes[0].imshow(seen)
axes[0].add_patch(plt.Rectangle((low, low), high - low, high - low, fill=False, edgecolor="white"))
axes[1].imshow(seen[low:high, low:high], interpolation="nearest")
drawn = axes[2].imshow(np.ma.masked_invalid(shot.depth), interpolation="nearest", cmap="viridis")
figure.colorbar(drawn, ax=axes[2], label="mm")
for ax, title in zip(axes, ("raw image", "detail", "depth"), strict=True):
    ax.set(xticks=[], yticks=[], title=title)
figure.savefig(picture_png, dpi=100)

# %%
print("written:", *((output / name).resolve() for name in names), sep="\n  ")
