"""
Fine structure in both modes
============================

What the figure of T. Michels et al., "Simulation of Plenoptic Cameras" (2018) shows on a scene, here on a star whose
spokes get finer towards its middle, and in numbers: the contrast of gratings within a micro image.

With the main lens's image a distance a behind the array, the light of a point that a microlens of focal length f
takes up is spread, on a sensor at b, over a picture of the microlens's opening that is smaller by

    1 - b / a - b / f

which is 0 in the focused camera (2.0) and b / a with b = f (1.0). Contrast is then the Fourier transform of the
opening, at that size, times that of the pixel.
"""

# %%
import dataclasses
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
SAMPLES = 8 if SMALL else 512
SIDE = 48 if SMALL else 256  # pixels along the rendered middle of the sensor
FREQUENCIES = np.linspace(0.4, 2.1, 3 if SMALL else 13)  # line pairs per mm in the scene
Z = -404.0

output = Path("output/fine_structure")
output.mkdir(parents=True, exist_ok=True)

# %%
lens = pl.load_lens("double-gauss-100mm-f2")
focused = pl.PlenopticCamera(
    lens=lens.with_stop(pl.CircularStop(semi_diameter=5.0)),
    microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,), lattice=pl.Lattice.HEXAGONAL),
    sensor=pl.Sensor(shape=(512, 512), pixel_pitch=0.010),
    stop_to_microlenses=123.3,
    microlenses_to_sensor=1.7,
)
afocal = dataclasses.replace(
    focused, lens=lens.with_stop(pl.CircularStop(semi_diameter=4.25)), microlenses_to_sensor=2.0
)
cameras = {"2.0": focused, "1.0": afocal}

# %%
# Two kinds of scene
# ------------------
#
# A star of 18 shining spokes of 7 mm, and gratings of bars. Both are geometry, so their edges are exact. The bars lean
# by 15 degrees, so that rows of pixels see them at all phases.


def star(spokes=18, radius=7.0):
    """Shining triangles around the axis."""
    angle = 2 * np.pi * (np.arange(2 * spokes) + 0.5) / (2 * spokes)
    rim = radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(2 * spokes)], axis=1)
    faces = [[0, 2 * k + 1, 2 * k + 2] for k in range(spokes)]
    return pl.Scene([pl.Mesh(np.vstack([[0.0, 0.0, 0.0], rim]), faces, pl.Emissive(1.0)).translated(z=Z)])


LEAN = np.radians(15.0)


def grating(frequency, half_size=12.0):
    """Shining bars, half as wide as their distance."""
    n = int(half_size * frequency)
    left = (np.arange(-n, n + 1) - 0.25) / frequency
    bars = [
        pl.quad((x, -half_size, Z), (0.5 / frequency, 0, 0), (0, 2 * half_size, 0), material=pl.Emissive(1.0))
        for x in left
    ]
    return pl.Scene([bar.rotated_deg((0, 0, 1), np.degrees(LEAN)) for bar in bars])


# %%
# The star
# --------

middle = slice(256 - SIDE // 2, 256 + SIDE // 2)
stars, written = {}, []
for mode, camera in cameras.items():
    stars[mode] = shot = pl.render(star(), camera, samples=SAMPLES, region=np.s_[middle, middle], progress=False)
    path = output / f"star_{mode}.exr"
    shot.save(path)
    written.append(path)
    print(f"star, {mode}: relative error {100 * shot.relative_error:.2f} %, {shot.stats.seconds:.1f} s")

# %%
# Contrast
# --------
#
# Raw over white image is radiance. In the middle of the micro image on the axis, a constant, a wave of the
# grating's frequency and one of three times that are fitted to it. The first wave of bars that are black and white has
# the contrast 4 / pi where nothing is lost.

window = np.s_[250:262, 249:263]
row, column = np.meshgrid(np.arange(250, 262) - 255.5, np.arange(249, 263) - 255.5, indexing="ij")


def contrast(radiance, error, cycles):
    """Amplitude over mean of the wave of these cycles per pixel along columns and rows, with its standard error."""
    phase = 2 * np.pi * (cycles[0] * column + cycles[1] * row).ravel()
    waves = [wave(k * phase) for k in (1, 3) for wave in (np.cos, np.sin)]
    design = np.stack([np.ones_like(phase), *waves], axis=1)
    fit = np.linalg.lstsq(design, radiance.ravel(), rcond=None)[0]
    spread = np.sqrt(np.diag(np.linalg.inv(design.T @ design)) * np.mean(error**2))
    return np.hypot(fit[1], fit[2]) / fit[0], spread[1:3].mean() / fit[0]


def expected(camera, wave):
    """4 / pi times the Fourier transforms of the blurred opening and of the pixel."""
    b, f = camera.microlenses_to_sensor, camera.microlenses.focal_length
    corners = camera.microlenses.opening.corners
    shrunk = 1 - b / behind(camera) - b / f
    place = np.linspace(-1, 1, 401) * np.abs(corners).max()
    x, y = np.meshgrid(place, place)
    ahead = np.roll(corners, -1, axis=0) - corners
    inside = np.all([u * (y - c[1]) - v * (x - c[0]) >= 0 for c, (u, v) in zip(corners, ahead, strict=True)], axis=0)
    cycles = np.array(wave) / camera.sensor.pixel_pitch * shrunk
    opening = np.cos(2 * np.pi * (cycles[0] * x + cycles[1] * y))[inside].mean()
    return 4 / np.pi * abs(opening * np.sinc(wave[0]) * np.sinc(wave[1]))


def behind(camera):
    """Distance of the main lens's image of the scene behind the array."""
    return pl.paraxial.image_position(camera.lens, Z) - camera.stop_to_microlenses


found = {mode: [] for mode in cameras}
for mode, camera in cameras.items():
    white = pl.render_white(camera, samples=4 * SAMPLES, region=window, progress=False)
    # mm in the scene per pixel: main lens and microlens together.
    scale = abs(pl.paraxial.magnification(camera.lens, Z)) * camera.microlenses_to_sensor / behind(camera)
    per_pixel = camera.sensor.pixel_pitch / scale
    print(f"{mode}: {per_pixel:.4f} mm of the scene per pixel")
    print("  line pairs/mm   cycles/pixel   expected   rendered")
    for frequency in FREQUENCIES:
        # Columns run towards -x and rows towards +y of the sensor; the two lenses together turn x and y alike.
        cycles = frequency * per_pixel
        wave = (cycles * np.cos(LEAN), -cycles * np.sin(LEAN))
        shot = pl.render(grating(frequency), camera, samples=4 * SAMPLES, region=window, progress=False)
        radiance, error = shot.image[:, :, 0] / white.image[:, :, 0], shot.standard_error / white.image
        value = (frequency, expected(camera, wave), *contrast(radiance, error, wave))
        found[mode].append(value)
        print(f"  {frequency:13.2f}  {cycles:13.3f}  {value[1]:9.3f}  {value[2]:9.3f} +- {value[3]:.3f}")

# %%
# Both
# ----
#
# The same part of the sensor in both modes: in mode 2.0 the spokes can be told apart nearly to the middle, in mode 1.0
# they run together in an even grey where the blur is as wide as their distance; farther in, contrast comes back with
# black and white exchanged, since the transform of the opening is negative there.

figure, axes = plt.subplots(2, 2, figsize=(10, 9.4), layout="constrained")
detail = min(88, SIDE)
low, high = 256 - detail // 2 - 0.5, 256 + detail // 2 - 0.5
for ax, mode, near in ((axes[0, 0], "2.0", False), (axes[1, 0], "2.0", True), (axes[1, 1], "1.0", True)):
    image = stars[mode].image[:, :, 0]
    ax.imshow(
        image, cmap="gray", vmin=0, vmax=np.percentile(image, 99.8), interpolation="nearest",
        extent=(middle.start - 0.5, middle.stop - 0.5, middle.stop - 0.5, middle.start - 0.5),
    )  # fmt: skip
    ax.set(xlabel="column / pixel", ylabel="row / pixel", title=f"plenoptic {mode}" + (", detail" if near else ""))
    if near:
        ax.set(xlim=(low, high), ylim=(high, low))
    else:
        ax.add_patch(plt.Rectangle((low, low), high - low, high - low, fill=False, edgecolor="lime"))
ax = axes[0, 1]
for colour, (mode, values) in zip(("tab:blue", "tab:orange"), found.items(), strict=True):
    frequency, theory, measured, error = np.transpose(values)
    ax.plot(frequency, theory, color=colour, label=f"{mode}: opening and pixel")
    ax.errorbar(frequency, measured, 2 * error, fmt="o", color=colour, label=f"{mode}: rendered, 2 errors")
ax.set(xlabel="frequency in the scene / (line pairs / mm)", ylabel="contrast of the wave", ylim=(0, 4 / np.pi))
ax.set_title("gratings in the micro image on the axis")
ax.legend()
path = output / "fine_structure.png"
figure.savefig(path, dpi=100)
written.append(path)

# %%
print("written:", *written, sep="\n  ")
