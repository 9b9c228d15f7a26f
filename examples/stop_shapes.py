# %% [markdown]
# # Stop shapes in the white image
#
# Every microlens forms a small picture of what stands before it: the exit pupil of the main lens. In an image
# of an evenly bright scene, the *white image*, each microlens image therefore has the shape of the iris. A
# second stop behind the lens limits the pupil as seen from off the axis, and cuts the microlens images off to
# one side towards the corners of the sensor.

# %%
import dataclasses
import os
from pathlib import Path

import matplotlib

matplotlib.use("Agg")  # pictures go to files; leave this out in a notebook
import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
SAMPLES = 16 if SMALL else 256
SIDE = 24 if SMALL else 88  # pixels along a crop: four microlens images

output = Path("output/stop_shapes")
output.mkdir(parents=True, exist_ok=True)

# %% [markdown]
# ## The camera
#
# The reference camera with microlenses focused at infinity (plenoptic 1.0), which show the stop with sharp
# edges, and a sensor of 30 mm x 30 mm. Only crops of it are rendered.

# %%
lens = pl.load_lens("double-gauss-100mm-f2")
camera = pl.PlenopticCamera(
    lens=lens.with_stop(pl.CircularStop(semi_diameter=4.25)),
    microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,), lattice=pl.Lattice.HEXAGONAL),
    sensor=pl.Sensor(shape=(3000, 3000), pixel_pitch=0.010),
    stop_to_microlenses=123.3,
    microlenses_to_sensor=2.0,
)

# %% [markdown]
# ## Four openings
#
# The corners of a polygonal stop lie on a circle of its semi-diameter, so that it passes less light than the
# round one. The second stop of the last lens stands 0.7 mm behind the last vertex. On the axis its hole of
# 14 mm is wider than the light that passes the iris; seen from the corner of the sensor it is not.

# %%
stops = {
    "circle": camera.lens,
    "12 blades": lens.with_stop(pl.PolygonStop(blades=12, semi_diameter=4.25)),
    "6 blades": lens.with_stop(pl.PolygonStop(blades=6, semi_diameter=4.25)),
    "circle and stop behind": camera.lens.inserted(pl.CircularStop(semi_diameter=7.0), z=31.0),
}
middle = 1500 - SIDE // 2
places = {
    "on the axis": np.s_[middle : middle + SIDE, middle : middle + SIDE],
    "halfway": np.s_[750 : 750 + SIDE, 750 : 750 + SIDE],
    "upper left corner": np.s_[0:SIDE, 0:SIDE],
}

# %%
written = []
figure, axes = plt.subplots(
    len(places), len(stops), figsize=(2.6 * len(stops), 2.75 * len(places)), layout="constrained"
)
for column, (stop_name, stopped_lens) in enumerate(stops.items()):
    stopped = dataclasses.replace(camera, lens=stopped_lens)
    for row, (place_name, region) in enumerate(places.items()):
        white = pl.render_white(stopped, samples=SAMPLES, region=region, progress=False)
        path = output / f"{stop_name}_{place_name}.exr".replace(" ", "_")
        white.save(path)
        written.append(path)
        ax = axes[row, column]
        ax.imshow(white.image[:, :, 0], cmap="gray", vmin=0.0, vmax=0.0145, interpolation="nearest")
        ax.set(xticks=[], yticks=[], title=stop_name if row == 0 else "", ylabel=place_name if column == 0 else "")
        print(f"{stop_name}, {place_name}: mean {white.image.mean():.5f} sr, {white.stats.seconds:.2f} s")
path = output / "stop_shapes.png"
figure.savefig(path, dpi=100)
written.append(path)

# %% [markdown]
# In the corner at the upper left, the second stop hides the outer side of the pupil. A microlens turns what it
# sees round, and the microlens images miss the side that faces the middle of the sensor.

# %%
print("written:", *written, sep="\n  ")
