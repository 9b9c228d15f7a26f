"""
Designing a camera
==================

From wishes to a camera: a focused plenoptic camera for objects of 30 mm, half a metre away. How large the images of
the microlenses become, in which depths it is sharp, what a second and a third focal length buy, and whether renderings
agree with the formulas.
"""

# %%
import dataclasses
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
SAMPLES = 16 if SMALL else 256
PLANES = np.linspace(-450, -515, 3 if SMALL else 14)

output = Path("output/camera_design")
output.mkdir(parents=True, exist_ok=True)

# %%
# Wishes
# ------
#
# Given are the main lens, the sensor and the array: lenses of 0.12 mm, twenty pixels, with a focal length of 0.9 mm.
# Wished for are a plane in focus, a virtual depth of 4 there, and images of the microlenses that nearly fill their
# cells. The first camera meets the wishes, and its report warns: the images are not in focus on the sensor and fade out
# over a border of 5 pixels, so that a third of the pixels get light through several microlenses.

lens = pl.load_lens("double-gauss-100mm-f2")
sensor = pl.Sensor((400, 600), 0.006)


def designed(fill):
    """The camera whose micro images fill so much of their distance."""
    return pl.design_camera(
        lens,
        sensor=sensor,
        kind=pl.CameraKind.GALILEAN,
        z=-500.0,
        pitch=0.12,
        focal_length=0.9,
        virtual_depth=4.0,
        image_fill=fill,
    )


design = designed(0.95)
print(design)
print(*(finding.message for finding in design.camera.report().warnings), sep="\n")

# %%
# Images that do not overlap
# --------------------------
#
# The iris is the remedy, and light is its price. For each fill the report says how much of the sensor is lit twice and
# how much not at all; white images say the same by counting pixels. The f-numbers of main lens and microlenses match
# where images touch.

fills = (0.6, 0.8, 0.95) if SMALL else (0.55, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95)
crop = np.s_[200 - 60 : 200 + 60, 300 - 60 : 300 + 60]
rows, whites = [], {}
print("image fill   f-number match   working f-number   lit twice %   dark % by report, in a white image   light %")
for fill in fills:
    camera = designed(fill).camera
    report = camera.report()
    white = pl.render_white(camera, samples=SAMPLES, region=crop, progress=False)
    dark = 100 * float((white.image < 0.02 * np.percentile(white.image, 99)).mean())
    twice, gaps = 100 * report.overlap_fraction, 100 * report.dark_fraction
    rows.append((fill, twice, gaps, dark, white.image.mean(dtype=float)))
    whites[fill] = white.image[:, :, 0]
    print(f"{fill:10.2f} {report.f_number_match:16.3f} {report.working_f_number:18.2f} {twice:13.1f} {gaps:18.1f} "
          f"{dark:18.1f} {100 * rows[-1][-1] / rows[0][-1]:16.0f}")  # fmt: skip
fill, twice, gaps, dark, light = np.array(rows).T

figure, axes = plt.subplots(1, 3, figsize=(12.6, 3.9), layout="constrained")
axes[0].plot(fill, twice, "o-", label="lit by several, by the report")
axes[0].plot(fill, gaps, "s-", label="dark, by the report")
axes[0].plot(fill, dark, "x", color="black", label="dark, in white images")
axes[0].set(xlabel="image fill", ylabel="part of the sensor / %", title="Overlap and gaps")
axes[0].legend(fontsize=9)
axes[0].grid(alpha=0.3)
for ax, chosen in zip(axes[1:], (fills[1], fills[-1]), strict=True):
    shown = ax.imshow(whites[chosen], cmap="gray", vmin=0, extent=(240 - 0.5, 360 - 0.5, 260 - 0.5, 140 - 0.5))
    ax.set(title=f"white image, fill {chosen:g}", xlabel="column / pixel", ylabel="row / pixel")
    figure.colorbar(shown, ax=ax, label="white image / sr", shrink=0.85)
figure.savefig(output / "image_fill.png", dpi=120)

# %%
# The camera and its report
# -------------------------
#
# A fill of 0.75 it is. The report is the data sheet: what follows from it for depth is at its end.

camera = designed(0.75).camera
report = camera.report()
print(report)
figure = pl.plots.plot_camera(camera)
figure.savefig(output / "camera.png", dpi=120)

# %%
# Which depths, and how well
# --------------------------
#
# The main lens images a plane at the distance a behind the array, a / b is its virtual depth v, and from one microlens
# to the next its image moves by pitch / (v pixel) pixels. An algorithm that finds disparities to 0.1 pixels then tells
# depth to 0.1 over the slope of this curve. A point out of focus becomes a spot with the diameter of the
# opening times 1 - b/f - b/a. Where it is below a pixel, the report says "depth of field". Types of several focal
# lengths each have a band of their own; here in focus at virtual depths of 4, 5.6 and 9.


def virtual_depth(z):
    """By Gaussian optics."""
    return (pl.paraxial.image_position(lens, z) - camera.stop_to_microlenses) / camera.microlenses_to_sensor


b, pixel = camera.microlenses_to_sensor, sensor.pixel_pitch
types = tuple(b / (1 - 1 / v) for v in (4.0, 5.6, 9.0))
depths = np.linspace(440, 535, 300)
v = np.array([virtual_depth(-d) for d in depths])
disparity = camera.microlenses.pitch / (v * pixel)
opening = camera.microlenses.pitch / pixel
blur = {f: opening * np.abs(1 - b / f - 1 / v) for f in types}
resolution = 0.1 / np.abs(np.gradient(disparity, depths))

figure, axes = plt.subplots(1, 3, figsize=(12.6, 3.9), layout="constrained")
axes[0].plot(depths, disparity)
axes[0].set(ylabel="pixels from microlens to microlens", title="Disparity")
axes[1].plot(depths, resolution)
axes[1].set(ylabel="mm", title="Depth that 0.1 pixels of disparity stand for", ylim=(0, None))
for number, (f, line) in enumerate(blur.items()):
    axes[2].plot(depths, line, label=f"type {number}, f = {f:.3f} mm")
axes[2].axhline(1, color="0.5", linestyle=":", label="one pixel")
axes[2].set(ylabel="pixels", title="Blur of a point in a micro image", ylim=(0, None))
axes[2].legend(fontsize=9)
for ax in axes:
    ax.set_xlabel("depth / mm")
    ax.grid(alpha=0.3)
figure.savefig(output / "depth.png", dpi=120)

multi = dataclasses.replace(camera, microlenses=dataclasses.replace(camera.microlenses, focal_lengths=types))
for title, one in {"one type": camera, "three types": multi}.items():
    sharp = np.min([blur[f] for f in one.microlenses.focal_lengths], axis=0) < 1
    print(f"{title}: sharp to one pixel in at least one type over {sharp.mean() * np.ptp(depths):.0f} mm of depth")
    print(
        *(f"  type {k}: {-focus.z_near:.0f} to {-focus.z_far:.0f} mm" for k, focus in enumerate(one.report().focus)),
        sep="\n",
    )

# %%
# Does it do what the formulas say?
# ---------------------------------
#
# A Siemens star at three depths: each type is sharp in its own.

star = pl.targets.siemens_star(9.0, 48, margin=1.0, dark=pl.Emissive(0.05), bright=pl.Emissive(1.0))
focused = [focus.z_traced for focus in multi.report().focus]
region = np.s_[200 - 50 : 200 + 50, 300 - 50 : 300 + 50]
centres = pl.microlens_centres(multi)
figure, axes = plt.subplots(1, 3, figsize=(12.6, 4.5), sharex=True, sharey=True, layout="constrained")
for ax, z in zip(axes, focused, strict=True):
    shot = pl.render(
        pl.Scene(star.translated(x=3.0, z=z).meshes), multi, samples=SAMPLES, region=region, progress=False
    )
    ax.imshow(shot.image[:, :, 0], cmap="gray", extent=(250 - 0.5, 350 - 0.5, 250 - 0.5, 150 - 0.5))
    ax.set(title=f"star {-z:.1f} mm away", xlabel="column / pixel", xlim=(249.5, 349.5), ylim=(249.5, 149.5))
    for kind, (row, column) in zip(centres.type, centres.pixel, strict=True):
        ax.text(column, row - 7, kind, color=f"C{kind}", ha="center", va="center", clip_on=True, weight="bold")
axes[0].set_ylabel("row / pixel")
figure.suptitle("Raw images; the number of a microlens is its type")
figure.savefig(output / "stars.png", dpi=120)

# %%
# Blur by rays
# ------------
#
# ``pl.point_spread`` traces a point of the scene forwards to the sensor. Its spot in the image of a microlens on the
# axis has a variance that the formula gives, too: a hexagon of the width w between its sides has 5 w^2 / 72 along each
# direction. That microlens looks through the middle of the pupil, so that Gaussian optics should do; others have the
# aberrations of the main lens besides. The spots are looked at with pixels an eighth as large.

HEXAGON = 5 / 72
found = np.empty((3, len(PLANES)))
for kind, f in enumerate(types):
    array = dataclasses.replace(camera.microlenses, focal_lengths=(f,))
    one = dataclasses.replace(camera, microlenses=array, sensor=pl.Sensor((144, 144), pixel / 8))
    spreads = pl.point_spread(one, np.outer(PLANES, (0, 0, 1)), rays=2**12 if SMALL else 2**17, progress=False)
    for n in range(len(PLANES)):
        part = spreads.of(n).whole()  # 18 x 18 pixels around the axis: no light of the neighbours
        place = (np.arange(144) - 71.5) / 8
        found[kind, n] = 0.5 * (part * (place**2 + place[:, np.newaxis] ** 2)).sum() / part.sum()

figure, ax = plt.subplots(figsize=(7.2, 4.2), layout="constrained")
for kind, f in enumerate(types):
    ax.plot(depths, np.sqrt(HEXAGON) * blur[f], color=f"C{kind}", label=f"type {kind}, formula")
    ax.plot(-PLANES, np.sqrt(found[kind]), "o", color=f"C{kind}", label="rays")
    off = np.sqrt(found[kind]) - np.sqrt(HEXAGON) * np.interp(-PLANES, depths, blur[f])
    print(f"type {kind}: standard deviation by rays minus that by the formula, at most {np.abs(off).max():.3f} pixels")
ax.set(xlabel="depth of the point / mm", ylabel="standard deviation of its spot / pixel", ylim=(0, None))
ax.set_title("Spots in micro images, by formula and by rays")
ax.legend(ncols=3, fontsize=9)
ax.grid(alpha=0.3)
figure.savefig(output / "spots.png", dpi=120)
print("written:", *sorted(path for path in output.iterdir()), sep="\n  ")
