"""
Corners of a checkerboard, exactly
==================================

Calibration looks for the corners of a checkerboard in raw images, where every micro image shows some of them.
``pl.project`` says where each corner lies in each, by tracing rays, so that what a detector finds has an exact answer.
Here that is a detector of the simplest kind: it moves to where all gradients around it point past it.
"""

# %%
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
SAMPLES = 32 if SMALL else 512
SIDE = 64 if SMALL else 192  # pixels along the rendered crop

output = Path("output/calibration_points")
output.mkdir(parents=True, exist_ok=True)

# %%
# Camera and board
# ----------------
#
# The focused camera before a board of 2 mm squares that leans by 25 degrees, from 390 mm to 418 mm away.

camera = pl.PlenopticCamera(
    lens=pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=5.0)),
    microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)),
    sensor=pl.Sensor(shape=(512, 512), pixel_pitch=0.010),
    stop_to_microlenses=123.3,
    microlenses_to_sensor=1.7,
)
SQUARE, LEAN, Z = 2.0, 25.0, -404.0


def on_board(points):
    """The board's own points (n, 2) in the world: turned in its plane, leaning, and moved in front of the camera."""
    a, b = np.radians(12.0), np.radians(LEAN)
    flat = np.array([[np.cos(a), -np.sin(a), 0.0], [np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]])
    lean = np.array([[np.cos(b), 0.0, np.sin(b)], [0.0, 1.0, 0.0], [-np.sin(b), 0.0, np.cos(b)]])
    return np.column_stack([points, np.zeros(len(points))]) @ flat.T @ lean.T + [0.0, 0.0, Z]


board = [
    mesh.rotated_deg((0, 0, 1), 12.0).rotated_deg((0, 1, 0), LEAN).translated(z=Z)
    for mesh in pl.checkerboard((60, 60), SQUARE, even=pl.Emissive(1.0), odd=pl.Emissive(0.1))
]
scene = pl.Scene(board)
corners = on_board(SQUARE * np.stack(np.meshgrid(np.arange(-7, 8), np.arange(-7, 8)), axis=-1).reshape(-1, 2))

# %%
first = 256 - SIDE // 2
crop = np.s_[first : first + SIDE, first : first + SIDE]
shot = pl.render(scene, camera, samples=SAMPLES, region=crop, progress=False)
white = pl.render_white(camera, samples=SAMPLES // 2, region=crop, seed=1, progress=False)
shot.save(output / "board.exr")
projected = pl.project(camera, corners, scene=scene)
print(projected)

# %%
# Detected and true
# -----------------
#
# Corners that lie well within their micro image are looked for in a window of 7 x 7 pixels, from a start that is
# beside the truth by up to half a pixel. In the window, radiance is raw over white image. The point q that is nearest
# to lying on all edges solves sum g g^T (q - p) = 0 over pixels p of gradient g.

seen = projected.selected(projected.visible & projected.passes)
centres = pl.microlens_centres(camera)
middle_of = {tuple(i): pixel for i, pixel in zip(centres.index.tolist(), centres.pixel, strict=True)}
beside = np.array(
    [p - middle_of.get(tuple(i), (np.inf, 0)) for i, p in zip(seen.index.tolist(), seen.pixel, strict=True)]
)
inside = np.hypot(*beside.T) < 5.5
reach = np.abs(seen.pixel - (first + (SIDE - 1) / 2)).max(axis=1) < SIDE / 2 - 6
truth = seen.pixel[inside & reach]
radiance = shot.image[:, :, 0] / np.maximum(white.image[:, :, 0], 1e-6)


def refined(start, steps=8, half=3):
    """A corner found from a start (row, column), in pixels of the sensor; nan where the search leaves the window."""
    place = np.array(start)
    for _ in range(steps):
        row, column = np.rint(place).astype(int) - first
        part = radiance[row - half - 1 : row + half + 2, column - half - 1 : column + half + 2]
        slope = np.stack([g[1:-1, 1:-1].ravel() for g in np.gradient(part)], axis=1)
        offsets = np.stack(np.mgrid[-half : half + 1, -half : half + 1], axis=-1).reshape(-1, 2)
        grid = offsets + np.array([row + first, column + first])
        weight = np.exp(-np.sum((grid - place) ** 2, axis=1) / (2 * 1.5**2))
        normal = np.einsum("n,ni,nj->nij", weight, slope, slope)
        place = np.linalg.solve(normal.sum(axis=0), np.einsum("nij,nj->i", normal, grid))
        if np.abs(place - start).max() > 2:
            return np.full(2, np.nan)
    return place


random = np.random.default_rng(1)
found = np.array([refined(p + random.uniform(-0.5, 0.5, 2)) for p in truth])
kept = np.isfinite(found).all(axis=1)
error = (found - truth)[kept]
mean, spread = error.mean(axis=0), error.std(axis=0)
print(f"{len(truth)} corners in micro images, {kept.sum()} detected")
print("detected minus true / pixels: mean (rows, columns) ", np.round(mean, 4), ", spread", np.round(spread, 4))

# %%
# Picture
# -------
#
# Circles are the truth and crosses what the detector finds, in a part of the raw image; the same for the depth of each
# pixel's ray, which the renderer gives with the image.

figure, axes = plt.subplots(1, 3, figsize=(15, 4.6), layout="constrained")
extent = (crop[1].start - 0.5, crop[1].stop - 0.5, crop[0].stop - 0.5, crop[0].start - 0.5)
near = min(33, SIDE // 2)
axes[0].imshow(shot.image[:, :, 0], cmap="gray", extent=extent, interpolation="nearest")
axes[0].plot(seen.pixel[:, 1], seen.pixel[:, 0], ".", color="#e69f00", markersize=3, label="all that are visible")
axes[0].plot(
    truth[:, 1],
    truth[:, 0],
    "o",
    color="#56b4e9",
    fillstyle="none",
    markersize=9,
    markeredgewidth=2,
    label="true, used",
)
axes[0].plot(found[:, 1], found[:, 0], "x", color="#d55e00", markersize=7, label="detected")
axes[0].set(xlim=(255.5 - near, 255.5 + near), ylim=(255.5 + near, 255.5 - near), title="raw image and corners")
axes[0].legend(loc="upper right", fontsize=8)
drawn = axes[1].imshow(np.ma.masked_invalid(shot.depth), extent=extent, interpolation="nearest")
axes[1].set_title("depth")
figure.colorbar(drawn, ax=axes[1], label="mm", shrink=0.8)
for ax in axes[:2]:
    ax.set(xlabel="column / pixel", ylabel="row / pixel")
axes[2].plot(error[:, 1], error[:, 0], ".", color="tab:red")
axes[2].plot(mean[1], mean[0], "k+", markersize=14)
axes[2].set(xlabel="columns / pixel", ylabel="rows / pixel", title="detected minus true; +: mean", aspect="equal")
axes[2].grid(alpha=0.3)
figure.savefig(output / "calibration_points.png", dpi=100)

# %%
print("written:", output / "board.exr", output / "calibration_points.png", sep="\n  ")
