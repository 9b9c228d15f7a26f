"""
Sub-aperture views of a plenoptic 1.0 camera
============================================

A cut-out of a raw image, and what it becomes when the pixels at the same place under every microlens are put
together: a picture through one part of the main lens's pupil, as in T. Michels et al., "Simulation of Plenoptic
Cameras" (2018). Views from different parts of the pupil see near and far things displaced against each other.
"""

# sphinx_gallery_thumbnail_number = 1

# %%
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
SAMPLES = 16 if SMALL else 64
EDGE_SAMPLES = 64 if SMALL else 128
PIXELS = 160 if SMALL else 1100  # along the sensor
DETAIL = 64 if SMALL else 200

output = Path("output/sub_aperture")
output.mkdir(parents=True, exist_ok=True)

# %%
# The camera
# ----------
#
# Microlenses of less than a third of that paper's size before finer pixels, so that views have more of them, on a
# square lattice. The still life's plane z = -404 is imaged onto the array.

camera = pl.PlenopticCamera(
    lens=pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=4.4)),
    microlenses=pl.MicrolensArray(pitch=0.0651, focal_lengths=(0.6,), lattice=pl.Lattice.SQUARE),
    sensor=pl.Sensor(shape=(PIXELS, PIXELS), pixel_pitch=0.006),
    stop_to_microlenses=123.3,
    microlenses_to_sensor=0.6,
).focused_at(z=-404.0)

# %%
shot = pl.render(pl.still_life(), camera, samples=SAMPLES, progress=False)
white = pl.render_white(camera, samples=16, seed=1, progress=False)
print(f"raw image: relative error {100 * shot.relative_error:.2f} %, {shot.stats.seconds:.1f} s")
written = [output / "raw.exr", output / "white.exr"]
for exposure, path in zip((shot, white), written, strict=True):
    exposure.save(path)
field = pl.lightfield.decode(shot, white, views=9)
print(field)

# %%
# Displacement between views
# --------------------------
#
# A half plane that shines on the left, in front of the plane in focus or behind it. From view to view its edge moves as
# the geometry of pupil and array says: near things to the left in views farther right. Its column is the number of
# bright pixels in a row.

rows = slice(PIXELS // 2 - 40, PIXELS // 2 + 40)
strip = np.s_[rows, 0:PIXELS]
band = pl.render_white(camera, samples=SAMPLES, seed=1, region=strip, progress=False)


def edge_places(z):
    """Offsets u of the views of the middle row, and the column of the edge in each."""
    corners = [[-60, -60, z], [0, -60, z], [0, 60, z], [-60, 60, z]]
    scene = pl.Scene([pl.Mesh(corners, [[0, 1, 2], [0, 2, 3]], pl.Emissive(1.0))])
    seen = pl.render(scene, camera, samples=EDGE_SAMPLES, region=strip, progress=False)
    views = pl.lightfield.decode(seen, band, views=7).views[:, 3, :, :, 0]
    columns = np.isfinite(views).all(axis=(0, 1))
    return field.u[1:-1], np.mean(np.sum(views[:, :, columns], axis=2), axis=1)


print("distance   pixels of a view by which the edge moves to the left per pixel of u: expected, rendered")
for z in (-370.0, -404.0, -440.0):
    found = -np.polyfit(*edge_places(z), 1)[0]
    print(f"{-z:5.0f} mm   {field.disparity_at(z)[0]:55.3f} {found:10.3f}")

# %%
# Raw image and view
# ------------------
#
# Above the cut-out of the raw image and the same part of the central view, below the whole view and what the outermost
# views of its row see differently. A pixel of the view stands for a microlens.

figure, axes = plt.subplots(2, 2, figsize=(10.4, 9.6), layout="constrained")
bright = np.percentile(field.centre, 99.5)
low = PIXELS // 2 - DETAIL // 4
detail = np.s_[low : low + DETAIL, low : low + DETAIL]


def shown(ax, image, top, extent=None):
    ax.imshow(
        pl.images.linear_to_srgb(np.clip(np.nan_to_num(image) / top, 0, 1)), extent=extent, interpolation="nearest"
    )


box = (low - 0.5, low + DETAIL - 0.5, low + DETAIL - 0.5, low - 0.5)
shown(axes[0, 0], shot.image[detail], np.percentile(shot.image, 99.8), box)
axes[0, 0].set(xlabel="column / pixel", ylabel="row / pixel", title="raw image, cut-out")

# Where pixels of the view lie on the raw image: each stands for a microlens, and these lie around the axis.
middle = (PIXELS - 1) / 2
step = camera.report().image_pitch_pixels
height, width = field.centre.shape[:2]
whole = (middle - width / 2 * step, middle + width / 2 * step, middle + height / 2 * step, middle - height / 2 * step)
for ax, title in ((axes[0, 1], "central view, cut-out"), (axes[1, 0], "central view")):
    shown(ax, field.centre, bright, whole)
    ax.set(xlabel="column of the raw image / pixel", ylabel="row of the raw image / pixel", title=title)
axes[0, 1].set(xlim=box[:2], ylim=box[2:])
axes[1, 0].add_patch(plt.Rectangle((box[0], box[3]), DETAIL, DETAIL, fill=False, edgecolor="lime"))
change = (field.view(3, 0) - field.view(-3, 0)).mean(axis=2) / bright
drawn = axes[1, 1].imshow(change, cmap="RdBu", vmin=-0.5, vmax=0.5, extent=whole, interpolation="nearest")
axes[1, 1].set(xlabel="column of the raw image / pixel", title="view from the right minus view from the left")
figure.colorbar(drawn, ax=axes[1, 1], label="over the brightest", shrink=0.7)
written.append(output / "sub_aperture.png")
figure.savefig(written[-1], dpi=100)

# %%
# Every second view. Those in the corners lie at the rim of the pupil, where many microlenses get too little light.

ax = pl.plots.plot_views(field, every=2, ax=plt.subplots(figsize=(9.6, 9.6), layout="constrained")[1])
ax.set_title("views through the pupil")
written.append(output / "views.png")
ax.figure.savefig(written[-1], dpi=100)

# %%
print("written:", *written, sep="\n  ")
