"""
One exposure, many sensors
==========================

A rendering is light; what a sensor makes of it comes afterwards and costs little. Here one exposure of the still
life is developed by sensors with three layers and with colour filters, in bright and in dim light. Demosaicing
invents colours where brightness changes from pixel to pixel: at edges of the scene, which microlenses repeat, and
at the rims of the micro images.
"""

# %%
import dataclasses
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
SAMPLES = 32 if SMALL else 2048
SIDE = 48 if SMALL else 128  # pixels along the rendered crop

output = Path("output/sensor_noise")
output.mkdir(parents=True, exist_ok=True)

# %%
camera = pl.PlenopticCamera(
    lens=pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=5.0)),
    microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)),
    sensor=pl.Sensor(shape=(512, 512), pixel_pitch=0.010),
    stop_to_microlenses=123.3,
    microlenses_to_sensor=1.7,
)
first = 280 - SIDE // 2
crop = np.s_[first : first + SIDE, first : first + SIDE]
shot = pl.render(pl.still_life(), camera, samples=SAMPLES, region=crop, progress=False)
print(f"exposure: relative error {100 * shot.relative_error:.2f} %, {shot.stats.seconds:.1f} s")

# %%
# Sensors
# -------
#
# The brightest pixels nearly fill the wells of the first. In dim light there is a hundredth of it, and gain makes up
# for that.

WELL = 12000.0  # electrons
brightest = float(shot.image.max())
ideal = pl.SensorModel(photon_rate=0.95 * WELL / brightest, shot_noise=pl.ShotNoise.NONE, bits=None)
layers = pl.SensorModel(
    photon_rate=ideal.photon_rate, gain=3900 / WELL, black_level=64, full_well=WELL, read_noise=3.0, prnu=0.01
)
bayer = dataclasses.replace(layers, colour_filters=pl.BayerPattern.RGGB)
dim = dataclasses.replace(bayer, exposure_time=0.01, gain=100 * layers.gain)
perfect_filters = dataclasses.replace(ideal, colour_filters=pl.BayerPattern.RGGB)

LINEAR, MHC = pl.DemosaicMethod.LINEAR, pl.DemosaicMethod.MHC
pictures = {
    "the exposure": shot,
    "three layers": shot.develop(layers, seed=1).demosaic(),
    "colour filters, no noise, linear": shot.develop(perfect_filters).demosaic(LINEAR),
    "colour filters, no noise, MHC": shot.develop(perfect_filters).demosaic(MHC),
    "colour filters and noise, MHC": shot.develop(bayer, seed=1).demosaic(MHC),
    "a hundredth of the light, MHC": shot.develop(dim, seed=1).demosaic(MHC),
}
written = []
for name, model in (("layers", layers), ("bayer", bayer), ("dim", dim)):
    raw = shot.develop(model, seed=1)
    written.append(output / f"raw_{name}.tif")
    raw.save(written[-1])
    print(raw)

# %%
# False colour
# ------------
#
# What is false is the part of red minus green and blue minus green that the exposure does not have. Linear
# interpolation blurs; the method of Malvar, He and Cutler corrects by the gradient of the pixel's own channel. In the
# still life every edge errs. The white image, which is grey, has no edges but those that microlenses make: there, false
# colour is that of their rims.


def false_colour(picture, exposure):
    """Chroma minus that of the exposure, over the exposure's brightest value, in per cent."""
    chroma = [p.image[:, :, [0, 2]] - p.image[:, :, [1]] for p in (picture, exposure)]
    return 100 * np.linalg.norm(chroma[0] - chroma[1], axis=2) / exposure.image.max()


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


white = pl.render_white(camera, samples=SAMPLES // 4, region=crop, progress=False)
grey = pl.Exposure(np.repeat(white.image, 3, axis=2), region=white.region)
slope = np.hypot(*np.gradient(white.image[:, :, 0]))
rims, inside = slope > np.percentile(slope, 70), slope < np.percentile(slope, 30)
print("\nfalse colour of the still life / % of the brightest")
for name, picture in pictures.items():
    print(f"{name:36s} {rms(false_colour(picture, shot)):8.2f}")
print("\nfalse colour of the white image           at rims   within micro images")
white_pictures = {method: grey.develop(perfect_filters).demosaic(method) for method in (LINEAR, MHC)}
for method, picture in white_pictures.items():
    wrong = false_colour(picture, grey)
    print(f"colour filters, no noise, {method.name:10s} {rms(wrong[rims]):12.2f}   {rms(wrong[inside]):8.2f}")

# %%
# Photon transfer
# ---------------
#
# Variance against mean over even exposures tells gain and noise of a sensor: shot noise has the slope 1 on
# logarithmic axes, read noise ends it below and the spread of pixels above, until wells are full.

levels = np.append(0.0, brightest * np.geomspace(3e-5, 1.3, 8 if SMALL else 25))
transfer = pl.sensor.photon_transfer(layers, levels, shape=(64, 64) if SMALL else (512, 512))
print(f"\ngain from photon transfer {transfer.gain:.4f} DN per electron; the sensor has {layers.gain:.4f}")

# %%
figure = plt.figure(figsize=(12, 11), layout="constrained")
above, below = figure.subfigures(2, 1, height_ratios=(1.8, 1))
extent = (crop[1].start - 0.5, crop[1].stop - 0.5, crop[0].stop - 0.5, crop[0].start - 0.5)
near = (
    crop[1].start + SIDE // 4,
    crop[1].start + 3 * SIDE // 4,
    crop[0].start + 3 * SIDE // 4,
    crop[0].start + SIDE // 4,
)
for ax, (name, picture) in zip(above.subplots(2, 3, sharex=True, sharey=True).flat, pictures.items(), strict=True):
    ax.imshow(
        pl.images.linear_to_srgb(np.clip(picture.image / np.percentile(shot.image, 98), 0, 1)),
        extent=extent,
        interpolation="nearest",
    )
    ax.set(xlabel="column / pixel", ylabel="row / pixel", title=name, xlim=near[:2], ylim=near[2:])
    ax.label_outer()
*panels, right = below.subplots(1, 4, width_ratios=(1, 1, 1, 1.2))
wrong = {
    "still life, linear": false_colour(pictures["colour filters, no noise, linear"], shot),
    "still life, MHC": false_colour(pictures["colour filters, no noise, MHC"], shot),
    "white image, MHC": false_colour(white_pictures[MHC], grey),
}
for ax, (name, values) in zip(panels, wrong.items(), strict=True):
    shown = ax.imshow(values, extent=extent, cmap="magma", vmin=0, vmax=15)
    ax.set(xlabel="column / pixel", ylabel="row / pixel", title=f"false colour: {name}")
    ax.label_outer()
below.colorbar(shown, ax=panels, label="% of the brightest", extend="max", location="bottom", shrink=0.5)
pl.plots.plot_photon_transfer(transfer, right)
right.set_title("photon transfer")
written.append(output / "sensor_noise.png")
figure.savefig(written[-1], dpi=100)

# %%
print("written:", *written, sep="\n  ")
