"""
Other main lenses
=================

The same lattice of microlenses behind lenses of five kinds that come with the package, each at its full aperture and
focused on the same plane. What a plenoptic camera 1.0 needs to go with a lens is designed from traced rays: microlenses
of its f-number, so that their images fill the sensor. The exit pupil then decides how far apart these lie, how many of
them a sensor holds, and how they are cut off in its corner.
"""

# %%
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
KINDS = ("achromat-100mm-f4.4", "double-gauss-100mm-f2", "telephoto-100mm-f2.8", "topogon-100mm-f6.3")
NAMES = KINDS[:2] if SMALL else (*KINDS, "fisheye-100mm-f8")
SAMPLES = 16 if SMALL else 128
SIDE = 24 if SMALL else 66  # pixels along a crop: three micro images
PIXELS = 2800  # along the sensor of 28 mm

output = Path("output/main_lenses")
output.mkdir(parents=True, exist_ok=True)

# %%
# The cameras
# -----------
#
# Micro images are as wide as the microlens's distance from the sensor over the working f-number of the main lens.
# Here they are to fill 95 % of their distance.


def behind(lens):
    """A plenoptic 1.0 camera with this main lens: focal length and distance of its microlenses are solved for."""
    return pl.design_camera(
        lens,
        sensor=pl.Sensor(shape=(PIXELS, PIXELS), pixel_pitch=0.010),
        kind=pl.CameraKind.PLENOPTIC_1,
        z=-2000.0,
        pitch=0.217,
        semi_diameter=lens.stop.semi_diameter,
        image_fill=0.95,
    ).camera


def apart(camera):
    """Distance of micro images next to the axis, traced, in pixels."""
    centres = pl.microlens_centres(camera, margin=1.0 - camera.sensor.size[0] / 2)
    at = {tuple(index): pixel for index, pixel in zip(centres.index.tolist(), centres.pixel, strict=True)}
    return float(np.linalg.norm(at[1, 0] - at[-1, 0]) / 2)


# %%
# White images
# ------------
#
# On the axis and in the upper left corner of the sensor. A microlens turns what it sees round.

middle = PIXELS // 2 - SIDE // 2
places = {"axis": np.s_[middle : middle + SIDE, middle : middle + SIDE], "corner": np.s_[0:SIDE, 0:SIDE]}
written = []
figure, axes = plt.subplots(
    len(NAMES), 3, figsize=(9.5, 2.7 * len(NAMES)), layout="constrained", width_ratios=(1.6, 1, 1), squeeze=False
)
print("                               microlens   images every / pixels   microlenses    corner over axis")
print("lens                      f/      f / mm   expected     traced        on sensor   iris seen   light")
for (section, *pictures), name in zip(axes, NAMES, strict=True):
    camera = behind(pl.load_lens(name))
    report = camera.report()
    pl.plots.plot_lens(camera.lens, ax=section)
    section.set_title(f"{name}, at f/{report.working_f_number:.1f}", fontsize=10)
    light = {}
    for ax, (place, region) in zip(pictures, places.items(), strict=True):
        white = pl.render_white(camera, samples=SAMPLES, region=region, progress=False)
        written.append(output / f"{name}_{place}.exr")
        white.save(written[-1])
        light[place] = white.image.mean()
        extent = (region[1].start - 0.5, region[1].stop - 0.5, region[0].stop - 0.5, region[0].start - 0.5)
        seen = white.image[:, :, 0] / light["axis"]
        shown = ax.imshow(seen, cmap="gray", extent=extent, vmin=0, vmax=1.3, interpolation="nearest")
        ax.set(title=place, xlabel="column / pixel", ylabel="row / pixel")
    figure.colorbar(shown, ax=pictures, label="light over mean on axis")
    print(
        f"{name:24s} {report.working_f_number:4.1f} {camera.microlenses.focal_length:10.3f} "
        f"{report.image_pitch_pixels:10.3f} {apart(camera):10.3f} {report.microlenses:16d} "
        f"{report.corner_pupil_fraction:11.3f} {light['corner'] / light['axis']:7.3f}"
    )
written.append(output / "main_lenses.png")
figure.savefig(written[-1], dpi=90)

# %%
print("written:", *written, sep="\n  ")
