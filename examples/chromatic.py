"""
Colour aberrations in one rendering
===================================

Glass refracts blue more than red, and images of different colours have different sizes: lateral colour. T. Michels et
al., "Simulation of Plenoptic Cameras" (2018) name it as future work. Here every path draws a wavelength, is refracted
by the real glasses at it, and counts as the sensor's channels see it. The lens is a fisheye at 100 mm with much of
it; what is rendered is compared with chief rays that are traced wavelength by wavelength.
"""

# %%
import dataclasses
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
SAMPLES = 64 if SMALL else 1024
SIDE = 40 if SMALL else 110  # pixels along the crop of the raw image
Z = -1500.0

output = Path("output/chromatic")
output.mkdir(parents=True, exist_ok=True)

# %%
# The camera
# ----------
#
# A focused plenoptic camera with an array designed for this lens, and a sensor with the sensitivities of a typical
# colour camera. Without ``sensitivity`` it is traced at one wavelength, and colours are channels that go the same ways.

lens = pl.load_lens("fisheye-100mm-f8")
sensor = pl.Sensor(shape=(3200, 3200), pixel_pitch=0.010)
one_colour = pl.design_camera(
    lens, sensor=sensor, kind=pl.CameraKind.GALILEAN, z=Z, pitch=0.217, virtual_depth=4.0, image_fill=0.9,
    semi_diameter=0.8 * lens.stop.semi_diameter,
).camera  # fmt: skip
seen = pl.sensitivities.colour_camera()
spectral = dataclasses.replace(one_colour, sensitivity=seen)
print(f"b = {spectral.microlenses_to_sensor:.3f} mm, virtual depth {spectral.report().focus[0].virtual_depth:.2f}")

# %%
# Fringes
# -------
#
# A checkerboard in black and white, on the axis and at the left border of the sensor. Both cameras spend as many paths.

board = pl.Scene(
    [mesh.translated(z=Z) for mesh in pl.checkerboard((900, 900), 12.0, even=pl.Emissive(1.0), odd=pl.Emissive(0.02))]
)
middle = slice(1600 - SIDE // 2, 1600 + SIDE // 2)
places = {"on the axis": np.s_[middle, middle], "at the left border": np.s_[middle, 0:SIDE]}
shots, written = {}, []
for name, camera in (("one wavelength", one_colour), ("spectral", spectral)):
    for place, region in places.items():
        shots[name, place] = shot = pl.render(board, camera, samples=SAMPLES, region=region, progress=False)
        written.append(output / f"{name}_{place}.exr".replace(" ", "_"))
        shot.save(written[-1])
        print(f"{name}, {place}: relative error {100 * shot.relative_error:.2f} %, {shot.stats.seconds:.1f} s")

# %%
# Lateral colour
# --------------
#
# A white square of half a millimetre, seen by the main lens alone. Its image in each channel is a small spectrum, whose
# centroid is the mean of where chief rays of all wavelengths arrive, weighted by the channel.

alone = pl.PlenopticCamera(
    lens=lens.with_stop(pl.CircularStop(0.4 * lens.stop.semi_diameter)), sensor=sensor, stop_to_microlenses=550.0
).focused_at(z=Z)
coloured = dataclasses.replace(alone, sensitivity=seen)
wavelengths = np.arange(390.0, 711.0, 20.0 if SMALL else 10.0)
weights = seen.at(wavelengths)
weights /= weights.sum(axis=0)


def chief_columns(x):
    """Column on the sensor of the chief ray from (x, 0, Z) at each wavelength."""
    rays = [pl.project(dataclasses.replace(alone, wavelength=w), (x, 0.0, Z), rays=8) for w in wavelengths]
    return np.array([ray.pixel[0, 1] for ray in rays])


def centroids(x, reach=40):
    """Centroid along columns of the square's image in each channel, with its standard error."""
    scene = pl.Scene([pl.quad((x - 0.25, -0.25, Z), (0.5, 0, 0), (0, 0.5, 0), material=pl.Emissive(1.0))])
    near = round(float(np.median(chief_columns(x))))
    low, high = max(near - 2 * reach, 0), min(near + 2 * reach, 3200)
    shot = pl.render(
        scene, coloured, samples=SAMPLES, region=np.s_[1600 - reach : 1600 + reach, low:high], progress=False
    )
    column = np.arange(low, high)[None, :, None]
    light = shot.image.sum(axis=(0, 1), dtype=np.float64)
    place = (shot.image * column).sum(axis=(0, 1), dtype=np.float64) / light
    # Pixels that no path found bright have the error of one sample: far from the square it would outweigh all others.
    error = np.sqrt(np.sum(((column - place) * shot.standard_error * (shot.image > 0)) ** 2, axis=(0, 1))) / light
    return place, error


FIELDS = (40.0, 180.0) if SMALL else (0.0, 40.0, 80.0, 120.0, 160.0, 180.0)  # x of the square in mm
print("\nx / mm   channel   column: chief rays, rendered")
found = {}
for x in FIELDS:
    columns = chief_columns(x)
    found[x] = (columns, columns @ weights, *centroids(x))
    for channel, theory, place, error in zip("RGB", *found[x][1:], strict=True):
        off = (place - theory) / error
        print(f"{x:6.0f} {channel:>9s}   {theory:19.3f} {place:9.3f} +- {error:.3f}   ({off:+.1f} standard errors)")

# %%
figure = plt.figure(figsize=(12, 7.6), layout="constrained")
left, right = figure.subfigures(1, 2, width_ratios=(1.5, 1))
for ax, ((name, place), shot) in zip(left.subplots(2, 2).flat, shots.items(), strict=True):
    region = places[place]
    extent = (region[1].start - 0.5, region[1].stop - 0.5, region[0].stop - 0.5, region[0].start - 0.5)
    image = np.broadcast_to(np.clip(shot.image / np.percentile(shot.image, 99.5), 0, 1), (*shot.image.shape[:2], 3))
    ax.imshow(pl.images.linear_to_srgb(image), extent=extent, interpolation="nearest")
    ax.set(xlabel="column / pixel", ylabel="row / pixel", title=f"{name}, {place}")
ax = right.subplots()
mean_wavelength = wavelengths @ weights
for x, (columns, theory, place, error) in found.items():
    at = np.interp(587.6, wavelengths, columns)
    (line,) = ax.plot(wavelengths, columns - at, label=f"x = {x:.0f} mm")
    ax.plot(mean_wavelength, theory - at, "kx", markersize=4, zorder=3)
    ax.errorbar(mean_wavelength, place - at, 3 * error, fmt="o", color=line.get_color())
ax.set(xlabel="wavelength / nm", ylabel="column minus that at 587.6 nm / pixel")
ax.set_title(
    "chief rays; at mean wavelengths of B, G and R:\ncentroids, rendered (dots), from the rays (crosses)", fontsize=10
)
ax.legend(title="white square at")
written.append(output / "chromatic.png")
figure.savefig(written[-1], dpi=100)

# %%
print("written:", *written, sep="\n  ")
