"""
What a lens does
================

The questions that a lens design program answers, asked of a double Gauss: where rays go, which surfaces cause
which aberrations, how large spots are, how the field bends, how much light reaches the corners and what contrast
is left. Then the same with one element a little out of place.
"""

# sphinx_gallery_thumbnail_number = 3

# %%
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
RAYS = 2000 if SMALL else 100_000
POINTS = 5 if SMALL else 25

output = Path("output/lens_report")
output.mkdir(parents=True, exist_ok=True)

# %%
# The lens
# --------
#
# ``check`` lists what looks wrong with a prescription: nothing, here. Half of the field of 43.6 degrees is 21.8.

lens = pl.load_lens("double-gauss-100mm-f2")
fields = np.radians([0.0, 10.0, 18.0])
print(pl.paraxial.cardinal_points(lens))
print(lens.check())
lens.layout(fields=fields).figure.savefig(output / "layout.png", dpi=120)

# %%
# Third-order aberrations
# -----------------------
#
# Every surface bends light wrongly by much more than the lens as a whole: they balance each other.

sums = pl.aberrations.seidel_sums(lens, field=fields[-1])
print(sums)
lines = np.linspace(430.0, 700.0, 28)
figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4), width_ratios=(2, 1), layout="constrained")
pl.plots.plot_seidel(sums, left)
pl.plots.plot_chromatic_shift(pl.aberrations.chromatic_shift(lens, wavelengths=lines, reference=lines[16]), right)
figure.savefig(output / "third_order.png", dpi=120)

# %%
# Spots and fans, by exact rays
# -----------------------------
#
# At the best focus on the axis. Each radius comes with its standard error.

focus = pl.aberrations.best_focus(lens, criterion=pl.FocusCriterion.RMS_SPOT)
spots = [
    pl.aberrations.spot_diagram(lens, field=(0.0, field), z_image=focus, wavelength=(486.1, 587.6, 656.3), rays=RAYS)
    for field in fields
]
for field, spot in zip(fields, spots, strict=True):
    print(
        f"{np.degrees(field):4.1f} degrees: RMS radius {1e3 * spot.rms_radius:5.1f} +- "
        f"{1e3 * spot.rms_radius_error:.1f} micrometres, {spot.fraction:.0%} of the iris lit"
    )
pl.plots.plot_spots(spots).savefig(output / "spots.png", dpi=120)
pl.plots.plot_ray_fan(pl.aberrations.ray_fan(lens, field=(0.0, fields[1]))).savefig(output / "fans.png", dpi=120)

# %%
# Over the field
# --------------

field = np.linspace(0.0, fields[-1], POINTS)
figure, axes = plt.subplots(2, 2, figsize=(11, 9), layout="constrained")
pl.plots.plot_field_curvature(pl.aberrations.field_curvature(lens, field), axes[0, 0])
pl.plots.plot_distortion(pl.aberrations.distortion(lens, field), axes[0, 1])
pl.plots.plot_vignetting(pl.aberrations.vignetting(lens, field), axes[1, 0])
pl.plots.plot_relative_illumination(pl.aberrations.relative_illumination(lens, field), axes[1, 1])
figure.savefig(output / "field.png", dpi=120)

# %%
# Contrast, and what a tilted element does to it
# ----------------------------------------------
#
# The geometric modulation transfer function on the axis, of the lens stopped down to f/4 as it is designed and with
# its first element tilted by a quarter of a degree. Diffraction is drawn for comparison and not part of it.

frequencies = np.linspace(0.0, 100.0, 51)
stopped = lens.with_stop(pl.CircularStop(0.5 * lens.stop.semi_diameter))
tilted = stopped.moved(slice(0, 2), tilt=(np.radians(0.25), 0.0, 0.0))
figure, axes = plt.subplots(1, 2, figsize=(11, 4.5), sharey=True, layout="constrained")
for ax, (name, one) in zip(axes, {"as designed": stopped, "first element tilted": tilted}.items(), strict=True):
    best = pl.aberrations.best_focus(one, criterion=pl.FocusCriterion.RMS_SPOT)
    pl.plots.plot_mtf(pl.aberrations.mtf(one, frequencies, z_image=best, rays=RAYS), ax)
    ax.set_title(f"{name}, best focus at z = {best:.3f} mm")
figure.savefig(output / "contrast.png", dpi=120)
print(f"wrote {', '.join(sorted(file.name for file in output.iterdir()))} to {output}")
