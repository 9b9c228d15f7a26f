"""
Lenses to choose from
=====================

All lenses that come with the package, in section and true to scale, each with traced rays of three fields: the axis,
and two that it is made for. The page on lenses says where each is from and what it was checked against.
"""

# %%
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
NAMES = pl.lens_names()[:4] if SMALL else pl.lens_names()
COLUMNS = 3

output = Path("output/lens_library")
output.mkdir(parents=True, exist_ok=True)

# %%
# Fields
# ------
#
# Half of the field angle that the lens's source states. A lens from a design file brings its fields along, as its
# `specification`; those of the others are in the titles of their patents and books.

HALF_FIELDS = {
    "achromat-100mm-f4.4": 1.5,
    "double-gauss-100mm-f2": 21.8,
    "double-gauss-105mm-f1.4": 32.0,
    "fisheye-100mm-f8": 85.4,
    "singlet-100mm-f4": 2.0,
    "telephoto-100mm-f2.8": 7.0,
    "topogon-100mm-f6.3": 50.0,
}


def half_field(name, lens):
    """Half of the field angle, in degrees."""
    told = lens.specification
    return HALF_FIELDS[name] if told is None else float(np.degrees(np.abs(told.fields).max()))


# %%
# The table
# ---------
#
# Focal length, f-number and distance of the paraxial image from the last vertex, at the yellow helium line or at the
# wavelength that the lens is made for.

print("lens                          f / mm      f/    image / mm    field / degrees")
lenses = {name: pl.load_lens(name) for name in NAMES}
for name, lens in lenses.items():
    wavelength = 587.5618 if lens.specification is None else lens.specification.wavelengths[0]
    points = pl.paraxial.cardinal_points(lens, wavelength)
    print(f"{name:28} {points.efl:7.2f} {points.f_number:7.2f} {points.bfl:13.3f} {2 * half_field(name, lens):12.0f}")

# %%
# All of them
# -----------
#
# Blue is the axis, green the edge of the field. A lens whose source states no field is drawn on the axis.

rows = -(-len(NAMES) // COLUMNS)
figure, axes = plt.subplots(rows, COLUMNS, figsize=(4.4 * COLUMNS, 2.55 * rows), layout="constrained", squeeze=False)
for ax in axes.flat[len(NAMES) :]:
    ax.set_axis_off()
for ax, (name, lens) in zip(axes.flat, lenses.items(), strict=False):
    angle = half_field(name, lens)
    points = pl.paraxial.cardinal_points(lens)
    # A fan of parallel rays is drawn up to 60 degrees: beyond, it would run beside the lens.
    edge = min(angle, 60.0)
    lens.layout(fields=np.radians([0.0, 0.6 * edge, edge] if edge else [0.0]), rays=5, ax=ax)
    if ax.get_legend() is not None:
        ax.get_legend().remove()
    low, high = ax.get_ylim()
    left, right = ax.get_xlim()
    bar = next(length for length in (200.0, 100.0, 50.0, 20.0, 10.0, 5.0, 2.0) if length < (right - left) / 5)
    ax.plot([left, left + bar], [low, low], color="black", linewidth=2.0, solid_capstyle="butt")
    ax.annotate(f"{bar:g} mm", (left + bar, low), textcoords="offset points", xytext=(4, -3), fontsize=8)
    ax.set_axis_off()
    kind = name.rpartition("-")[0].rpartition("-")[0].replace("-", " ")
    field = f", {2 * angle:.0f}°" if angle else ""
    ax.set_title(f"{kind}: {points.efl:.0f} mm, f/{points.f_number:.1f}{field}", fontsize=10)
figure.savefig(output / "lens_library.png", dpi=70)
print(f"wrote {', '.join(sorted(file.name for file in output.iterdir()))} to {output}")
