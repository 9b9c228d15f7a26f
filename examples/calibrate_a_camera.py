"""
Calibrate a camera
==================

What is known of a camera on the desk: the focal length and the f-number printed on its lens, and the pixel pitch of its
sensor. The rest is in images that it takes: a white one, and a checkerboard held before it a dozen times. From these
follows a camera that renders what the real one would have taken, with the error of each of its numbers.

Here the real one is rendered too, through another lens than the model that is fitted, so that the truth is known.
"""

# %%
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
BOARDS, SAMPLES, WHITE_SAMPLES = (4, 8, 32) if SMALL else (12, 24, 64)

output = Path("output/calibrate_a_camera")
output.mkdir(parents=True, exist_ok=True)

# %%
# The camera that nobody knows
# ----------------------------
#
# A double Gauss, all surfaces of which are traced, and an array that was not mounted as it was designed. Its raw images
# are those of a 12-bit sensor, with shot noise.

designed = pl.PlenopticCamera(
    lens=pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(4.25)),
    sensor=pl.Sensor(shape=(480, 640), pixel_pitch=0.010),
    stop_to_microlenses=123.3,
    microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)),
    microlenses_to_sensor=1.7,
)
real = designed.moved(pl.CameraPart.MICROLENSES, shift=(0.08, -0.05, 0.2), tilt=(1.5e-3, -1e-3, 0.01))
sensor = pl.SensorModel(photon_rate=40000.0, gain=0.08, read_noise=3.0, bits=12, black_level=64)

# %%
# The white image
# ---------------
#
# ``find_micro_images`` finds the lattice of the micro images and the centre of each, with no camera given.

white = pl.render_white(real, samples=WHITE_SAMPLES, progress=False).develop(sensor, seed=1)
grid = pl.calibration.find_micro_images(white)
print(grid)
figure = pl.plots.plot_grid(grid, white)
figure.savefig(output / "grid.png", dpi=100)

# %%
# Boards
# ------
#
# Boards are tilted by some 25 degrees, each in another direction, and stand nearer and farther: boards that are parallel
# to the sensor do not tell the focal length from the distances.

design = pl.targets.checkerboard(8, 6, square=2.5, dark=pl.Emissive(0.1), bright=pl.Emissive(1.0))
random = np.random.default_rng(3)
boards = [
    design.rotated_deg((0, 0, 1), random.uniform(-20, 20))
    .rotated_deg((np.cos(turn), np.sin(turn), 0), 25)
    .translated(*random.uniform(-1.5, 1.5, 2), random.uniform(-440, -370))
    for turn in 2.4 * np.arange(BOARDS)
]
raws = [
    pl.render(pl.Scene(board.meshes, background=0.4), real, samples=SAMPLES, progress=False).develop(sensor, seed=2 + k)
    for k, board in enumerate(boards)
]

# %%
# Corners are observed in all micro images that show them.

corners = pl.package.calibration_points(real, boards)
centres = pl.microlens_centres(real)
observations = pl.calibration.Observations(
    index=corners.index,
    pixel=corners.pixel + 0.1 * random.standard_normal(corners.pixel.shape),
    frame=corners.frame,
    point=corners.point,
    board=design.points,
    centre_index=centres.index,
    centre_pixel=centres.pixel + 0.02 * random.standard_normal(centres.pixel.shape),
    sensor=real.sensor,
)
print(observations)
ax = pl.plots.plot_corners(observations, raws[0], frame=0)
ax.figure.savefig(output / "corners.png", dpi=100)

# %%
# The fit
# -------
#
# The main lens of the model is thin. What is printed: values, standard errors, intervals that hold what is not known of
# the exit pupil, too, and which further terms frames that were left out ask for.

calibration = pl.calibrate(observations, start=pl.calibration.NominalCamera(focal_length=100.0, f_number=8.0))
print(calibration)
pl.plots.plot_calibration(calibration).savefig(output / "errors.png", dpi=100)

# %%
# Residuals are noise if the model has what the camera has. A pattern over the sensor would be something that it lacks.

pl.plots.plot_residuals(calibration, observations).savefig(output / "residuals.png", dpi=100)

# %%
# Focal length and distances move together: each is known to a few tenths of a millimetre, what they do to images much
# better. What would tell them apart, the table says.

print(calibration.advice)

# %%
# The twin
# --------
#
# ``calibration.camera`` is a camera as any other. Points that no board had are projected by it and by the real one.

twin = calibration.camera
points = random.uniform((-6, -5, -440), (6, 5, -370), (40, 3))
seen = {name: camera.project(points, progress=False) for name, camera in (("real", real), ("twin", twin))}
rows = {
    name: {(p, *i): pixel for p, i, pixel in zip(s.point.tolist(), s.index.tolist(), s.pixel, strict=True)}
    for name, s in seen.items()
}
both = rows["real"].keys() & rows["twin"].keys()
off = np.array([rows["twin"][key] - rows["real"][key] for key in both])
off = off[np.isfinite(off).all(axis=1)]
print(f"{len(off)} images of {len(points)} points: twin minus real {np.sqrt(np.mean(off**2)):.3f} pixels RMS")

# %%
# The same scene by both, and the difference, as large as the picture is bright where edges lie elsewhere by a pixel.

scene = pl.Scene(boards[0].meshes, background=0.4)
region = (160, 320, 240, 400)
shots = [pl.render(scene, camera, samples=4 * SAMPLES, region=region, progress=False) for camera in (real, twin)]
images = [shot.image[:, :, 0] for shot in shots]
extent = (region[2] - 0.5, region[3] - 0.5, region[1] - 0.5, region[0] - 0.5)
figure, axes = plt.subplots(1, 3, figsize=(13, 4.4), sharex=True, sharey=True, layout="constrained")
top = np.percentile(images[0], 99)
for ax, image, title in zip(axes, [*images, images[1] - images[0]], ("real", "twin", "twin minus real"), strict=True):
    style = {"cmap": "gray", "vmin": 0, "vmax": top} if title in ("real", "twin") else {"cmap": "RdBu", "vmin": -top, "vmax": top}
    ax.imshow(image, extent=extent, **style)
    ax.set(title=title, xlabel="column / pixel")
axes[0].set_ylabel("row / pixel")
figure.savefig(output / "twin.png", dpi=100)

# %%
print("written:", *sorted(output.iterdir()), sep="\n  ")
