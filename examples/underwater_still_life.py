"""
A still life under water
========================

A light-field camera behind the dome of its housing looks at a few things on sand, in the coastal water of Jerlov's type
1C, by the light of a torch beside it. Water takes red from what is far, and scatters the torch's light towards the
camera. The same scene without water beside it, and the transmittance to the first hit (``Truth.TRANSMITTANCE``).
"""

# %%
import dataclasses
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
SHAPE = (64, 96) if SMALL else (240, 360)
SAMPLES = 16 if SMALL else 64
BOUNCES = 4 if SMALL else 6

output = Path("output/underwater_still_life")
output.mkdir(parents=True, exist_ok=True)

# %%
# Things on sand
# --------------
#
# Lengths are in mm. The bottom rises with the distance; the camera looks along -z. Indices of glass are
# relative to water.

WATER = 1.333
random = np.random.default_rng(7)
grains = np.clip(0.75 + 0.12 * random.normal(size=(512, 512, 1)), 0, 1) * (0.80, 0.70, 0.52)
sand = pl.quad((-500, -60, -400), (1000, 0, 0), (0, 300, -2000), material=pl.Lambertian(pl.Texture(grains)))


def on_sand(x, z, height):
    """Point above the sand."""
    return x, -60 - 0.15 * (400 + z) + height, z


up = np.linspace(0, 1, 33)
profile = np.stack([13 + 9 * np.sin(0.2 + 2.9 * up) ** 2 - 8 * up, 78 * up], axis=1)
clay = pl.Lambertian((0.70, 0.30, 0.16))
things = [
    pl.shapes.turned(profile, material=clay).translated(*on_sand(-52, -660, -2)),
    pl.shapes.turned(0.9 * profile, material=clay).rotated_deg((0, 0, 1), 76).translated(*on_sand(95, -1000, 14)),
    pl.sphere(16, center=on_sand(6, -640, 14), material=pl.Dielectric(1.52 / WATER)),
    pl.sphere(11, center=on_sand(-18, -570, 9), material=pl.MetallicRoughness((0.75, 0.08, 0.06), roughness=0.4)),
    pl.sphere(60, center=on_sand(-150, -1500, 20), material=pl.materials.RoughDiffuse((0.45, 0.42, 0.38))),
    pl.sphere(45, center=on_sand(60, -1700, 15), material=pl.materials.RoughDiffuse((0.60, 0.50, 0.42))),
    pl.box(26, material=pl.Lambertian((0.85, 0.65, 0.10)))
    .rotated_deg((0, 1, 0), 30)
    .translated(*on_sand(50, -620, 13)),
]
lamp = pl.lights.SpotLight.facing((-220, 300, -250), (20, -20, -900), intensity=3e6, inner_angle=0.45, outer_angle=0.7)
water = pl.materials.jerlov_water("1C")
clear = pl.Scene([sand, *things], [lamp])
scene = dataclasses.replace(clear, medium=water)

# %%
# The camera behind its dome
# --------------------------
#
# The centre of the dome is that of the entrance pupil, so that chief rays pass it straight; the dome moves the focus
# alone. The sensor has the size of film, 36 mm x 24 mm.

lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=6.0))
camera = pl.PlenopticCamera(
    lens=pl.optics.window(lens, 5.0, pl.glass("N-BK7"), radius=120.0, outside=pl.glass("water")),
    microlenses=pl.MicrolensArray(pitch=0.40, focal_lengths=(2.0,), lattice=pl.Lattice.HEXAGONAL),
    sensor=pl.Sensor(shape=SHAPE, pixel_pitch=36.0 / SHAPE[1]),
    stop_to_microlenses=123.3,
    microlenses_to_sensor=1.7,
).focused_at(z=-650.0)
wanted = pl.Truth.DISTANCE | pl.Truth.TRANSMITTANCE
wet, dry = (
    pl.render(seen, camera, samples=SAMPLES, max_bounces=BOUNCES, truth=wanted, progress=False)
    for seen in (scene, clear)
)
print(f"in water: relative error {100 * wet.relative_error:.1f} %, {wet.stats.cpu_seconds:.0f} CPU s")

# %%
# What the water does
# -------------------
#
# At each distance the light that comes from the first hit is that of the transmittance there and on the way from the
# torch; the rest is scattered, more of it blue.

distance = wet.truth.distance
for low, high in ((500, 700), (700, 1000), (1000, 2000)):
    at = (distance >= low) & (distance < high)
    ratio = wet.image[at].sum(axis=0) / dry.image[at].sum(axis=0)
    left = wet.truth.transmittance[at].mean(axis=0)
    print(f"{low} to {high} mm: water over none", *(f"{part:.3f}" for part in ratio), "; transmittance",
          *(f"{part:.3f}" for part in left))  # fmt: skip

# %%
figure, axes = plt.subplots(2, 2, figsize=(13, 8.6), layout="constrained")
top = np.percentile(dry.image, 99.5)
for ax, shot, title in ((axes[0, 0], wet, "in water of type 1C"), (axes[0, 1], dry, "without water")):
    ax.imshow(pl.images.linear_to_srgb(np.clip(shot.image / top, 0, 1)))
    ax.set(title=f"raw image {title}", xlabel="columns / pixels", ylabel="rows / pixels")
drawn = axes[1, 0].imshow(wet.truth.transmittance[..., 0], cmap="viridis")
axes[1, 0].set(title="truth: transmittance at 600 nm", xlabel="columns / pixels", ylabel="rows / pixels")
figure.colorbar(drawn, ax=axes[1, 0], label="transmittance")
reach = np.linspace(0, 2500, 100)
for c, (colour, wavelength) in enumerate((("tab:red", 600), ("tab:green", 530), ("tab:blue", 450))):
    extinction = water.absorption[c] + water.scattering[c]
    axes[1, 1].plot(reach, np.exp(-extinction * reach), color=colour, label=f"{wavelength} nm")
    axes[1, 1].plot(reach, np.exp(-water.absorption[c] * reach), "--", color=colour)
axes[1, 1].set(title="transmittance; dashed: of absorption alone", xlabel="distance / mm", ylabel="transmittance")
axes[1, 1].legend()
written = [output / "water.exr", output / "underwater_still_life.png"]
wet.save(written[0])
figure.savefig(written[1], dpi=100)
print("written:", *(path.resolve() for path in written), sep="\n  ")
