"""
Three charts, one curve
=======================

``pl.targets`` makes calibration targets whose points are known exactly. A slanted edge, a Siemens star and the bars of
the USAF chart of 1951 measure the same thing: the contrast that a camera leaves at each frequency. They must agree
with each other, and with what pixels and lens are computed to do. Where a chart lies in the image needs no detection:
``camera.project`` traces its known points to the sensor.
"""

# %%
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
SIDE = 128 if SMALL else 256  # pixels
SAMPLES = 64 if SMALL else 256

output = Path("output/targets")
output.mkdir(parents=True, exist_ok=True)

# %%
# All targets
# -----------
#
# They are made in the plane z = 0, centred on the origin. Meshes and points move together.

wall = [
    pl.targets.checkerboard(9, 7, square=0.5, margin=0.25),
    pl.targets.siemens_star(2.0, 36, margin=0.1),
    pl.targets.usaf_1951([1, 2, 3, 4], scale=0.6),
    pl.targets.point_grid(9, 8, pitch=0.5, radius=0.15),
    pl.targets.slanted_edge(4.0),
    pl.targets.random_dots(45, 40, dot=0.1, seed=1),
]
wall = [target.translated(5.4 * (k % 3 - 1), 2.4 - 4.8 * (k // 3), -404.0) for k, target in enumerate(wall)]
print(*wall, sep="\n")


def conventional(rows, columns, pitch):
    """A camera without microlenses, focused on the targets."""
    return pl.PlenopticCamera(
        lens=pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=5.0)),
        sensor=pl.Sensor(shape=(rows, columns), pixel_pitch=pitch),
        stop_to_microlenses=134.6,
    ).focused_at(z=-404.0)


overview = conventional(2 * SIDE, 3 * SIDE, 1.7 / SIDE)
meshes = [mesh for target in wall for mesh in target.meshes]
photograph = pl.render(pl.Scene(meshes, background=1.0), overview, samples=max(8, SAMPLES // 4), progress=False)

# %%
# Three charts
# ------------
#
# Each is rendered by itself. Bright and dark parts shine, so that no lamp has to be evened out.

camera = conventional(SIDE, SIDE, 0.010 * 128 / SIDE)
DARK, BRIGHT = 0.1, 1.0
parts = {"dark": pl.Emissive(DARK), "bright": pl.Emissive(BRIGHT)}
SPOKES = 40
charts = {
    "edge": pl.targets.slanted_edge(6.0, **parts),
    "star": pl.targets.siemens_star(1.8, SPOKES, margin=1.0, **parts),
    "bars": pl.targets.usaf_1951([2, 3, 4], margin=1.0, **parts),
}
charts = {name: chart.translated(z=-404.0) for name, chart in charts.items()}
white = pl.render_white(camera, samples=SAMPLES, seed=1, progress=False)
radiance = {}
for name, chart in charts.items():
    shot = pl.render(pl.Scene(chart.meshes), camera, samples=SAMPLES, progress=False)
    shot.save(output / f"{name}.exr")
    radiance[name] = (shot.image / white.image)[:, :, 0]

# %%
# Points that are known on the star and, by projection, on the sensor give the map from pixels to the plane of the
# charts. So near the axis the lens hardly distorts, and a linear map is enough.

known = camera.project(charts["star"].points)
with_one = np.column_stack([known.pixel, np.ones(len(known))])
truth = known.points[known.point, :2]
to_chart, *_ = np.linalg.lstsq(with_one, truth, rcond=None)
pixel_in_mm = float(np.sqrt(abs(np.linalg.det(to_chart[:2]))))
left = np.abs(with_one @ to_chart - truth).max() / pixel_in_mm
rows, columns = np.indices((SIDE, SIDE))
place = np.stack([rows, columns, np.ones((SIDE, SIDE))], axis=-1) @ to_chart  # mm on the chart
print(f"a pixel sees {1000 * pixel_in_mm:.2f} um; the map is within {left:.4f} pixels of projected points")

# %%
# Contrast from the edge
# ----------------------
#
# As in ISO 12233: pixels are sorted by their distance from the edge into bins of 1/4 pixel, which draw it finer than
# pixels do, and the Fourier transform of its slope is the contrast. The mean over a bin and the difference of two
# bins are divided out, a sinc each.

BIN, REACH = 0.25, 24.0  # pixels
upper, lower = charts["edge"].points[:, :2]
normal = np.array([upper[1] - lower[1], lower[0] - upper[0]]) / np.linalg.norm(upper - lower)
number = np.floor(((place - lower) @ normal / pixel_in_mm + REACH) / BIN).astype(int)
bins = round(2 * REACH / BIN)
inside = (number >= 0) & (number < bins)
counts = np.bincount(number[inside], minlength=bins)
profile = np.bincount(number[inside], radiance["edge"][inside], minlength=bins) / counts
slope = np.diff(profile) * np.hanning(bins - 1)
offset = np.sum((np.arange(1, bins) * BIN - REACH) * slope) / slope.sum()
print(f"the edge lies {offset:+.4f} pixels beside the line between its projected ends")
edge_frequency = np.fft.rfftfreq(bins - 1, BIN)  # per pixel
edge = np.abs(np.fft.rfft(slope)) / slope.sum() / np.sinc(BIN * edge_frequency) ** 2

# %%
# Contrast from spokes and bars
# -----------------------------
#
# In a ring of the star, and across each set of three bars, the wave of the chart's own frequency is compared with that
# of the chart itself: wedges and bars as wide as their gaps have 2 / pi times the difference of bright and dark. A set
# of bars covers few pixels, which tell phase from amplitude below half a line per pixel only.

FULL = 2 / np.pi * (BRIGHT - DARK)


def swing(values, phase):
    """Amplitude of a wave of known phase, by least squares beside a constant."""
    waves = np.column_stack([np.ones(phase.size), np.cos(phase), np.sin(phase)])
    return float(np.hypot(*np.linalg.lstsq(waves, values, rcond=None)[0][1:]))


radius, angle = np.hypot(place[..., 0], place[..., 1]), np.arctan2(place[..., 1], place[..., 0])
star = []
for ring in np.geomspace(10 * pixel_in_mm, 1.7, 16):
    within = np.abs(radius - ring) < pixel_in_mm
    star.append((SPOKES / (2 * np.pi * ring), swing(radiance["star"][within], SPOKES * angle[within]) / FULL))
bars = []
for middle, frequency in zip(charts["bars"].points[:, :2], charts["bars"].frequencies, strict=True):
    w = 0.5 / frequency
    if frequency * pixel_in_mm > 0.45:
        continue
    for side, axis in ((-3.5, 0), (3.5, 1)):  # vertical bars, then horizontal ones
        from_middle = (place - middle) / w - [side, 0.0]
        across, along = from_middle[..., axis], from_middle[..., 1 - axis]
        within = (np.abs(across) < 2.0) & (np.abs(along) < 1.8)
        bars.append((frequency, swing(radiance["bars"][within], np.pi * across[within]) / FULL))
star, bars = np.array(star), np.array(bars)
bars = np.column_stack([bars[::2, 0], bars[::2, 1], bars[1::2, 1]])

# %%
# What optics says
# ----------------
#
# Pixels of width p leave sinc(f p) of a wave that runs along a row or column. What the lens leaves comes from traced
# rays, without diffraction, as in the rendering.

pitch = camera.sensor.pixel_pitch
frequency = np.linspace(0.02, 0.95, 200)  # per pixel
lens = pl.aberrations.mtf(camera.lens, frequency / pitch, z_object=-404.0, z_image=camera.stop_to_microlenses)
computed = np.sinc(frequency) * 0.5 * (lens.tangential + lens.sagittal)
print("lines / pixel   bars (vertical, horizontal)   edge    star   computed")
for of_chart, vertical, horizontal in bars:
    f = of_chart * pixel_in_mm
    found = [
        np.interp(f, edge_frequency, edge),
        np.interp(f, star[::-1, 0] * pixel_in_mm, star[::-1, 1]),
        np.interp(f, frequency, computed),
    ]
    print(f"{f:13.3f} {vertical:17.3f} {horizontal:10.3f}", *(f"{c:7.3f}" for c in found))

# %%
figure, axes = plt.subplots(2, 3, figsize=(15, 9.4), layout="constrained")
whole = axes[0, 0].get_gridspec()
for ax in axes[0]:
    ax.remove()
ax = figure.add_subplot(whole[0, :2])
ax.imshow(photograph.image[:, :, 0], cmap="gray", interpolation="nearest")
for target in wall:
    ax.plot(*overview.project(target.points[:: 1 + len(target.points) // 100]).pixel.T[::-1], ".r", markersize=2)
ax.set(title="targets, and points of them that are known", xticks=[], yticks=[])
ax = figure.add_subplot(whole[0, 2])
shown = edge_frequency < 1.0
ax.plot(frequency, computed, color="0.6", linewidth=5, label="pixel and lens, computed")
ax.plot(edge_frequency[shown], edge[shown], color="tab:blue", label="slanted edge")
ax.plot(star[:, 0] * pixel_in_mm, star[:, 1], "o", color="tab:orange", label="rings of the star")
ax.plot(bars[:, 0] * pixel_in_mm, bars[:, 1], "|", color="#009e73", markersize=10, label="vertical bars")
ax.plot(bars[:, 0] * pixel_in_mm, bars[:, 2], "_", color="#cc79a7", markersize=10, label="horizontal bars")
ax.set(xlabel="lines per pixel", ylabel="contrast", ylim=(0, 1.1), title="one curve")
ax.grid(alpha=0.3)
ax.legend()
for ax, (name, image) in zip(axes[1], radiance.items(), strict=True):
    ax.imshow(image, cmap="gray", vmin=0, vmax=1, interpolation="nearest")
    ax.plot(*camera.project(charts[name].points).pixel.T[::-1], ".r", markersize=2)
    ax.set(title=name, xlabel="column / pixel", ylabel="row / pixel", xlim=(-0.5, SIDE - 0.5), ylim=(SIDE - 0.5, -0.5))
figure.savefig(output / "targets.png", dpi=100)

# %%
print("written:", *(output / f"{name}.exr" for name in charts), output / "targets.png", sep="\n  ")
