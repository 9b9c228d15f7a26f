"""
A still life under water
========================

A light-field camera behind the dome of its housing looks at a few things on sand, in the coastal water of Jerlov's type
1C, beside a lamp. Water takes red from what is far, and scatters the lamp's light towards the camera. The same scene
without water beside it, and the transmittance to the first hit, which ``Truth.TRANSMITTANCE`` says.
"""

# %%
import dataclasses
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
SHAPE = (64, 96) if SMALL else (480, 720)
SAMPLES = 16 if SMALL else 128
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
grains = np.clip(0.75 + 0.12 * random.normal(size=(256, 256, 1)), 0, 1) * (0.80, 0.70, 0.52)
sand = pl.quad((-900, -190, -250), (1800, 0, 0), (0, 330, -2100), material=pl.Lambertian(pl.Texture(grains)))


def on_sand(x, z, height):
    """Point above the sand."""
    return x, -190 + 330 / 2100 * (-250 - z) + height, z


up = np.linspace(0, 1, 33)
profile = np.stack([22 + 16 * np.sin(0.2 + 2.9 * up) ** 2 - 14 * up, 150 * up], axis=1)
amphora = pl.shapes.turned(profile, material=pl.Lambertian((0.70, 0.30, 0.16)))
things = [
    amphora.translated(*on_sand(-85, -640, 0)),
    amphora.rotated_deg((0, 0, 1), 74).translated(*on_sand(150, -1050, 30)),
    pl.sphere(42, center=on_sand(40, -720, 36), material=pl.Dielectric(1.52 / WATER)),
    pl.sphere(24, center=on_sand(-8, -560, 22), material=pl.MetallicRoughness((0.75, 0.08, 0.06), roughness=0.4)),
    pl.sphere(120, center=on_sand(-330, -1500, 40), material=pl.materials.RoughDiffuse((0.45, 0.42, 0.38))),
    pl.sphere(95, center=on_sand(330, -1700, 40), material=pl.materials.RoughDiffuse((0.60, 0.50, 0.42))),
    pl.box(70, material=pl.Lambertian((0.85, 0.65, 0.10)))
    .rotated_deg((0, 1, 0), 30)
    .translated(*on_sand(120, -620, 35)),
]
lamp = pl.QuadLight.facing((-260, 330, -330), (0, -60, -750), (120, 120), radiance=(60.0, 60.0, 60.0))
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
# lamp; the rest is scattered, more of it blue.

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
