"""
Disparity between micro images
==================================

In a focused plenoptic camera (2.0) neighbouring microlenses see a point of the scene in different places. With
the main-lens image a distance a behind the array, microlenses p apart and the sensor b behind them, a point
moves, relative to the centres of the microlenses, by::

    p b / a

from one microlens to the next. Here the edges in rendered micro images are compared with that.
"""

# %%
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
SAMPLES = 64 if SMALL else 1024

output = Path("output/disparity")
output.mkdir(parents=True, exist_ok=True)

# %%
# Camera and scene
# ----------------
#
# The sensor has an odd number of pixels, so that one column lies on the axis; microlenses follow each other along
# it. The scene is a half plane that shines below the axis.

camera = pl.PlenopticCamera(
    lens=pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=5.0)),
    microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,), lattice=pl.Lattice.HEXAGONAL),
    sensor=pl.Sensor(shape=(513, 513), pixel_pitch=0.010),
    stop_to_microlenses=123.3,
    microlenses_to_sensor=1.7,
)
pitch, b, pixel = camera.microlenses.pitch, camera.microlenses_to_sensor, camera.sensor.pixel_pitch
crop = np.s_[256 - 40 : 257 + 40, 254:259]


def half_plane(z):
    """Radiance 1 below the axis."""
    corners = [[-60, -60, z], [60, -60, z], [60, 0, z], [-60, 0, z]]
    return pl.Scene([pl.Mesh(corners, [[0, 1, 2], [0, 2, 3]], pl.Emissive(1.0))])


# %%
# Where the edges are
# -------------------
#
# The raw image divided by the white image is radiance: 0 above the edge and 1 below it. Around the centre of
# each microlens, the number of bright pixels tells the place of the edge to a fraction of a pixel.


def edge_in(radiance, centre, reach=8.0):
    """Place of the edge, in pixels below the middle of the crop, within `reach` of a microlens's centre."""
    place = np.arange(len(radiance)) - len(radiance) // 2
    share = np.clip(reach + 0.5 - np.abs(place - centre), 0, 1)  # of each pixel that lies in the window
    return centre + reach - float(share @ radiance)


white = pl.render_white(camera, samples=SAMPLES, region=crop, progress=False)
profiles = {}
print("distance     a       disparity: p b / a   rendered")
for z in (-380.0, -404.0, -430.0):
    shot = pl.render(half_plane(z), camera, samples=SAMPLES, region=crop, progress=False)
    radiance = np.mean(shot.image / white.image, axis=(1, 2))
    centres = np.array([-1, 0, 1]) * pitch / pixel
    edges = np.array([edge_in(radiance, centre) for centre in centres])
    behind = pl.paraxial.image_position(camera.lens, z) - camera.stop_to_microlenses
    expected = pitch * b / behind / pixel
    found = float(np.mean(np.diff(centres - edges)))
    profiles[z] = radiance
    print(f"{-z:5.0f} mm  {behind:6.3f} mm  {expected:10.3f} pixels  {found:8.3f} pixels")
    if z == -404.0:
        shot.save(output / "disparity.exr")

# %%
# Profiles
# --------
#
# The edge in the middle stays; those in the neighbours move with the distance of the half plane. What lies between
# two micro images is where both feed a pixel.

figure, ax = plt.subplots(figsize=(8, 4), layout="constrained")
for z, radiance in profiles.items():
    ax.plot(np.arange(len(radiance)) - len(radiance) // 2, radiance, marker=".", label=f"{-z:.0f} mm")
for centre in centres:
    ax.axvline(centre, color="grey", linewidth=0.8, linestyle="--")
ax.set(
    xlabel="row - middle / pixel", ylabel="radiance", title="along the column on the axis; dashed: microlens centres"
)
figure.legend(loc="outside right upper", title="distance")
figure.savefig(output / "disparity.png", dpi=100)
print("written:", output / "disparity.exr", output / "disparity.png", sep="\n  ")
