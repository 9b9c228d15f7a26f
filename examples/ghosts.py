"""
Ghosts of a lamp
================

Light that two surfaces of a lens reflect forms images of its own. This example lists those of a double Gauss that
looks at a bright lamp beside its axis, renders them with and without a coating, and measures the veiling glare. Then
microlenses stand before the sensor: light returns from their faces to the lens, and its ghosts have micro images.
"""

# %%
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
SIDE, PLENOPTIC_SIDE, SAMPLES = (24, 60, 64) if SMALL else (120, 240, 1024)

output = Path("output/ghosts")
output.mkdir(parents=True, exist_ok=True)

# %%
# Which surfaces
# --------------
#
# The lamp stands 5 m away, 8 degrees off the axis. The sensor is bare silicon below a cover glass, the worst case.

lens = pl.load_lens("double-gauss-100mm-f2")
distance, angle = 5000.0, np.radians(8.0)
silicon = pl.sensor.silicon_reflectance(587.6, cover=pl.glass("N-BK7"))
ghosts = lens.ghosts(field=(0.0, distance * np.tan(angle)), z_object=-distance, sensor=silicon)
print(ghosts)

# %%
# Images
# ------
#
# A square lamp of a radiance of 20 000 before a background of 1, on a logarithmic scale: ghosts lie opposite to
# the lamp, by way of the sensor and the last elements, and over all of the image. The coating leaves little of them.

camera = pl.PlenopticCamera(
    lens=lens, sensor=pl.Sensor(shape=(SIDE, SIDE), pixel_pitch=40.0 / SIDE), stop_to_microlenses=120.0
).focused_at(-distance)
centre, half = np.array([0.0, distance * np.tan(angle), -distance]), 120.0
corner = centre - (half, half, 0.0)
lamp = pl.shapes.quad(corner, (2 * half, 0, 0), (0, 2 * half, 0), material=pl.Emissive(20_000.0))
scene = pl.Scene([lamp], background=1.0)
images, settings = {}, pl.rendering.Ghosts(sensor=silicon, samples=SAMPLES)
for name, coating in (("bare", None), ("single layer", pl.optics.SingleLayer())):
    coated = pl.optics.coated(lens, coating)
    view = pl.PlenopticCamera(lens=coated, sensor=camera.sensor, stop_to_microlenses=camera.stop_to_microlenses)
    shot = pl.render(scene, view, samples=max(SAMPLES // 8, 8), ghosts=settings, progress=False)
    images[name] = shot.image[..., 0]
    shot.save(output / f"{name.replace(' ', '_')}.exr")
    glare = pl.aberrations.veiling_glare(coated, patch=0.02, sensor=silicon)
    print(f"{name}: veiling glare {100 * glare.index:.2f} % +- {100 * glare.standard_error:.2f} %")
    print(f"wrote {name.replace(' ', '_')}.exr")

# %%
# A plenoptic camera
# ------------------
#
# The same lens at f/4 before microlenses of 1 mm. The flat glass of the array returns 4 % of the light, the sensor 30 %
# of what the microlenses have focused on it, and most of that goes back through them to where it came from. The
# strongest ghost lies opposite to the lamp. Its light comes from other directions than that of the image, and so falls
# on other pixels of each micro image.

array = pl.MicrolensArray(pitch=1.0, focal_lengths=(4.0,))
plenoptic = pl.PlenopticCamera(
    lens=lens.with_stop(pl.CircularStop(12.5)),
    microlenses=array,
    sensor=pl.Sensor(shape=(PLENOPTIC_SIDE, PLENOPTIC_SIDE), pixel_pitch=40.0 / PLENOPTIC_SIDE),
    stop_to_microlenses=120.0,
    microlenses_to_sensor=4.0,
).focused_at(-distance)
settings = pl.rendering.Ghosts(array=0.04, sensor=0.3, samples=SAMPLES // 2)
shot = pl.render(scene, plenoptic, samples=max(SAMPLES // 8, 8), ghosts=settings, progress=False)
images["array, bare"] = shot.image[..., 0]
shot.save(output / "plenoptic.exr")
print("wrote plenoptic.exr")

# %%
# A single point
# --------------
#
# Traced forwards: the part of the light of the lamp's centre that arrives by reflections.

image, both = (pl.point_spread(plenoptic, centre, ghosts=g, rays=32 * SAMPLES) for g in (None, settings))
error = both.light_error / image.light
print(f"ghosts of the lamp's centre: {100 * (both.light / image.light - 1):.1f} % +- {100 * error:.1f} % of its light")

# %%
# Figure
# ------

figure, axes = plt.subplots(2, 2, figsize=(11.0, 9.0), layout="constrained")
axes = axes.ravel()
pl.plots.plot_ghosts(ghosts, axes[0])
darkest = np.log10(np.median(images["single layer"])) - 0.1
for ax, (name, image) in zip(axes[1:], images.items(), strict=True):
    shown = ax.imshow(np.log10(np.maximum(image, 1e-6)), cmap="magma", vmin=darkest, vmax=darkest + 4.0)
    ax.set(xlabel="column", ylabel="row", title=f"{name}: image and ghosts")
    figure.colorbar(shown, ax=ax, label="log10 of radiance times sr")
figure.savefig(output / "ghosts.png", dpi=110)
print("wrote ghosts.png")
