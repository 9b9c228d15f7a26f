"""
Three kinds of microlenses
==========================

Focused plenoptic cameras extend their depth of field by microlenses of several focal lengths side by side (C.
Perwass and L. Wietzke, "Single lens 3D-camera with extended depth-of-field", Proc. SPIE 8291, 2012,
doi:10.1117/12.909882): on a hexagonal lattice three types can alternate so that no two neighbours are equal. Here
each type looks at another plane, and the contrast of gratings shows which.
"""

# %%
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
SAMPLES = 16 if SMALL else 256
PLANES = (-345.0, -404.0, -470.0)  # what the three types look at, mm
Z = np.linspace(-330, -490, 3 if SMALL else 17)

output = Path("output/multi_focus")
output.mkdir(parents=True, exist_ok=True)

# %%
# The camera
# ----------
#
# With the main lens's image of a plane a distance a behind the array and the sensor at b, a microlens sees it sharply
# if 1 / f = 1 / b - 1 / a. What the camera then sees it reports itself.

lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=5.0))
ARRAY, B = 123.3, 1.7


def behind(z):
    """Distance of the main lens's image of the plane z behind the array."""
    return pl.paraxial.image_position(lens, z) - ARRAY


camera = pl.PlenopticCamera(
    lens=lens,
    microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=tuple(1 / (1 / B - 1 / behind(z)) for z in PLANES)),
    sensor=pl.Sensor(shape=(512, 512), pixel_pitch=0.010),
    stop_to_microlenses=ARRAY,
    microlenses_to_sensor=B,
)
report = camera.report()
print(report)

# %%
# What they see
# -------------
#
# A checkerboard in each of the three planes, with squares of three pixels. In each picture the microlenses of one
# type are sharp.

crop = np.s_[256 - 36 : 256 + 36, 256 - 36 : 256 + 36]
white = pl.render_white(camera, samples=SAMPLES, region=crop, progress=False)
written, shots = [], {}


def scale_at(z):
    """mm on the sensor per mm in the plane z."""
    return abs(pl.paraxial.magnification(lens, z)) * B / behind(z)


for z in PLANES:
    square = 3 * camera.sensor.pixel_pitch / scale_at(z)
    meshes = pl.checkerboard((40, 40), square, even=pl.Emissive(1.0), odd=pl.Lambertian(0.0), offset=(0.2, 0.1))
    shots[z] = pl.render(
        pl.Scene([mesh.translated(z=z) for mesh in meshes]), camera, samples=SAMPLES, region=crop, progress=False
    )
    written.append(output / f"plane_{-z:.0f}.exr")
    shots[z].save(written[-1])

# %%
# Contrast
# --------
#
# Gratings of 0.2 cycles per pixel, in planes from near to far. In the images of one microlens of each type next to
# the axis, the wave of that frequency is fitted to radiance, which is raw over white image. Expected is 4 / pi, for
# bars, times the transform of the pixel and of the opening of the microlens, which the light of a point fills on the
# sensor at the size 1 - b / a - b / f.

CYCLES, LEAN = 0.2, np.radians(15.0)
wave = CYCLES * np.array([np.cos(LEAN), -np.sin(LEAN)])
centres = pl.microlens_centres(camera)
chosen = {index: np.flatnonzero((centres.index == index).all(axis=1))[0] for index in ((0, 0), (1, 0), (0, 1))}
corners = camera.microlenses.opening.corners


def grating(z, half_size=14.0):
    """Leaning bars, half as wide as their distance."""
    period = camera.sensor.pixel_pitch / CYCLES / scale_at(z)
    n = int(half_size / period)
    bars = [
        pl.quad((x, -half_size, z), (0.5 * period, 0, 0), (0, 2 * half_size, 0), material=pl.Emissive(1.0))
        for x in period * np.arange(-n, n + 1)
    ]
    return pl.Scene([bar.rotated_deg((0, 0, 1), np.degrees(LEAN)) for bar in bars])


def contrast(radiance, centre):
    """Amplitude of the wave over the mean within a micro image."""
    first = np.rint(centre).astype(int) - 6
    part = radiance[first[0] - crop[0].start :, first[1] - crop[1].start :][:12, :12]
    row, column = np.mgrid[0:12, 0:12]
    phase = 2 * np.pi * (wave[0] * column + wave[1] * row).ravel()
    waves = [function(k * phase) for k in (1, 3) for function in (np.cos, np.sin)]
    fit = np.linalg.lstsq(np.stack([np.ones_like(phase), *waves], axis=1), part.ravel(), rcond=None)[0]
    return np.hypot(fit[1], fit[2]) / fit[0]


def expected(z, f):
    """4 / pi times the transforms of the opening, blurred by defocus, and of the pixel."""
    place = np.linspace(-1, 1, 301) * np.abs(corners).max()
    x, y = np.meshgrid(place, place)
    ahead = np.roll(corners, -1, axis=0) - corners
    inside = np.all([u * (y - c[1]) - v * (x - c[0]) >= 0 for c, (u, v) in zip(corners, ahead, strict=True)], axis=0)
    cycles = wave / camera.sensor.pixel_pitch * (1 - B / behind(z) - B / f)
    opening = np.cos(2 * np.pi * (cycles[0] * x + cycles[1] * y))[inside].mean()
    return 4 / np.pi * abs(opening * np.sinc(wave[0]) * np.sinc(wave[1]))


found = np.empty((len(Z), 3))
types = [int(centres.type[k]) for k in chosen.values()]
print("    z / mm " + "".join(f"   type {t}: expected, rendered" for t in range(3)))
for n, z in enumerate(Z):
    shot = pl.render(grating(z), camera, samples=2 * SAMPLES, region=crop, progress=False)
    with np.errstate(invalid="ignore", divide="ignore"):
        radiance = shot.image[:, :, 0] / white.image[:, :, 0]
    for kind, k in zip(types, chosen.values(), strict=True):
        found[n, kind] = contrast(radiance, centres.pixel[k])
    theory = [expected(z, f) for f in camera.microlenses.focal_lengths]
    print(f"{z:10.1f} " + "".join(f"{t:18.3f}, {m:8.3f}" for t, m in zip(theory, found[n], strict=True)))

# %%
figure = plt.figure(figsize=(11, 8), layout="constrained")
top, bottom = figure.subfigures(2, 1, height_ratios=(1, 0.95))
extent = (crop[1].start - 0.5, crop[1].stop - 0.5, crop[0].stop - 0.5, crop[0].start - 0.5)
colours = ("#0072b2", "#e69f00", "#009e73")  # which the colour-blind can tell apart
for ax, z in zip(top.subplots(1, 3, sharey=True), PLANES, strict=True):
    ax.imshow(shots[z].image[:, :, 0], cmap="gray", extent=extent, interpolation="nearest")
    for kind, (row, column) in zip(centres.type, centres.pixel, strict=True):
        label = {"facecolor": "white", "edgecolor": "none", "pad": 1.0}
        ax.text(column, row, kind, color=colours[kind], ha="center", va="center", bbox=label, clip_on=True)
    ax.set(xlabel="column / pixel", title=f"checkerboard at z = {z:g} mm", xlim=extent[:2], ylim=extent[2:])
top.axes[0].set_ylabel("row / pixel")
ax = bottom.subplots()
fine = np.linspace(Z.max(), Z.min(), 9 if SMALL else 81)
for kind, (f, focus) in enumerate(zip(camera.microlenses.focal_lengths, report.focus, strict=True)):
    ax.plot(-fine, [expected(z, f) for z in fine], color=colours[kind], label=f"type {kind}, f = {f:.3f} mm: theory")
    ax.plot(-Z, found[:, kind], "o", color=colours[kind], label="rendered")
    ax.axvline(-focus.z, color=colours[kind], linewidth=0.8, linestyle="--")
ax.set(xlabel="distance of the plane / mm; dashed: in focus", ylabel="contrast of the wave", ylim=(0, 4 / np.pi))
ax.set_title(f"gratings of {CYCLES:g} cycles per pixel")
ax.legend(ncols=3, loc="lower center")
path = output / "multi_focus.png"
figure.savefig(path, dpi=100)
written.append(path)

# %%
print("written:", *written, sep="\n  ")
