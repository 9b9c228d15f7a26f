"""
Vortex rings behind a window
============================

Particle image velocimetry as in a water tunnel: a light sheet lights the tracers of a flow, two vortex rings side by
side, and a camera looks at them through a tilted window. The window is a part of the lens, so that rays to the
particles are refracted by Snell's law; the water weakens the light of the sheet, and that of the particles.

Each particle has its weights in the pixels of both exposures. From them follows the truth of such a measurement: the
displacement of each particle and of each pixel, to which the result of a correlation may be compared.
"""

# %%
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
COUNT, RAYS, SIDE = (60, 1 << 12, 128) if SMALL else (3000, 1 << 14, 512)
PROJECTED = 20 if SMALL else 60  # particles that are also projected, with many rays
Z = -404.0  # mm, the middle of the light sheet
FIELD = 0.0125 * SIDE  # mm, half the width of the seeded volume

output = Path("output/vortex_behind_window")
output.mkdir(parents=True, exist_ok=True)

# %%
# A camera before the tank
# ------------------------
#
# 10 mm of glass, 60 mm before the lens, tilted by 10 degrees about the vertical. The sensor is 0.3 mm behind the
# image, so that the images of particles are some pixels wide, as they should be for correlations.

WAVELENGTH = 532.0
lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(8.0))
behind_window = pl.optics.window(
    lens, 10.0, pl.glass("N-BK7"), distance=60.0, tilt=(0.0, np.radians(10.0)), outside=pl.glass("water")
)
camera = pl.PlenopticCamera(
    lens=behind_window,
    sensor=pl.Sensor(shape=(SIDE, SIDE), pixel_pitch=0.010),
    stop_to_microlenses=pl.paraxial.image_position(behind_window, Z) + 0.3,
    wavelength=WAVELENGTH,
)
axis = pl.RayBundle([[0, 0, camera.stop_to_microlenses]], [[0, 0, -1.0]], wavelength=WAVELENGTH)
centre = behind_window.trace_reverse(axis).at_z(Z)[0]
print(f"the window displaces the middle of the field by {np.hypot(*centre[:2]):.1f} mm in the light sheet")

# %%
# The flow
# --------
#
# Both rings travel upwards, along y. Their velocity is that of two circular vortex filaments with cores of 1 mm
# (law of Biot and Savart).

SCALE = SIDE / 512
RADIUS, CORE, CIRCULATION = 2.0 * SCALE, 0.7 * SCALE, 600.0 * SCALE  # mm, mm, mm^2/s
angle = np.linspace(0, 2 * np.pi, 96, endpoint=False)
circle = RADIUS * np.column_stack([np.cos(angle), 0 * angle, -np.sin(angle)])
segment = RADIUS * (2 * np.pi / 96) * np.column_stack([-np.sin(angle), 0 * angle, -np.cos(angle)])


def velocity_at(points):
    """Velocity (n, 3) in mm/s of both rings at points (n, 3)."""
    velocity = np.zeros_like(points)
    for x in (-4.0 * SCALE, 4.0 * SCALE):
        for place, along in zip(circle + centre + [x, 0.0, 0.0], segment, strict=True):
            offset = points - place
            distance = np.sqrt((offset**2).sum(axis=1) + CORE**2)
            velocity += CIRCULATION / (4 * np.pi) * np.cross(along, offset) / distance[:, None] ** 3
    return velocity


# %%
# Two exposures
# -------------
#
# The sheet comes through the wall of the tank 60 mm beside its middle. Particles scatter as their phase function says.

water = pl.materials.pure_water()
green = pl.materials.Medium(absorption=water.absorption[1], scattering=water.scattering[1])
sheet = pl.lights.Sheet(centre, (1, 0, 0), (0, 0, 1), thickness=2.0, irradiance=1e6, divergence=0.005, start=-60.0)
phase = np.array([[0.0, 0.5], [0.5, 0.2], [1.5, 0.03], [np.pi, 0.05]])

rng = np.random.default_rng(7)
positions = centre + rng.uniform((-FIELD, -FIELD, -1.0), (FIELD, FIELD, 1.0), (COUNT, 3))
velocity, interval = velocity_at(positions), 2e-3  # s
first = pl.Points(positions, diameter=0.01, sheet=sheet, phase=phase)
pair = (first, first.moved(velocity, interval))

exposures, weights = [], []
for name, points in zip(("first", "second"), pair, strict=True):
    scene = pl.Scene(points=points, medium=green)
    weights.append(pl.rendering.point_weights(points, camera, scene=scene, rays=RAYS, progress=False))
    image, error = weights[-1].image()
    exposures.append(image[..., 0])
    path = output / f"{name}.exr"
    pl.render(scene, camera, samples=1, progress=False).save(path)
    print("written:", path)
    print(f"{name} exposure: the light has an error of {100 * np.linalg.norm(error) / np.linalg.norm(image):.2f} %")

# %%
# The truth
# ---------
#
# The displacement of a particle is that of the centroid of its light, and the same as of centroids of `project`, which
# knows nothing of weights. Random numbers of a particle are equal in both exposures, so that few rays suffice.

shift = weights[0].displacement(weights[1])
margin = SIDE / 2 - 12
inside = (np.abs([w.centroid - (SIDE - 1) / 2 for w in weights]) < margin).all(axis=(0, 2))
chosen = np.flatnonzero(inside)[:PROJECTED]
seen = [pl.project(camera, points.positions[chosen], rays=1 << 17, progress=False) for points in pair]
difference = shift[chosen] - (seen[1].centroid_pixel - seen[0].centroid_pixel)
length = np.hypot(*shift[inside].T)
print(f"{inside.sum()} particles move by {np.median(length):.2f} pixels, at most {length.max():.2f}")
print(f"weights and projection differ by {np.abs(difference).max():.4f} pixels at most")

# %%
# Both exposures over each other, in orange and blue; the displacement of each pixel, which is the mean over particles
# by their light there; and the difference from the projection.

of_pixels = weights[0].pixel_means(np.nan_to_num(shift))
figure, axes = plt.subplots(1, 3, figsize=(15, 4.8), layout="constrained")
both = np.stack([exposures[0], 0.5 * (exposures[0] + exposures[1]), exposures[1]], axis=-1)
axes[0].imshow(np.clip(both / np.percentile(both, 99), 0, 1))
axes[0].set(title="first (orange) and second (blue) exposure", xlabel="column / pixel", ylabel="row / pixel")
shown = axes[1].imshow(np.hypot(of_pixels[..., 0], of_pixels[..., 1]), cmap="viridis")
figure.colorbar(shown, ax=axes[1], label="displacement / pixel", shrink=0.8)
row, column = weights[0].centroid[inside].T
arrows = slice(None, None, max(1, len(row) // 400))
axes[1].quiver(
    column[arrows],
    row[arrows],
    shift[inside, 1][arrows],
    shift[inside, 0][arrows],
    angles="xy",
    color="tab:red",
    width=3e-3,
)
axes[1].set(title="displacement of pixels and particles", xlabel="column / pixel", ylabel="row / pixel")
bins = np.linspace(-0.01, 0.01, 41)
for k, name in enumerate(("rows", "columns")):
    axes[2].hist(difference[:, k], bins, histtype="step", label=name)
axes[2].locator_params(axis="x", nbins=5)
axes[2].set(title="weights minus projection", xlabel="difference of displacements / pixel", ylabel="particles")
axes[2].legend()
path = output / "vortex_behind_window.png"
figure.savefig(path, dpi=100)
print("written:", path)
