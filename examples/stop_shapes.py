"""
Stop shapes in the white image
==============================

Every microlens forms a small picture of what stands before it: the exit pupil of the main lens. In an image
of an evenly bright scene, the *white image*, each micro image therefore has the shape of the iris. A
second stop behind the lens limits the pupil as seen from off the axis, and cuts the micro images off to
one side towards the corners of the sensor. T. Michels et al., "Simulation of Plenoptic Cameras" (2018) show this for
12 blades, 6 blades and a star.
"""

# %%
import dataclasses
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
SAMPLES = 16 if SMALL else 256
SIDE = 24 if SMALL else 88  # pixels along a crop: four micro images

output = Path("output/stop_shapes")
output.mkdir(parents=True, exist_ok=True)

# %%
# The camera
# ----------
#
# The reference camera with microlenses focused at infinity (plenoptic 1.0), which show the stop with sharp
# edges, and a sensor of 30 mm x 30 mm. Only crops of it are rendered.

lens = pl.load_lens("double-gauss-100mm-f2")
camera = pl.PlenopticCamera(
    lens=lens.with_stop(pl.CircularStop(semi_diameter=4.25)),
    microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,), lattice=pl.Lattice.HEXAGONAL),
    sensor=pl.Sensor(shape=(3000, 3000), pixel_pitch=0.010),
    stop_to_microlenses=123.3,
    microlenses_to_sensor=2.0,
)

# %%
# Openings
# --------
#
# The corners of a polygonal stop, and the tips of a star, lie on a circle of its semi-diameter, so that they pass less
# light than the round one. The second stop stands 0.7 mm behind the last vertex. On the axis its hole of 14 mm is wider
# than the light that passes the iris; seen from the corner of the sensor it is not.

irises = {
    "circle": camera.lens.stop,
    "12 blades": pl.PolygonStop(blades=12, semi_diameter=4.25),
    "6 blades": pl.PolygonStop(blades=6, semi_diameter=4.25),
    "star": pl.StarStop(points=5, semi_diameter=4.25, inner_semi_diameter=1.7, rotation=np.pi / 2),
}
stops = {"circle, nothing behind": camera.lens} | {
    name: lens.with_stop(iris).inserted(pl.CircularStop(semi_diameter=7.0), z=31.0) for name, iris in irises.items()
}
middle = 1500 - SIDE // 2
places = {
    "on the axis": np.s_[middle : middle + SIDE, middle : middle + SIDE],
    "halfway": np.s_[750 : 750 + SIDE, 750 : 750 + SIDE],
    "upper left corner": np.s_[0:SIDE, 0:SIDE],
}

# %%
written, mean = [], {}
figure, axes = plt.subplots(len(places), len(stops), figsize=(13, 8.2), layout="constrained")
for column, (stop_name, stopped_lens) in enumerate(stops.items()):
    stopped = dataclasses.replace(camera, lens=stopped_lens)
    for row, (place_name, region) in enumerate(places.items()):
        white = pl.render_white(stopped, samples=SAMPLES, region=region, progress=False)
        path = output / f"{stop_name}_{place_name}.exr".replace(",", "").replace(" ", "_")
        white.save(path)
        written.append(path)
        mean[stop_name, place_name] = white.image.mean()
        ax = axes[row, column]
        extent = (region[1].start - 0.5, region[1].stop - 0.5, region[0].stop - 0.5, region[0].start - 0.5)
        image = white.image[:, :, 0]
        shown = ax.imshow(image, cmap="gray", vmin=0.0, vmax=0.012, extent=extent, interpolation="nearest")
        ax.set_title(stop_name if row == 0 else "")
        ax.set_xlabel("column / pixel" if row == len(places) - 1 else "")
        ax.set_ylabel(f"{place_name}\nrow / pixel" if column == 0 else "")
        ax.tick_params(labelleft=column == 0)
figure.colorbar(shown, ax=axes, label="white image / sr", shrink=0.5)
path = output / "stop_shapes.png"
figure.savefig(path, dpi=100)
written.append(path)

# %%
# Light
# -----
#
# On the axis all light of the iris arrives, in proportion to its area; the crop holds parts of micro images, which
# makes its mean differ a little.

print("                         over that of the open circle: area, light on the axis, halfway, in the corner")
for name in stops:
    area = irises.get(name, camera.lens.stop).area / camera.lens.stop.area
    light = [mean[name, place] / mean["circle, nothing behind", place] for place in places]
    print(f"{name:24s} {area:42.3f}" + "".join(f" {share:14.3f}" for share in light))

# %%
# In the corner at the upper left, the second stop hides the outer side of the pupil. A microlens turns what it
# sees round, and the micro images miss the side that faces the middle of the sensor.

print("written:", *written, sep="\n  ")
