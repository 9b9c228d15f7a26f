"""
A lens of one's own, with tolerances
====================================

A prescription from a paper or a patent, the question whether it is typed in correctly, and what it does: layout,
focus, spots, contrast. Then the lens as a workshop builds it, with elements a little out of place: which of them
matters most, how many of a hundred lenses are good enough, and what a bad one does to a raw image.
"""

# %%
import dataclasses
import os
import time
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
LENSES = 12 if SMALL else 200
MANY_RAYS = 16384 if SMALL else 262144
PIXELS, SAMPLES = (96, 32) if SMALL else (288, 256)

output = Path("output/own_lens")
output.mkdir(parents=True, exist_ok=True)

# %%
# The prescription
# ----------------
#
# A Cooke triplet of 50 mm, f/5, for 20 degrees to each side: the numbers are those of the example "Cooke 40 degree
# field" that comes with several lens design programs, with N-SK16, which is made today, in place of SK16. Each surface
# has its radius, the distance to the next one, what is behind it, and its half height; the iris stands in the last gap.
# ``check`` looks for what typing errors lead to. It finds the decimal point that is out of place. A lost sign may make
# another sound lens: the focal length, which every source names, tells that this one is wrong.


def triplet(first_thickness=3.25896, third_radius=-22.21328):
    """The lens by its table."""
    crown, flint = pl.glass("N-SK16"), pl.glass("F2")
    return pl.LensStack(
        [
            pl.Surface(22.01359, first_thickness, crown, semi_diameter=9.5),
            pl.Surface(-435.76044, 6.00755, semi_diameter=9.5),
            pl.Surface(third_radius, 0.99998, flint, semi_diameter=5.0),
            pl.Surface(20.29192, 2.0, semi_diameter=5.0),
            pl.CircularStop(semi_diameter=4.0, thickness=2.75041),
            pl.Surface(79.68360, 2.95208, crown, semi_diameter=7.5),
            pl.Surface(-18.39533, semi_diameter=7.5),
        ],
        name="triplet",
        source="Cooke 40 degree field",
    )


lens = triplet()
typed = {
    "as it is": lens,
    "a decimal point out of place": triplet(first_thickness=0.325896),
    "a sign lost": triplet(third_radius=22.21328),
}
for title, one in typed.items():
    print(f"{title}: f = {pl.paraxial.cardinal_points(one).efl:.3f} mm")
    print(*(f"  {finding}" for finding in one.check() or ("nothing looks wrong",)), sep="\n")

# %%
# The same from a file
# --------------------
#
# The simplest file is a table with semicolons: an empty radius between two gaps of air is the iris. JSON keeps all
# (``pl.save_lens``), and ZMX files are read too.

table = """radius;thickness;material;index;v-no;sa
22.01359;3.25896;N-SK16;;;9.5
-435.76044;6.00755;air;;;9.5
-22.21328;0.99998;F2;;;5
20.29192;2.0;air;;;5
;2.75041;air;;;4
79.68360;2.95208;N-SK16;;;7.5
-18.39533;0;air;;;7.5
"""
(output / "triplet.csv").write_text(table)
loaded = pl.load_lens(output / "triplet.csv")
pl.save_lens(loaded, output / "triplet.json")
print("the same surfaces from the table and from JSON:", loaded.elements == lens.elements,
      pl.load_lens(output / "triplet.json").elements == lens.elements)  # fmt: skip

# %%
# What it does
# ------------
#
# Rays, focus and spots. The focus of exact rays lies nearer to the lens than that of Gaussian optics, which knows no
# spherical aberration. The disk of Airy, 1.22 wavelength f-number, is smaller than these spots: geometry rules here.

fields = np.radians([0.0, 10.0, 18.0])
points = pl.paraxial.cardinal_points(lens)
focus = pl.aberrations.best_focus(lens, criterion=pl.FocusCriterion.RMS_SPOT)
print(f"f = {points.efl:.3f} mm, f/{points.f_number:.2f}; focus by Gaussian optics {points.rear_focus:.3f} mm behind "
      f"the iris, smallest spot {focus:.3f} mm")  # fmt: skip

figure, ax = plt.subplots(figsize=(9, 4.2), layout="constrained")
lens.layout(fields=fields, z_image=focus, ax=ax)
figure.savefig(output / "layout.png", dpi=120)

# %%
colours = (486.1, 587.6, 656.3)
spots = [
    pl.aberrations.spot_diagram(lens, field=(0.0, field), z_image=focus, wavelength=colours, rays=4096)
    for field in fields
]
for field, spot in zip(fields, spots, strict=True):
    print(f"{np.degrees(field):3.0f} degrees: RMS radius {1e3 * spot.rms_radius:5.1f} +- "
          f"{1e3 * spot.rms_radius_error:.1f} um; disk of Airy {1e3 * spot.airy_radius:.1f} um")  # fmt: skip
figure = pl.plots.plot_spots(spots, airy=True)
figure.savefig(output / "spots.png", dpi=120)

# %%
# How many rays?
# --------------
#
# A thousand lenses will be traced: a spot must be as cheap as it can be. Its RMS radius comes with a standard error;
# beside it stands how far it is from one with very many rays.

reference = pl.aberrations.spot_diagram(lens, field=(0.0, fields[1]), z_image=focus, rays=MANY_RAYS, seed=99)
print("    rays   RMS radius / um   reported error   true error      ms")
rows = []
for rays in (64, 256, 1024, 4096, 16384):
    begin = time.perf_counter()
    spot = pl.aberrations.spot_diagram(lens, field=(0.0, fields[1]), z_image=focus, rays=rays)
    rows.append((spot.rms_radius_error, abs(spot.rms_radius - reference.rms_radius), time.perf_counter() - begin))
    reported, true, seconds = rows[-1]
    print(f"{rays:8d} {1e3 * spot.rms_radius:17.3f} {1e3 * reported:16.4f} {1e3 * true:12.4f} {1e3 * seconds:7.1f}")
RAYS = 1024

# %%
# Which element matters most
# --------------------------
#
# Each element by itself is moved by what a workshop may be good for: 20 um across the axis, 20 um along it, 1 minute of
# arc. After each the focus is found again, as one does when the sensor is mounted. Without errors a spot on the axis
# is round; by symmetry its mean square then grows with the square of a decentre, and the shares of independent errors
# add. (Along the axis the mean of both directions is what counts: what is better in one is worse in the other.)

SHIFT, ALONG, TILT = 0.020, 0.020, np.radians(1 / 60)
BATCH = [
    ("decentred", (SHIFT, 0, 0), (0, 0, 0)),
    ("shifted", (0, 0, ALONG), (0, 0, 0)),
    ("tilted", (0,) * 3, (TILT, 0, 0)),
]


def at_focus(one, rays=RAYS):
    """Mean squared radius of the spots on the axis and at 10 degrees (up, down, left, right), mm^2, in best focus."""
    z = pl.aberrations.best_focus(one, criterion=pl.FocusCriterion.RMS_SPOT, rays=rays)
    around = fields[1] * np.array([(0, 0), (0, 1), (0, -1), (1, 0), (-1, 0)])
    return np.array([pl.aberrations.spot_diagram(one, field=f, z_image=z, rays=rays).rms_radius ** 2 for f in around])


def moved(one, number, shift, tilt):
    """The lens with one of its elements out of place, turned about the middle of its glass."""
    first, last = one.glasses[number]
    return one.moved(slice(first, last + 1), shift=shift, tilt=tilt, pivot=one.vertices[[first, last]].mean())


nominal = at_focus(lens)
growth = np.zeros((3, 3))
print(
    f"RMS radius as designed: {1e3 * np.sqrt(nominal[0]):.2f} um on the axis\n"
    "            growth of the mean square / um^2"
)
for number in range(3):
    for kind, (_, shift, tilt) in enumerate(BATCH):
        both = [at_focus(moved(lens, number, s * np.array(shift), s * np.array(tilt))) for s in (1, -1)]
        growth[number, kind] = (np.mean(both, axis=0) - nominal)[0]
    print(
        f"element {number + 1}  "
        + "  ".join(f"{name} {1e6 * g:6.2f}" for (name, *_), g in zip(BATCH, growth[number], strict=True))
    )

figure, ax = plt.subplots(figsize=(6.6, 3.8), layout="constrained")
for kind, (name, *_) in enumerate(BATCH):
    ax.bar(np.arange(3) + 0.27 * (kind - 1), 1e6 * growth[:, kind], width=0.25, label=name)
ax.axhline(0, color="0.3", linewidth=0.8)
ax.set(xticks=range(3), xticklabels=["front", "middle", "rear"], xlabel="element", ylabel="growth / um$^2$",
       title="What one error does to the mean squared radius on the axis")  # fmt: skip
ax.legend(title="20 um, 20 um, 1 minute of arc")
ax.grid(axis="y", alpha=0.3)
figure.savefig(output / "sensitivity.png", dpi=120)

# %%
# A batch of lenses
# -----------------
#
# All errors at once, normal with these standard deviations, across the axis in both directions. The mean of the squared
# radius on the axis should be that of the design plus the sum of the shares, those across the axis twice.

random = np.random.default_rng(2)
built, squares, begin = [], [], time.perf_counter()
for _ in range(LENSES):
    one = lens
    for number in range(3):
        shift, turn = random.normal(size=3) * (SHIFT, SHIFT, ALONG), random.normal(size=2) * TILT
        one = moved(one, number, shift, (*turn, 0.0))
    built.append(one)
    squares.append(at_focus(one))
squares = np.array(squares)
seconds = time.perf_counter() - begin
expected = nominal[0] + (2 * growth[:, 0] + growth[:, 1] + 2 * growth[:, 2]).sum()
mean, error = squares[:, 0].mean(), squares[:, 0].std(ddof=1) / np.sqrt(LENSES)
print(f"{LENSES} lenses in {seconds:.1f} s, {1e3 * seconds / LENSES:.0f} ms each")
print(
    f"mean squared radius on the axis: {1e6 * mean:.1f} +- {1e6 * error:.1f} um^2, "
    f"by the shares {1e6 * expected:.1f} um^2"
)

radius = 1e3 * np.sqrt(squares)
worst = int(np.argmax(radius[:, 1:].max(axis=1)))
figure, ax = plt.subplots(figsize=(6.6, 4), layout="constrained")
for values, at_design, name in (
    (radius[:, 0], nominal[0], "on the axis"),
    (radius[:, 1:].max(axis=1), nominal[1], "worst of four places at 10 degrees"),
):
    (line,) = ax.step(np.sort(values), 100 * (np.arange(LENSES) + 1) / LENSES, where="post", label=name)
    ax.axvline(1e3 * np.sqrt(at_design), color=line.get_color(), linestyle=":", linewidth=1)
ax.set(xlabel="RMS radius of the spot / um; dotted: as designed", ylabel="lenses that are as good / %",
       title=f"Yield of {LENSES} lenses", ylim=(0, 100))  # fmt: skip
ax.legend(loc="lower right")
ax.grid(alpha=0.3)
figure.savefig(output / "yield.png", dpi=120)

# %%
# Contrast, as designed and of the worst one
# ------------------------------------------

frequencies = np.linspace(0, 100, 51)
figure, axes = plt.subplots(1, 2, figsize=(10.5, 4), sharey=True, layout="constrained")
for ax, one, title in zip(axes, (lens, built[worst]), ("as designed", f"the worst of {LENSES}"), strict=True):
    z = pl.aberrations.best_focus(one, criterion=pl.FocusCriterion.RMS_SPOT)
    curves = [pl.aberrations.mtf(one, frequencies, field=(0.0, f), z_image=z, rays=4096) for f in fields[:2]]
    pl.plots.plot_mtf(curves, ax)
    ax.set_title(title)
figure.savefig(output / "contrast.png", dpi=120)

# %%
# What it does to a raw image
# ---------------------------
#
# The lens in a focused plenoptic camera before a board of squares, and the same camera with the worst lens, its focus
# found again. Elements out of place move the image, by which the micro images see other parts of the board, and
# the exit pupil, by which they stand elsewhere on the sensor: hardly, here. A pixel of the raw image then shows another
# part of the scene, so that a calibration belongs to one lens, not to its design. Places in micro images are linear
# in those of the microlenses, c + (x' - c) b / a, which gives the place x' of the main lens's image; the chief ray
# gives it, too, and the difference is the coma of decentred elements.

camera = pl.design_camera(
    lens,
    sensor=pl.Sensor((PIXELS, PIXELS), 0.005),
    kind=pl.CameraKind.GALILEAN,
    z=-500.0,
    pitch=0.1,
    focal_length=0.7,
    virtual_depth=4.0,
    image_fill=0.95,
).camera
bad_lens = built[worst].with_stop(camera.lens.stop)
image, bad_image = (pl.aberrations.best_focus(one, z_object=-500.0) for one in (camera.lens, bad_lens))
bad = dataclasses.replace(camera, lens=bad_lens, stop_to_microlenses=camera.stop_to_microlenses + bad_image - image)
board = pl.targets.checkerboard(12, 12, square=1.6, dark=pl.Emissive(0.1), bright=pl.Emissive(1.0)).translated(z=-500)
scene = pl.Scene(board.meshes, background=0.4)
shots = [pl.render(scene, one, samples=SAMPLES, seed=3, progress=False) for one in (camera, bad)]
designed, as_built = (pl.microlens_centres(one) for one in (camera, bad))
move = (as_built.pixel - designed.pixel).mean(axis=0)
seen = bad.project((0.0, 0.0, -500.0))
seen = seen.selected(seen.passes)
lattice = seen.index @ camera.microlenses.basis
chief = pl.aberrations.spot_diagram(bad_lens, z_object=-500.0, z_image=bad_image).chief  # designed: on the axis
straight, *_ = np.linalg.lstsq(np.column_stack([lattice, np.ones(len(lattice))]), seen.position, rcond=None)
placed = straight[2] / (1 - straight[[0, 1], [0, 1]])
print(f"f/{pl.paraxial.cardinal_points(camera.lens).f_number:.1f}, {len(designed)} micro images; they move by "
      f"{move[0]:+.2f} rows and {move[1]:+.2f} columns")  # fmt: skip
print(f"its sensor and array stand {1e3 * (bad_image - image):+.0f} um farther back, where the focus is")
print(f"the image of the middle of the board, which was on the axis, is at {np.round(1e3 * chief).ravel()} um by the "
      f"chief ray and at {np.round(1e3 * placed).ravel()} um by the {len(lattice)} microlenses")  # fmt: skip
difference = (shots[1].image - shots[0].image)[:, :, 0]
noise = np.hypot(shots[0].standard_error, shots[1].standard_error)[:, :, 0]
print(f"raw images differ by {np.sqrt(np.mean(difference**2)) / shots[0].image.mean():.1%} of the mean, RMS; "
      f"noise of the rendering {np.sqrt(np.mean(noise**2)) / shots[0].image.mean():.1%}")  # fmt: skip

figure, axes = plt.subplots(1, 3, figsize=(12.4, 4), layout="constrained", sharex=True, sharey=True)
top = np.percentile(shots[0].image, 99.8)
for ax, shot, title in zip(axes, shots, ("lens as designed", "lens as built"), strict=False):
    grey = ax.imshow(shot.image[:, :, 0] / top, cmap="gray", vmin=0, vmax=1, interpolation="nearest")
    ax.set(title=title, xlabel="column / pixel")
figure.colorbar(grey, ax=axes[:2], label="brightness / full")
shown = axes[2].imshow(difference / top, cmap="RdBu", vmin=-0.5, vmax=0.5, interpolation="nearest")
figure.colorbar(shown, ax=axes[2], label="brightness / full")
axes[2].set(title="built minus designed", xlabel="column / pixel")
axes[0].set(ylabel="row / pixel", xlim=(PIXELS / 2 - 48, PIXELS / 2 + 48), ylim=(PIXELS / 2 + 48, PIXELS / 2 - 48))
figure.savefig(output / "raw_images.png", dpi=120)
print("written:", *sorted(path for path in output.iterdir()), sep="\n  ")
