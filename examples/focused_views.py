# %% [markdown]
# # Views of a focused camera
#
# The still life through a focused plenoptic camera with three types of microlenses: a picture that is sharp everywhere
# is put together from the raw image, from the middle of the pupil and from its right, and two that are refocused.

# %%
import os
from pathlib import Path

import matplotlib

matplotlib.use("Agg")  # pictures go to files; leave this out in a notebook
import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
SHAPE = (96, 120) if SMALL else (660, 900)
SAMPLES = 8 if SMALL else 64

output = Path("output/focused_views")
output.mkdir(parents=True, exist_ok=True)

# %% [markdown]
# ## Raw image
#
# With the ground truth of disparity, which is pixels between neighbouring microlenses. Without a known scene,
# `pl.lightfield.depth(shot, white).disparity` finds it.

# %%
camera = pl.PlenopticCamera(
    lens=pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=5.0)),
    microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(1.85, 2.0, 2.3)),
    sensor=pl.Sensor(shape=SHAPE, pixel_pitch=0.010),
    stop_to_microlenses=123.3,
    microlenses_to_sensor=1.7,
)
shot = pl.render(pl.still_life(), camera, samples=SAMPLES, truth=pl.Truth.CHORD_DISPARITY)
white = pl.render_white(camera, samples=16)
disparity = shot.truth.chord_disparity

# %% [markdown]
# ## Views
#
# The second viewpoint lies 0.8 of the iris's semi-diameter to the right. Planes are in mm of the camera's frame.

# %%
views = {
    "sharp everywhere": pl.lightfield.render_view(shot, white, disparity),
    "from the right": pl.lightfield.render_view(shot, white, disparity, viewpoint=(0.8, 0.0)),
    "focused on the red ball": pl.lightfield.render_view(shot, white, z=-393.0),
    "focused behind the vase": pl.lightfield.render_view(shot, white, z=-425.0),
}
for name, view in views.items():
    seen, brightness = np.isfinite(view.disparity), np.nanmean(view.picture)
    print(f"{name}: {view}, error {100 * np.nanmedian(view.standard_error) / brightness:.2f} %, {seen.mean():.0%} seen")

# %% [markdown]
# ## Pictures
#
# A cut-out of the raw image, the views, and the disparity of what the first one shows.

# %%
bright = np.nanpercentile(views["sharp everywhere"].picture, 97)


def shown(picture):
    return pl.images.linear_to_srgb(np.clip(np.nan_to_num(picture) / bright, 0, 1))


raw = shot.image * (bright / np.percentile(shot.image, 99))
rows, columns = (slice(length // 2 - length // 8, length // 2 + length // 8) for length in SHAPE)
figure, axes = plt.subplots(2, 3, figsize=(10.5, 5.6), layout="constrained")
pictures = {"raw image, cut-out": raw[rows, columns], **{name: view.picture for name, view in views.items()}}
for ax, (name, picture) in zip(axes.flat, pictures.items(), strict=False):
    ax.imshow(shown(picture), interpolation="nearest")
    ax.set(title=name, xticks=[], yticks=[])
drawn = axes[1, 2].imshow(views["sharp everywhere"].disparity, cmap="viridis", interpolation="nearest")
axes[1, 2].set(title="disparity / pixel", xticks=[], yticks=[])
figure.colorbar(drawn, ax=axes[1, 2], shrink=0.7)
figure.savefig(output / "focused_views.png", dpi=100)
shot.save(output / "raw.exr")
print("written:", output / "raw.exr", output / "focused_views.png", sep="\n  ")
