"""
A large sensor
==============

A camera of 29 megapixels with three kinds of microlenses. Nobody wants to learn after a night that it would have taken
a week: what a full frame costs in time and memory is worked out from small pilot regions, with an error, and tested on
a larger region. Then how to render for as long as there is time, go on later to the same bits, and work in strips.
"""

# %%
import dataclasses
import os
import tracemalloc
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
GRID = (2, 3) if SMALL else (3, 5)  # pilot regions, down and across
PILOT = 32 if SMALL else 64  # pixels along each
SAMPLES = (8, 16) if SMALL else (16, 32, 64, 128)
TEST = (96, 128) if SMALL else (320, 448)  # pixels of the larger region
TARGET = 0.1 if SMALL else 0.05  # relative error

output = Path("output/large_sensor")
output.mkdir(parents=True, exist_ok=True)

# %%
# The camera
# ----------
#
# 6576 x 4384 pixels of 5.5 um, 36 mm x 24 mm, and microlenses of 23 pixels whose three types see virtual depths of 3.5,
# 5 and 8 sharply. The scene is the still life, ten times as large, which fills the sensor from 600 mm away.

PIXEL = 0.0055
camera = pl.design_camera(
    pl.load_lens("double-gauss-100mm-f2"),
    sensor=pl.Sensor((4384, 6576), PIXEL),
    kind=pl.CameraKind.GALILEAN,
    z=-600.0,
    pitch=23 * PIXEL,
    focal_length=0.95,
    virtual_depth=5.0,
    image_fill=0.8,
).camera
b = camera.microlenses_to_sensor
types = tuple(b / (1 - 1 / v) for v in (3.5, 5.0, 8.0))
camera = dataclasses.replace(camera, microlenses=dataclasses.replace(camera.microlenses, focal_lengths=types))
report = camera.report()
rows, columns = camera.sensor.shape
pixels = rows * columns
print(f"{pixels / 1e6:.1f} megapixels, {report.microlenses} microlenses; the corner sees "
      f"{100 * report.corner_pupil_fraction:.0f} % of the iris")  # fmt: skip

SIZE = 10.0
grown = np.diag([SIZE, SIZE, SIZE, 1.0])
grown[:3, 3] = (0.0, 14.0, -600.0 + 404.0 * SIZE)
scene = pl.still_life().transformed(grown)
overview_camera = pl.PlenopticCamera(
    lens=camera.lens,
    sensor=pl.Sensor((rows // 32, columns // 32), 32 * PIXEL),
    stop_to_microlenses=pl.paraxial.image_position(camera.lens, -600.0),
)
overview = pl.render(scene, overview_camera, samples=8 if SMALL else 64, progress=False)

# %%
# Pilot regions
# -------------
#
# Costs differ over the sensor: glass and mirrors take longer paths than the wall, and dark parts more samples for the
# same relative error. So the pilot is not one region but many small ones, one at a random place in each
# field of a grid. Their mean times the number of pixels is the full frame's, and their scatter gives the error of that.

random = np.random.default_rng(5)
corners = [
    (
        int((k + random.uniform(0.1, 0.8)) * rows / GRID[0]) // 8 * 8,
        int((m + random.uniform(0.1, 0.8)) * columns / GRID[1]) // 8 * 8,
    )
    for k in range(GRID[0])
    for m in range(GRID[1])
]
regions = [np.s_[row : row + PILOT, column : column + PILOT] for row, column in corners]
pl.render(scene, camera, samples=2, region=regions[0], progress=False)  # compiles, if this is the first time
cost, variance = np.empty((2, len(SAMPLES), len(regions)))
for n, samples in enumerate(SAMPLES):
    for k, region in enumerate(regions):
        shot = pl.render(scene, camera, samples=samples, region=region, progress=False)
        cost[n, k], variance[n, k] = shot.stats.cpu_seconds / PILOT**2, shot.relative_error**2
mean, spread = cost.mean(axis=1), cost.std(axis=1, ddof=1) / np.sqrt(len(regions))
error = np.sqrt(variance.mean(axis=1))
print("samples   CPU us a pixel   error %   full frame: CPU hours")
for samples, m, s, e in zip(SAMPLES, mean, spread, error, strict=True):
    print(
        f"{samples:7d} {1e6 * m:8.1f} +- {1e6 * s:4.1f} {100 * e:9.1f} {m * pixels / 3600:12.2f} "
        f"+- {s * pixels / 3600:.2f}"
    )

figure, axes = plt.subplots(1, 2, figsize=(12.4, 4.2), layout="constrained", width_ratios=(1.45, 1))
bright = np.percentile(overview.image, 99.5)
axes[0].imshow(pl.images.linear_to_srgb(np.clip(overview.image / bright, 0, 1)), extent=(0, columns, rows, 0))
places = np.array(corners) + PILOT / 2
marks = axes[0].scatter(*places.T[::-1], c=1e6 * cost[-1], cmap="plasma", s=70, edgecolor="white", marker="s")
figure.colorbar(marks, ax=axes[0], label=f"CPU us a pixel, {SAMPLES[-1]} samples", shrink=0.85)
axes[0].set(
    title="Pilot regions on the full frame (drawn larger than they are)", xlabel="column / pixel", ylabel="row / pixel"
)
axes[1].errorbar(1e6 * mean, 100 * error, xerr=1e6 * spread, fmt="o-", capsize=3)
for samples, m, e in zip(SAMPLES, mean, error, strict=True):
    axes[1].annotate(f" {samples} samples", (1e6 * m, 100 * e), va="bottom", fontsize=9)
axes[1].set(
    xscale="log", yscale="log", xlabel="CPU us a pixel", ylabel="relative error / %", title="Error against time"
)
for axis in (axes[1].xaxis, axes[1].yaxis):
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter("{x:g}")
axes[1].grid(alpha=0.3, which="both")
figure.savefig(output / "pilot.png", dpi=120)

# %%
# Is the prediction right?
# ------------------------
#
# A larger region, rendered to a target error, and beforehand four small ones inside it. ``target_error`` works tile by
# tile, so that a region ends as the full frame would, with few samples where it is bright and many where it is not.

test = np.s_[1904 : 1904 + TEST[0], 3400 : 3400 + TEST[1]]
inside = [
    np.s_[test[0].start + k * TEST[0] // 2 :, test[1].start + m * TEST[1] // 2 :] for k in range(2) for m in range(2)
]
inside = [np.s_[r.start + 16 : r.start + 16 + PILOT, c.start + 16 : c.start + 16 + PILOT] for r, c in inside]
wanted = {"target_error": TARGET, "samples": 1024, "progress": False}
trial = [pl.render(scene, camera, region=region, **wanted) for region in inside]
each = np.array([one.stats.cpu_seconds for one in trial]) / PILOT**2 * TEST[0] * TEST[1]
shot = pl.render(scene, camera, region=test, **wanted)
print(f"{TEST[0] * TEST[1] / 1e6:.2f} megapixels to {100 * TARGET:.0f} %: expected {each.mean():.1f} +- "
      f"{each.std(ddof=1) / 2:.1f} CPU s, took {shot.stats.cpu_seconds:.1f}; error "
      f"{100 * shot.relative_error:.1f} %")  # fmt: skip

figure, axes = plt.subplots(1, 3, figsize=(13, 3.8), layout="constrained")
extent = (test[1].start - 0.5, test[1].stop - 0.5, test[0].stop - 0.5, test[0].start - 0.5)
top = np.percentile(shot.image, 99.5)
axes[0].imshow(pl.images.linear_to_srgb(np.clip(shot.image / top, 0, 1)), extent=extent, interpolation="nearest")
axes[0].set_title("raw image of the region")
depth = axes[1].imshow(np.ma.masked_invalid(shot.depth), extent=extent, interpolation="nearest", cmap="viridis")
axes[1].set_title("depth")
figure.colorbar(depth, ax=axes[1], label="mm", shrink=0.85)
number = shot.sample_counts if shot.sample_counts is not None else np.full(TEST, shot.samples)
drawn = axes[2].imshow(number, extent=extent, interpolation="nearest", cmap="magma")
axes[2].set_title(f"samples of each pixel for {100 * TARGET:.0f} %")
figure.colorbar(drawn, ax=axes[2], label="samples", shrink=0.85)
for ax in axes:
    ax.set(xlabel="column / pixel", ylabel="row / pixel")
figure.savefig(output / "region.png", dpi=120)

# %%
# Memory
# ------
#
# What is kept while rendering grows with the pixels, and not with the samples. Beside it every processor has
# its tile in work: two sizes tell the one from the other. What the ground truth adds can be read off its arrays.


def peak(side):
    """Most bytes of arrays while a square is rendered."""
    square = np.s_[1904 : 1904 + side, 2704 : 2704 + side]
    tracemalloc.start()
    pl.render(scene, camera, samples=2, region=square, progress=False)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return most


sides = (256, 512) if SMALL else (512, 1024)
small, large = (peak(side) for side in sides)
of_pixel = (large - small) / (sides[1] ** 2 - sides[0] ** 2)
fixed = small - of_pixel * sides[0] ** 2
print(
    f"{of_pixel:.0f} bytes a pixel and {fixed / 2**20:.0f} MiB: "
    f"{(of_pixel * pixels + fixed) / 2**30:.1f} GiB for the full frame"
)
channels = pl.Truth.DEPTH | pl.Truth.NORMAL | pl.Truth.OBJECT | pl.Truth.VIRTUAL_DEPTH
truth = pl.ground_truth(scene, camera, truth=channels, region=regions[0], progress=False)
for name, array in truth.arrays().items():
    print(f"  of these, or added where asked for: {name:14s} {array.nbytes / PILOT**2:3.0f} bytes a pixel")

# %%
# What the full frame would cost
# ------------------------------
#
# Between and beyond the pilot's numbers of samples the variance is taken as a power of the time. Sixteen processors
# are assumed to be sixteen times as fast as one, as tiles allow.

power, base = np.polyfit(np.log(error), np.log(mean), 1)
print(f"CPU time grows as error to the power {power:.2f} (independent samples: -2)")
print("error %   CPU hours   on 2 processors   on 16")
for goal in (0.2, 0.1, 0.05, 0.02):
    hours = np.exp(base) * goal**power * pixels / 3600
    relative = spread[-1] / mean[-1]
    print(f"{100 * goal:7.0f} {hours:8.2f} +- {relative * hours:.2f} {hours / 2:10.2f} h {hours / 16:11.3f} h")

# %%
# As long as there is time, and on from there
# -------------------------------------------
#
# With ``checkpoint`` a render keeps its state in a file. Here it gets slices of a second and goes on in the next
# call, as after a night or a power cut, until it has its samples. In the end it has the bits of a render without a
# break.

state = output / "state.part"
state.unlink(missing_ok=True)
square = np.s_[2000 : 2000 + TEST[0] // 2, 2800 : 2800 + TEST[1] // 2]
enough, seconds = (32, 0.8) if SMALL else (256, 1.0)
history = []
while not history or (history[-1].stats.stopped_by is pl.rendering.StopReason.TIME_LIMIT and len(history) < 60):
    history.append(
        pl.render(scene, camera, samples=enough, time_limit=seconds, region=square, checkpoint=state, progress=False)
    )
    part = history[-1]
    mean_samples = part.samples if part.sample_counts is None else part.sample_counts.mean()
    print(
        f"call {len(history)}: {mean_samples:6.1f} samples, error {100 * part.relative_error:5.1f} %, "
        f"{part.stats.stopped_by.name}"
    )
at_once = pl.render(scene, camera, samples=enough, region=square, progress=False)
print("the same bits as at once:", np.array_equal(part.image, at_once.image))
state.unlink()

# %%
# In strips
# ---------
#
# A region has the bits that it has in the full frame. A frame too large for the memory is therefore rendered strip by
# strip, on one machine or on many, and joined: nothing shows where. Strips of whole blocks of 8 pixels cost no more.

halves = [np.s_[2000 : 2000 + TEST[0] // 4, square[1]], np.s_[2000 + TEST[0] // 4 : square[0].stop, square[1]]]
strips = [pl.render(scene, camera, samples=enough, region=half, progress=False) for half in halves]
joined = np.concatenate([strip.image for strip in strips])
print("two strips are the whole, bit by bit:", np.array_equal(joined, at_once.image))
for k, strip in enumerate(strips):
    strip.save(output / f"strip_{k}.exr")
size_on_disk = sum((output / f"strip_{k}.exr").stat().st_size for k in range(2)) / joined[..., 0].size
print(f"{size_on_disk:.1f} bytes a pixel in EXR files: {size_on_disk * pixels / 1e9:.1f} GB for the full frame")
print("written:", *sorted(path for path in output.iterdir()), sep="\n  ")
