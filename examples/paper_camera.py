"""
One camera, two modes
=====================

The camera of T. Michels, A. Petersen, L. Palmieri and R. Koch, "Simulation of Plenoptic Cameras" (3DTV 2018,
doi:10.1109/3DTV.2018.8478432): a 100 mm double Gauss and a hexagonal array of microlenses, 0.217 mm apart, of
focal length 2 mm.

* **Plenoptic 2.0**: the sensor stands 1.7 mm behind the array. The microlenses are focused on the image that
  the main lens forms 11.3 mm behind them, here that of the plane z = -404 mm, and show its details.
* **Plenoptic 1.0**: the sensor stands in the focal plane of the microlenses, 2.0 mm behind the array. They are
  focused at infinity, or nearly on the pupil of the main lens. The image of the same plane, a = 11.3 mm behind
  the array, is blurred over p b / a = 0.038 mm or 3.8 pixels, and details finer than that are gone.
"""

# sphinx_gallery_thumbnail_number = 2

# %%
import dataclasses
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
SAMPLES = 8 if SMALL else 256
SIDE = 32 if SMALL else 256  # pixels along the rendered middle of the sensor
DETAIL = 24 if SMALL else 88  # pixels along a detail: four micro images

output = Path("output/paper_camera")
output.mkdir(parents=True, exist_ok=True)

# %%
# The camera in both modes
# ------------------------

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
# Micro images
# ----------------
#
# They lie as far apart as the centre of the exit pupil, projected through the lattice, makes them: the pitch
# times 1 + b / L for a sensor b behind the array and a pupil L in front of it.

pupil = pl.paraxial.cardinal_points(lens).exit_pupil
for mode, camera in cameras.items():
    b, distance = camera.microlenses_to_sensor, camera.stop_to_microlenses - pupil
    pitch = camera.microlenses.pitch * (1 + b / distance) / camera.sensor.pixel_pitch
    print(f"{mode}: micro images every {pitch:.3f} pixels, stop {2 * camera.lens.stop.semi_diameter:g} mm")

# %%
# Two scenes
# ----------
#
# A plane of shining and black squares of 1 mm at z = -404 mm, and a cube and two spheres before a wall of 2 mm
# squares. The squares are geometry, so their edges are exact.

middle = slice(256 - SIDE // 2, 256 + SIDE // 2)
scenes = {"check": pl.check_scene(), "objects": pl.objects_scene()}
shots = {}
written = []
for scene_name, scene in scenes.items():
    for mode, camera in cameras.items():
        shot = pl.render(scene, camera, samples=SAMPLES, region=np.s_[middle, middle], progress=False)
        shots[scene_name, mode] = shot
        print(f"{scene_name}, {mode}: relative error {100 * shot.relative_error:.2f} %, {shot.stats.seconds:.1f} s")
        path = output / f"{scene_name}_{mode}.exr"
        shot.save(path)
        written.append(path)

# %%
# Details
# -------
#
# Above the middle of the sensor, below a detail of it. In mode 2.0 edges of the squares are sharp within each
# micro image, and neighbours repeat them shifted: their disparity tells the depth. In mode 1.0 the rims of
# the micro images are sharp, and what is inside them is blurred.


def for_the_screen(image):
    """An image as sRGB, its brightest 3 % cut."""
    shown = pl.images.linear_to_srgb(np.clip(image / np.percentile(image, 97), 0, 1))
    return np.broadcast_to(shown, (*shown.shape[:2], 3))


for scene_name in scenes:
    figure, axes = plt.subplots(2, 2, figsize=(10, 9.8), layout="constrained")
    for column, mode in enumerate(cameras):
        image = shots[scene_name, mode].image
        low = (SIDE - DETAIL) // 2
        first = middle.start - 0.5
        extent = (first, first + SIDE, first + SIDE, first)
        for ax, what in zip(axes[:, column], ("", ", detail"), strict=True):
            ax.imshow(for_the_screen(image), extent=extent, interpolation="nearest")
            ax.set(title=f"{scene_name}, plenoptic {mode}{what}", xlabel="column / pixel", ylabel="row / pixel")
        near, far = first + low, first + low + DETAIL
        axes[0, column].add_patch(plt.Rectangle((near, near), DETAIL, DETAIL, fill=False, edgecolor="lime"))
        axes[1, column].set(xlim=(near, far), ylim=(far, near))
    path = output / f"{scene_name}.png"
    figure.savefig(path, dpi=100)
    written.append(path)

# %%
print("written:", *written, sep="\n  ")
