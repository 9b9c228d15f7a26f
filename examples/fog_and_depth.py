"""
Contrast in fog against depth
=============================

Signs at 10 to 80 m at night, in fog with a visibility of 100 m, and a street lamp beside them. Fog leaves exp(-optical
depth) of the light that comes straight from a sign, which ``Truth.TRANSMITTANCE`` says for each pixel. The light that
fog scatters lies over white and black alike: their difference follows the transmittance, and their contrast is lost.
"""

# %%
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
SHAPE = (60, 100) if SMALL else (180, 300)
SAMPLES = 64 if SMALL else 128
VISIBILITY = 100_000.0  # mm

output = Path("output/fog_and_depth")
output.mkdir(parents=True, exist_ok=True)

# %%
# Signs and a lamp
# ----------------
#
# Each sign is as wide as one sixth of the field, its upper half shines, its lower half is black. Lengths are in mm.
# The lamp hangs beside the field at the height of their middles, so that fog adds as much light to both halves.

distances = np.geomspace(10_000, 80_000, 5)
FIELD = 8.4 / 123.3  # width of the field over the distance
signs = []
for k, z in enumerate(distances):
    size = FIELD * z / 6
    left, low = (k - 2.5) * size * 1.15 + 0.08 * size, -0.9 * size
    upper = pl.quad((left, 0, -z), (size, 0, 0), (0, -low, 0), material=pl.Emissive(1.0))
    lower = pl.quad((left, low, -z), (size, 0, 0), (0, -low, 0), material=pl.Lambertian(0.0))
    signs += [upper, lower]
lamp = pl.lights.SphereLight((1600.0, 0.0, -30_000), radius=150.0, radiance=150.0)
fog = pl.materials.fog(VISIBILITY, g=0.85)
scene = pl.Scene(signs, [lamp], medium=fog)

# %%
# The camera
# ----------
#
# No microlenses, so that the whole image is that of one small opening.

camera = pl.PlenopticCamera(
    lens=pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=3.0)),
    sensor=pl.Sensor(shape=SHAPE, pixel_pitch=8.4 / SHAPE[1]),
    stop_to_microlenses=123.3,
).focused_at(z=-float(distances[2]))
wanted = pl.Truth.OBJECT | pl.Truth.TRANSMITTANCE | pl.Truth.DISTANCE
shot = pl.render(scene, camera, samples=SAMPLES, max_bounces=8, truth=wanted, progress=False)
white = pl.render_white(camera, samples=64, seed=1, progress=False)
print(f"relative error {100 * shot.relative_error:.1f} %, {shot.stats.cpu_seconds:.0f} CPU s")

# %%
# Contrast
# --------
#
# Radiance is raw image over white image. Pixels at edges see two surfaces and are left out by the median. Meshes are
# numbered in the order of the scene.

radiance = shot.image.mean(axis=2) / white.image[..., 0]
rows = []
for k in range(len(distances)):
    bright, dark = (radiance[shot.truth.object == number] for number in (2 * k, 2 * k + 1))
    where = shot.truth.object == 2 * k
    distance, left = shot.truth.distance[where].mean(), shot.truth.transmittance[where].mean()
    difference, total = np.median(bright) - np.median(dark), np.median(bright) + np.median(dark)
    depth = fog.scattering * distance
    rows.append((depth, left, difference, difference / total))
    print(f"optical depth {depth:.3f}: transmittance {left:.4f}, white - black {difference:.4f}, "
          f"contrast {difference / total:.4f}")  # fmt: skip
depth, left, difference, contrast = np.array(rows).T

# %%
figure, axes = plt.subplots(1, 3, figsize=(15, 3.9), layout="constrained")
axes[0].imshow(pl.images.linear_to_srgb(np.clip(radiance / np.percentile(radiance, 99), 0, 1)), cmap="gray")
axes[0].set(title="image", xlabel="columns / pixels", ylabel="rows / pixels")
drawn = axes[1].imshow(np.where(shot.truth.object >= 0, shot.truth.transmittance[..., 0], np.nan), vmin=0, vmax=1)
axes[1].set(title="truth: transmittance to the first hit", xlabel="columns / pixels", ylabel="rows / pixels")
figure.colorbar(drawn, ax=axes[1], label="transmittance")
fine = np.linspace(0, 1.05 * depth[-1], 100)
axes[2].semilogy(fine, np.exp(-fine), color="0.6", label="exp(-optical depth)")
axes[2].semilogy(depth, left, "+", markersize=11, label="transmittance")
axes[2].semilogy(depth, difference, "o", fillstyle="none", label="white minus black")
axes[2].semilogy(depth, contrast, "s-", label="contrast")
axes[2].set(title="signs in fog", xlabel="optical depth of the distance", ylabel="radiance, or contrast")
axes[2].legend()
written = [output / "raw.exr", output / "fog_and_depth.png"]
shot.save(written[0])
figure.savefig(written[1], dpi=100)
print("written:", *(path.resolve() for path in written), sep="\n  ")
