"""
Calibrate a camera
==================

Known of a camera on the desk are the focal length and the f-number printed on its lens, and the pixel pitch of its
sensor. The rest is in images that it takes: a white one, and some of a checkerboard. From these follows its twin, a
camera that renders what the real one would take, with the error of each of its numbers.

Here the real camera is rendered too, so that the truth is known. Its lens is traced through all surfaces; that of the
fitted model is thin.
"""

# %%
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
BOARDS, SAMPLES, WHITE_SAMPLES = (6, 20, 32) if SMALL else (8, 20, 32)

output = Path("output/calibrate_a_camera")
output.mkdir(parents=True, exist_ok=True)

# %%
# The real camera
# ---------------
#
# A double Gauss, and an array that was not mounted as it was designed. Raw images are those of a 12-bit sensor, with
# shot noise.

designed = pl.PlenopticCamera(
    lens=pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(4.25)),
    sensor=pl.Sensor(shape=(480, 640), pixel_pitch=0.010),
    stop_to_microlenses=123.3,
    microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)),
    microlenses_to_sensor=1.7,
)
real = designed.moved(pl.CameraPart.MICROLENSES, shift=(0.08, -0.05, 0.2), tilt=(1.5e-3, -1e-3, 0.01))
sensor = pl.SensorModel(photon_rate=20000.0, gain=0.2, read_noise=3.0, bits=12, black_level=64)


def photograph(scene, seed):
    """Raw image of a scene, or a white image."""
    if scene is None:
        shot = pl.render_white(real, samples=WHITE_SAMPLES, progress=False)
    else:
        shot = pl.render(scene, real, samples=SAMPLES, progress=False)
    return shot.develop(sensor, seed=seed)


# %%
# The white image
# ---------------
#
# It shows the lattice of the micro images, circles here, and the centre of each, dots. Arrows are distances of centres
# from the lattice.

white = photograph(None, seed=1)
grid = pl.calibration.find_micro_images(white)
print(grid)
pl.plots.plot_grid(grid, white).savefig(output / "grid.png", dpi=100)

# %%
# The boards
# ----------
#
# They are tilted by 25 degrees, each in another direction, and stand nearer and farther. Boards parallel to the sensor
# would not tell the focal length from the distances. ``find_corners`` finds the corners in all micro images and numbers
# them; ``observe`` does so for all raw images.

board = pl.targets.checkerboard(7, 6, square=2.2, margin=10.0, dark=pl.Emissive(0.1), bright=pl.Emissive(1.0))
random = np.random.default_rng(3)
places = [
    board.rotated_deg((0, 0, 1), random.uniform(-20, 20))
    .rotated_deg((np.cos(turn), np.sin(turn), 0), 25)
    .translated(*random.uniform(-1, 1, 2), random.uniform(-440, -370))
    for turn in 2.4 * np.arange(BOARDS)
]
raws = [photograph(pl.Scene(place.meshes, background=1.0), seed=2 + k) for k, place in enumerate(places)]
observations = pl.calibration.observe(raws, white, board, pixel_pitch=0.010)
print(observations)

figure, axes = plt.subplots(1, 2, figsize=(12, 4.8), layout="constrained")
for ax in axes:
    pl.plots.plot_corners(observations, raws[0], frame=0, ax=ax)
axes[1].set(xlim=(270, 370), ylim=(290, 190), title="a part of it")
figure.savefig(output / "corners.png", dpi=100)

# %%
# The fit
# -------
#
# Printed are values with standard errors, intervals that also hold what is not known of the exit pupil, and the further
# terms that frames which were left out ask for. Focal length and distances move together, as the correlations show.

calibration = pl.calibrate(observations, start=pl.calibration.NominalCamera(focal_length=100.0, f_number=8.0))
print(calibration)
efl = pl.paraxial.cardinal_points(real.lens).efl
print(f"true: focal length {efl:.3f} mm, array to sensor {real.microlenses_to_sensor - 0.2:.3f} mm")
pl.plots.plot_calibration(calibration).savefig(output / "errors.png", dpi=100)

# %%
# Residuals over the sensor are noise if the model has what the camera has.

pl.plots.plot_residuals(calibration, observations).savefig(output / "residuals.png", dpi=100)

# %%
# Which further measurement tightens the errors most, the table says.

print(calibration.advice)

# %%
# The twin
# --------
#
# ``calibration.camera`` renders, and ``calibration.turn`` and ``shift`` say where it saw the boards. The middles of the
# squares, which no fit has used, are projected by both cameras.

twin = calibration.camera
rows, columns = board.index.max(axis=0) + 1
off = []
for k, place in enumerate(places):
    corners = [points.reshape(rows, columns, 3) for points in (place.points, calibration.points(k))]
    middles = [0.25 * (p[1:, 1:] + p[1:, :-1] + p[:-1, 1:] + p[:-1, :-1]).reshape(-1, 3) for p in corners]
    by_real, by_twin = (camera.project(p, progress=False) for camera, p in zip((real, twin), middles, strict=True))
    for point in range(len(middles[0])):
        here = by_real.pixel[(by_real.point == point) & by_real.passes]
        there = by_twin.pixel[by_twin.point == point]
        # Numbers of microlenses begin elsewhere: the nearest image is that in the same micro image.
        distance = there[None] - here[:, None]
        nearest = np.hypot(*distance.T).T.argmin(axis=1)
        off.append(distance[np.arange(len(here)), nearest])
off = np.concatenate(off)
print(f"{len(off)} images of middles: twin minus real {np.sqrt(np.mean(off**2)):.3f} pixels RMS")

# %%
# A board as both render it, and the difference.

matrix = np.eye(4)
matrix[:3, :3], matrix[:3, 3] = calibration.turn[0], calibration.shift[0]
region = np.s_[180:300, 260:380]
images = [
    pl.render(pl.Scene(target.meshes, background=1.0), camera, samples=4 * SAMPLES, region=region, progress=False).image
    for camera, target in ((real, places[0]), (twin, board.transformed(matrix)))
]
figure, axes = plt.subplots(1, 3, figsize=(13, 4.4), sharex=True, sharey=True, layout="constrained")
extent = (259.5, 379.5, 299.5, 179.5)
high = max(np.percentile(image, 99) for image in images)
for ax, image, title in zip(axes[:2], images, ("real", "twin"), strict=True):
    ax.imshow(image[:, :, 0], extent=extent, cmap="gray", vmin=0, vmax=high)
    ax.set(title=title, xlabel="column / pixel")
drawn = axes[2].imshow((images[1] - images[0])[:, :, 0], extent=extent, cmap="RdBu", vmin=-high, vmax=high)
axes[2].set(title="twin minus real", xlabel="column / pixel")
axes[0].set_ylabel("row / pixel")
figure.colorbar(drawn, ax=axes, label="image")
figure.savefig(output / "twin.png", dpi=100)

# %%
print("written:", *sorted(output.iterdir()), sep="\n  ")
