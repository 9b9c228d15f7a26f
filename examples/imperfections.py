"""
Imperfections in the white image
================================

Real arrays of microlenses are not what their drawing says: lenses stand a little beside their places, focal lengths
scatter, some lenses are dark, dust and scratches lie on array and sensor, and array and sensor are not quite
parallel. T. Michels et al. (2018) name this as future work. White images show all of it; here each flaw by itself,
larger than in a good camera, beside the design.
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
SIDE = 64 if SMALL else 160  # pixels along the rendered crop

output = Path("output/imperfections")
output.mkdir(parents=True, exist_ok=True)

# %%
# The design
# ----------
#
# The camera of that paper in plenoptic mode 1.0, with a sensor of 20 mm x 20 mm. The crop lies at the right border of
# the sensor, where tilts show.

design = pl.PlenopticCamera(
    lens=pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=4.25)),
    microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)),
    sensor=pl.Sensor(shape=(2000, 2000), pixel_pitch=0.010),
    stop_to_microlenses=123.3,
    microlenses_to_sensor=2.0,
)
crop = np.s_[1000 - SIDE // 2 : 1000 + SIDE // 2, 2000 - SIDE : 2000]


def with_array(**changes):
    """The design with other imperfections of its microlenses."""
    array = dataclasses.replace(design.microlenses, imperfections=pl.MicrolensImperfections(seed=1, **changes))
    return dataclasses.replace(design, microlenses=array)


def with_blemishes(site, **what):
    """The design with dust or scratches all over the array or the sensor."""
    scattered = pl.Blemishes.scattered(site, half_size=(10.1, 10.1), seed=3, **what)
    return dataclasses.replace(design, blemishes=(scattered,))


# %%
# The flaws
# ---------

JITTER, DARK, TILT, GRAINS = 0.005, 0.1, np.radians(0.5), 12.0
SENSOR, ARRAY = pl.BlemishSite.SENSOR, pl.BlemishSite.ARRAY
cameras = {
    "design": design,
    "places jitter by 5 um": with_array(pitch_jitter=JITTER),
    "focal lengths scatter by 10 %": with_array(focal_length_spread=0.1),
    "10 % of lenses dark": with_array(dark=DARK),
    "dust on the array": with_blemishes(ARRAY, dust_per_mm2=GRAINS, dust_radius=0.03),
    "the same dust on the pixels": with_blemishes(SENSOR, dust_per_mm2=GRAINS, dust_radius=0.03),
    "and 0.8 mm above them": with_blemishes(SENSOR, dust_per_mm2=GRAINS, dust_radius=0.03, height=0.8),
    "scratches on the array": with_blemishes(ARRAY, scratches=150, scratch_length=3.0, scratch_width=0.02),
    "array tilted by 0.5 degrees": design.moved(pl.CameraPart.MICROLENSES, tilt=(0.0, TILT, 0.0)),
}
whites, written = {}, []
for name, camera in cameras.items():
    whites[name] = white = pl.render_white(camera, samples=SAMPLES, region=crop, progress=False)
    path = output / (name.replace(" ", "_").replace("%", "percent").replace(".", "_") + ".exr")
    white.save(path)
    written.append(path)
    share = white.image.mean() / whites["design"].image.mean()
    print(f"{name:30s} {100 * share:7.2f} % of the design's light; {white.stats.seconds:.2f} s")

# %%
# What the numbers should be
# --------------------------
#
# Dark lenses take their share of the light, and dust on the pixels that of what it covers. Of a large sensor that is
# the fraction of dark lenses and 1 - exp(-c), where grains of a mean coverage c lie at random: n pi r0^2 exp(2 s^2) for
# n grains on a mm^2 of median r0, whose logarithms scatter by s. In a small crop it differs by chance, and is counted.
# Jitter loses light too, since openings are cut where they are pushed into their neighbours' cells.


def lost(name):
    """Part of the light of the design that is missing."""
    return 1 - whites[name].image.mean() / whites["design"].image.mean()


def centroids(name):
    """Where micro images lie, row and column, by their lattice indices."""
    found = pl.microlens_centres(cameras[name], pl.CentreMethod.CENTROID, white=whites[name])
    return {tuple(index): pixel for index, pixel in zip(found.index.tolist(), found.pixel, strict=True)}


def moved(name):
    """By how many pixels micro images lie elsewhere than in the design: (n, 2), rows and columns."""
    here, there = centroids(name), centroids("design")
    return np.array([here[index] - there[index] for index in here.keys() & there.keys()])


rows, columns = (np.arange(s.start, s.stop) for s in crop)
lenses = pl.microlens_centres(design)
in_crop = (lenses.pixel[:, 0] > rows[0]) & (lenses.pixel[:, 0] < rows[-1]) & (lenses.pixel[:, 1] > columns[0])
dark = 1 - cameras["10 % of lenses dark"].microlenses.imperfections.deviations(lenses.index[in_crop]).transmission
dust = cameras["the same dust on the pixels"].blemishes[0]
fine = np.stack(np.meshgrid(*(np.arange(len(r) * 8) / 8 + r[0] - 7 / 16 for r in (rows, columns)), indexing="ij"), -1)
place = np.stack([-(fine[..., 1] - 999.5), fine[..., 0] - 999.5], axis=-1) * design.sensor.pixel_pitch
passing = dust.at(place.reshape(-1, 2)).reshape(len(rows), 8, len(columns), 8).mean(axis=(1, 3))
kept = (passing * whites["design"].image[:, :, 0]).sum() / whites["design"].image.sum()
covered = GRAINS * np.pi * 0.03**2 * np.exp(2 * 0.5**2)
print("\n                               rendered   in this crop   in a large image")
print(f"light lost to dark lenses      {lost('10 % of lenses dark'):8.4f}   {dark.mean():12.4f}   {DARK:16.4f}")
print(f"light lost to dust on pixels   {lost('the same dust on the pixels'):8.4f}   {1 - kept:12.4f}   "
      f"{1 - np.exp(-covered):16.4f}")  # fmt: skip
jittered = moved("places jitter by 5 um")
print(f"jitter / pixel                 {jittered.std():8.3f}   {'':12s}   {JITTER / 0.010:16.3f}")

# %%
# A tilted array comes nearer to the sensor on one side. The chief ray of a microlens at x goes on at the slope
# x / (z of the array - exit pupil), so that its image moves by the slope times what is missing of the distance.
# Nearer images are smaller and brighter, too.

pupil = pl.paraxial.cardinal_points(design.lens).exit_pupil
at = np.array([x for x, _ in lenses.on_array[in_crop]]).mean()
nearer = -at * np.sin(TILT)  # about y, points at negative x are turned towards the sensor
shift = at * (np.cos(TILT) - 1) - nearer * at / (design.stop_to_microlenses - pupil)
tilted = moved("array tilted by 0.5 degrees")[:, 1]
print(f"tilt: columns / pixel          {tilted.mean():8.3f}   {-shift / 0.010:12.3f}")

# %%
# Pictures
# --------

figure, axes = plt.subplots(3, 6, figsize=(15.5, 8.4), layout="constrained", sharex=True, sharey=True)
extent = (columns[0] - 0.5, columns[-1] + 0.5, rows[-1] + 0.5, rows[0] - 0.5)
top = np.percentile(whites["design"].image, 99.8)
for place, (name, white) in enumerate(whites.items()):
    left, right = axes[place // 3, 2 * (place % 3) : 2 * (place % 3) + 2]
    image = white.image[:, :, 0]
    seen = left.imshow(image, cmap="gray", vmin=0, vmax=top, extent=extent, interpolation="nearest")
    left.set_title(name, fontsize=9)
    change = 100 * (image - whites["design"].image[:, :, 0]) / top
    shown = right.imshow(change, cmap="RdBu", vmin=-100, vmax=100, extent=extent, interpolation="nearest")
    right.set_title("minus the design" if place else "minus itself", fontsize=9)
for ax in axes[-1]:
    ax.set_xlabel("column / pixel")
for ax in axes[:, 0]:
    ax.set_ylabel("row / pixel")
figure.colorbar(seen, ax=axes[:2, -1], label="white image / sr")
figure.colorbar(shown, ax=axes[2:, -1], label="difference / % of full light")
path = output / "imperfections.png"
figure.savefig(path, dpi=100)
written.append(path)

# %%
print("written:", *written, sep="\n  ")
