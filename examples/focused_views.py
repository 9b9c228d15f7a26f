"""
Views and depth of a focused camera
===================================

The still life through a focused plenoptic camera with three types of microlenses. With the disparity of its pixels the
raw image is put together to pictures that are sharp everywhere, from the middle, the left and the right of the pupil;
refocused pictures do without. The disparity can be found in the raw image itself, and is compared with the truth.
"""

# %%
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
SHAPE = (96, 120) if SMALL else (660, 900)
SAMPLES = 8 if SMALL else 64

output = Path("output/focused_views")
output.mkdir(parents=True, exist_ok=True)

# %%
# Raw image
# ---------
#
# With the ground truth of disparity, which is pixels between neighbouring microlenses.

camera = pl.PlenopticCamera(
    lens=pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=5.0)),
    microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(1.85, 2.0, 2.3)),
    sensor=pl.Sensor(shape=SHAPE, pixel_pitch=0.010),
    stop_to_microlenses=123.3,
    microlenses_to_sensor=1.7,
)
shot = pl.render(pl.still_life(), camera, samples=SAMPLES, truth=pl.Truth.CHORD_DISPARITY, progress=False)
white = pl.render_white(camera, samples=16, progress=False)
print(f"raw image: relative error {100 * shot.relative_error:.2f} %, {shot.stats.seconds:.1f} s")

# %%
# Disparity
# ---------
#
# Neighbouring micro images are matched. Surfaces without texture, as the wall, have no disparity that could be
# found: where the confidence is low, it is left out.

disparity = shot.truth.chord_disparity
matched = pl.lightfield.depth(shot, white)
found = np.where(matched.confidence > 0.5, matched.disparity, np.nan)
off = np.abs(found / disparity - 1)[np.isfinite(found) & np.isfinite(disparity)]
print(f"disparity found in {off.size / found.size:.0%} of the pixels, in {(off < 0.03).mean():.0%} of them within 3 %")

# %%
# Views
# -----
#
# Viewpoints lie 0.8 of the iris's semi-diameter to either side. Planes are in mm of the camera's frame.

views = {
    "sharp everywhere": pl.lightfield.render_view(shot, white, disparity),
    "from the left": pl.lightfield.render_view(shot, white, disparity, viewpoint=(-0.8, 0.0)),
    "from the right": pl.lightfield.render_view(shot, white, disparity, viewpoint=(0.8, 0.0)),
    "refocused at 393 mm": pl.lightfield.render_view(shot, white, z=-393.0),
    "refocused at 425 mm": pl.lightfield.render_view(shot, white, z=-425.0),
}
for name, view in views.items():
    seen, brightness = np.isfinite(view.disparity), np.nanmean(view.picture)
    print(f"{name}: {view}, error {100 * np.nanmedian(view.standard_error) / brightness:.2f} %, {seen.mean():.0%} seen")

# %%
# Pictures
# --------
#
# A cut-out of the raw image and the views; the last two are the disparity of each pixel of the raw image, as it is and
# as it was found. White is where none is known.

brightest = np.nanpercentile(views["sharp everywhere"].picture, 99)


def for_the_screen(picture, top):
    image = pl.images.linear_to_srgb(np.clip(np.nan_to_num(picture) / top, 0, 1))
    return np.where(np.isfinite(picture), image, 1.0)


rows, columns = (slice(3 * length // 8, 5 * length // 8) for length in SHAPE)
cut = shot.image[rows, columns]
pictures = {f"raw image, {cut.shape[1]} x {cut.shape[0]} pixels of it": for_the_screen(cut, np.percentile(cut, 99.5))}
pictures |= {name: for_the_screen(view.picture, brightest) for name, view in views.items()}
figure, axes = plt.subplots(2, 4, figsize=(17, 6.8), layout="constrained")
for ax, (name, picture) in zip(axes[:, :3].flat, pictures.items(), strict=True):
    ax.imshow(picture, interpolation="nearest")
    ax.set(title=name, xticks=[], yticks=[])
low, high = np.nanpercentile(disparity, (1, 99))
for ax, (name, values) in zip(axes[:, 3], {"disparity": disparity, "disparity found": found}.items(), strict=True):
    drawn = ax.imshow(values, cmap="viridis", vmin=low, vmax=high, interpolation="nearest")
    ax.set(title=name, xticks=[], yticks=[])
figure.colorbar(drawn, ax=axes[:, 3], label="pixels between neighbouring microlenses", extend="both")
figure.savefig(output / "focused_views.png", dpi=100)
shot.save(output / "raw.exr")
print("written:", output / "raw.exr", output / "focused_views.png", sep="\n  ")
