"""
Calibration with exact corners
==============================

Programs that calibrate plenoptic cameras find the corners of boards and the centres of micro images, and fit a
model to them. How good they are is hard to say of a real camera, whose truth nobody knows. Here it is known: where
each corner lies in each micro image, where each micro image has its centre, and how far every part is out of
place. A model with pinholes is fitted to corners as a detector would find them, and judged.
"""

# %%
import os
import time
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
SIDE, SAMPLES = (96, 16) if SMALL else (144, 256)  # of the rendered crop
BOARDS = 5 if SMALL else 11
CORNERS = 5 if SMALL else 9  # along a board

output = Path("output/calibration")
output.mkdir(parents=True, exist_ok=True)

# %%
# Designed and built
# ------------------
#
# The camera to be calibrated is not the one that was designed: its array has slipped by some hundredths of a
# millimetre, is turned by 4 mrad and tilted by 2 mrad.

design = pl.PlenopticCamera(
    lens=pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=5.0)),
    microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)),
    sensor=pl.Sensor(shape=(2000, 2000), pixel_pitch=0.010),
    stop_to_microlenses=123.3,
    microlenses_to_sensor=1.7,
)
SLIP, TILT, TURN = (0.03, -0.02), 0.002, 0.004
camera = design.moved(pl.CameraPart.MICROLENSES, shift=(*SLIP, 0.0), tilt=(TILT, 0.0, TURN))
print(pl.camera.as_built(camera))

# %%
# Where corners are
# -----------------
#
# ``camera.project`` traces the chief ray of each corner through the main lens and each microlens that sees it: to
# within 1e-9 mm, and without a picture. The crosses in the rendered one are not detected, they are true.

board = pl.targets.checkerboard(CORNERS + 1, CORNERS + 1, square=2.0, dark=pl.Emissive(0.1), bright=pl.Emissive(1.0))
board = board.rotated_deg((0, 0, 1), 10).rotated_deg((0, 1, 0), 25).translated(z=-404)
first = 1000 - SIDE // 2
crop = np.s_[first : first + SIDE, first : first + SIDE]
shot = pl.render(pl.Scene(board.meshes, background=0.4), camera, samples=SAMPLES, region=crop, progress=False)
begin = time.perf_counter()
seen = camera.project(board.points)
print(f"{len(board.points)} corners, {len(seen)} places in micro images, {time.perf_counter() - begin:.2f} s; "
      f"the picture took {shot.stats.seconds:.1f} s")  # fmt: skip

figure, ax = plt.subplots(figsize=(7, 6.4), layout="constrained")
extent = (first - 0.5, first + SIDE - 0.5, first + SIDE - 0.5, first - 0.5)
ax.imshow(shot.image[:, :, 0], cmap="gray", extent=extent, interpolation="nearest")
ax.scatter(*seen.pixel[seen.visible].T[::-1], c=seen.point[seen.visible], cmap="prism", marker="+", s=40)
ax.set(xlim=extent[:2], ylim=extent[2:], xlabel="column / pixel", ylabel="row / pixel")
ax.set_title("Corners of a board in micro images; a colour for each corner")
figure.savefig(output / "corners.png", dpi=120)

# %%
# Where micro images are
# --------------------------
#
# A microlens's image does not lie straight behind it: the ray from the middle of the exit pupil goes on by the distance
# b to the sensor, so that a centre at the height y on the array lies at y (1 + b / D), D from the pupil to the array.
# Decoders that divide the sensor into cells must know this stretch. And the built array shows in the centres: its
# slip and its turn directly, its tilt as a change of the stretch across the field.

report = design.report()
straight, chief = (
    pl.microlens_centres(design, method) for method in (pl.CentreMethod.ORTHOGONAL, pl.CentreMethod.CHIEF_RAY)
)
rows = {tuple(index): place for index, place in zip(straight.index.tolist(), straight.position, strict=True)}
pairs = np.array(
    [(rows[tuple(i)], p) for i, p in zip(chief.index.tolist(), chief.position, strict=True) if tuple(i) in rows]
)
stretch = (pairs[:, 1] * pairs[:, 0]).sum() / (pairs[:, 0] ** 2).sum() - 1
print(f"stretch of the centres {stretch:.6f}, b / D = {design.microlenses_to_sensor / report.exit_pupil_distance:.6f}")


def quadratic(index):
    """Columns for the fit of a centre: lattice place, its constant, linear and quadratic terms."""
    x, y = (index @ design.microlenses.basis).T
    return np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])


centres = pl.microlens_centres(camera)
measured = centres.position + 0.05 * design.sensor.pixel_pitch * np.random.default_rng(1).normal(
    size=(len(centres.index), 2)
)
columns = quadratic(centres.index)
fit, *_ = np.linalg.lstsq(columns, measured, rcond=None)
weight = np.linalg.inv(columns.T @ columns)
sigma = 0.05 * design.sensor.pixel_pitch * np.sqrt(np.diag(weight))
turn, turn_error = 0.5 * (fit[1, 1] - fit[2, 0]) / (1 + stretch), sigma[1] / np.sqrt(2)
# The array is turned about x: at the height y it is nearer to the sensor by y TILT, where the ray has the slope y / D.
tilt, tilt_error = -fit[5, 1] * report.exit_pupil_distance, sigma[5] * report.exit_pupil_distance
print("from centres known to 0.05 pixels:   found                true")
for name, found, error, true in (
    ("slip along x / um", 1e3 * fit[0, 0], 1e3 * sigma[0], 1e3 * SLIP[0] * (1 + stretch)),
    ("slip along y / um", 1e3 * fit[0, 1], 1e3 * sigma[0], 1e3 * SLIP[1] * (1 + stretch)),
    ("turn / mrad", 1e3 * turn, 1e3 * turn_error, 1e3 * TURN),
    ("tilt about x / mrad", 1e3 * tilt, 1e3 * tilt_error, 1e3 * TILT),
):
    print(f"  {name:24s} {found:14.3f} +- {error:.3f} {true:12.3f}")

here = {tuple(i): p for i, p in zip(chief.index.tolist(), chief.pixel, strict=True)}
kept = [k for k, i in enumerate(centres.index.tolist()) if tuple(i) in here]
moves = np.array([centres.pixel[k] - here[tuple(centres.index[k].tolist())] for k in kept])
figure, ax = plt.subplots(figsize=(6.2, 5.6), layout="constrained")
some = np.random.default_rng(0).choice(len(kept), min(500, len(kept)), replace=False)
place = centres.pixel[kept]
length = np.hypot(*moves.T)
arrows = ax.quiver(*place[some].T[::-1], moves[some, 1], moves[some, 0], length[some], angles="xy", cmap="viridis")
figure.colorbar(arrows, label="pixels")
ax.set(xlabel="column / pixel", ylabel="row / pixel", xlim=(0, 2000), ylim=(2000, 0), aspect="equal")
ax.set_title("How the micro images of the built camera have moved")
figure.savefig(output / "centres.png", dpi=120)

# %%
# A model of pinholes
# -------------------
#
# The usual model: the main lens is thin, with a focal length f, its principal planes at h and L before the array; the
# microlenses are pinholes on a lattice that has slipped and turned; the sensor is at b behind them. A point X at Z
# comes to lie at s' with 1/s' = 1/f - 1/s, s = h - Z, at x' = -X s'/s, and through a pinhole at c at
# c + (x' - c) b / a on the sensor, a = s' - L. Boards stand in known places, corners are detected to 0.1 pixels; those
# are the numbers of a good detector and of a good stage. Seven parameters, Gauss-Newton with differences.

NOISE = 0.1 * design.sensor.pixel_pitch
NAMES = ("f / mm", "h / mm", "L / mm", "b / mm", "slip x / mm", "slip y / mm", "turn / rad")


def modelled(p, world, lattice):
    """Places on the sensor by the model of pinholes."""
    f, h, length, b, *slip, turn = p[:7]
    s = h - world[:, 2]
    image = 1 / (1 / f - 1 / s)
    across = -world[:, :2] * (image / s)[:, np.newaxis]
    behind = image - length
    if len(p) > 7:  # and of what an aberrated lens does in the lowest order
        square = (across**2).sum(axis=1)
        across, behind = across * (1 + p[7] * square)[:, np.newaxis], behind + p[8] * square
    if len(p) > 9:  # and of a tilted array
        behind, b = behind + p[9] * across[:, 1], b + p[9] * lattice[:, 1:]
    pinhole = lattice @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]) + slip
    return pinhole + (across - pinhole) * b / behind[:, np.newaxis]


def jacobian(p, world, lattice):
    """Derivatives of all places by the parameters, by central differences."""
    steps = np.maximum(np.abs(p), 1e-2) * 1e-5
    ways = [(modelled(p + d, world, lattice) - modelled(p - d, world, lattice)).ravel() for d in np.diag(steps)]
    return np.stack(ways, axis=1) / (2 * steps)


def fitted(start, world, lattice, places):
    """Parameters, and their covariance for the detector's noise."""
    p = np.array(start)
    for _ in range(12):
        slope = jacobian(p, world, lattice)
        scale = np.linalg.norm(slope, axis=0)
        step, *_ = np.linalg.lstsq(slope / scale, (places - modelled(p, world, lattice)).ravel(), rcond=None)
        p += step / scale
    scaled = slope / scale
    return p, NOISE**2 * np.linalg.inv(scaled.T @ scaled) / np.outer(scale, scale), np.linalg.cond(scaled)


begin = time.perf_counter()
random = np.random.default_rng(7)
flat = pl.targets.checkerboard(CORNERS + 1, CORNERS + 1, square=56 / (CORNERS + 1))
boards = [
    flat.rotated_deg((1, 0, 0), random.uniform(-25, 25)).rotated_deg((0, 1, 0), random.uniform(-25, 25)).translated(z=z)
    for z in np.linspace(-375, -440, BOARDS)
]
everything = [camera.project(one.points, progress=False) for one in boards]
everything = [one.selected(one.visible & one.passes) for one in everything]
world = np.concatenate([one.points[one.point] for one in everything])
lattice = np.concatenate([one.index @ design.microlenses.basis for one in everything])
exact = np.concatenate([one.position for one in everything])
detected = exact + NOISE * random.normal(size=exact.shape)
gauss = pl.paraxial.cardinal_points(design.lens)
true = np.array(
    [gauss.efl, gauss.front_principal, 123.3 - gauss.rear_principal, design.microlenses_to_sensor, *SLIP, TURN]
)
print(f"{BOARDS} boards, {len(exact)} places of corners, exact, in {time.perf_counter() - begin:.1f} s")

START = np.array([105.0, 5.0, 130.0, 1.5, 0.0, 0.0, 0.0])  # from a data sheet
found, covariance, condition = fitted(START, world, lattice, detected)
print(f"condition of the problem, columns scaled: {condition:.0f}")
print("               Gaussian optics      found   by noise   off by noise times")
for name, t, p, e in zip(NAMES, true, found, np.sqrt(np.diag(covariance)), strict=True):
    print(f"  {name:12s} {t:15.5f} {p:10.5f} {e:10.5f} {(p - t) / e:15.1f}")

# %%
# What the model leaves
# ---------------------
#
# If the model were right, parameters were off by once or twice what noise does, and exact corners would fit exactly.
# It is not, and parameters bend to make up for what it lacks: the slip along y takes over what the tilt does. A rest
# below the noise of the detector hides that. Parameters for distortion and a curved field help less than one for
# the tilt. What stays is seen within each corner: microlenses look through other parts of the pupil, which the
# spherical aberration of the main lens sends elsewhere. No model with a thin main lens has that.

rest = {}
for title, more in {"pinholes": 0, "and distortion, curved field": 2, "and tilt": 3}.items():
    p, *_ = fitted(np.concatenate([START, np.zeros(more)]), world, lattice, detected)
    rest[title] = (modelled(p, world, lattice) - exact) / design.sensor.pixel_pitch, p
    off = rest[title][0]
    print(f"{title:30s} {7 + more:3d} parameters, exact corners off by {np.sqrt((off**2).mean()):.4f} pixels RMS, "
          f"at most {np.abs(off).max():.3f}")  # fmt: skip

number = np.concatenate([one.point + 1000 * k for k, one in enumerate(everything)])
corners, corner, times = np.unique(number, return_inverse=True, return_counts=True)


def of_corners(values):
    """Means over the microlenses that see a corner."""
    return np.stack([np.bincount(corner, v) / times for v in values.T], axis=1)


at = of_corners(exact) / design.sensor.pixel_pitch
figure, axes = plt.subplots(1, 3, figsize=(12.6, 5.2), sharex=True, sharey=True, layout="constrained")
for ax, (title, (off, _)) in zip(axes, rest.items(), strict=True):
    mean = of_corners(off)
    within = np.sqrt(((off - mean[corner]) ** 2).mean())
    arrows = ax.quiver(999.5 - at[:, 0], 999.5 + at[:, 1], -mean[:, 0], mean[:, 1], angles="xy", scale=6e-4,
                       scale_units="xy", width=0.003, color="tab:blue")  # fmt: skip
    ax.quiverkey(arrows, 0.72, 0.05, 0.1, "0.1 pixel", labelpos="E")
    ax.set(title=f"{title}\nwithin a corner {within:.3f} pixels RMS", xlabel="column / pixel", aspect="equal",
           xlim=(0, 2000), ylim=(2000, 0))  # fmt: skip
axes[0].set_ylabel("row / pixel")
figure.suptitle("Model minus exact place, mean of the microlenses that see a corner")
figure.savefig(output / "rest.png", dpi=120)

# %%
# What that does to depth
# -----------------------
#
# A calibrated camera measures depth by how a point moves from one micro image to the next:
# its places are linear in c with the slope 1 - b / a, which gives a, s' and the distance. Exact places, put
# into the fitted models, show the error in depth that no better detector can remove: up to a millimetre of 400, which
# the tilt fans out with the distance from the axis.


def measured_depth(p, point):
    """Depth of a corner by least squares over the micro images that show it."""
    a = np.column_stack([lattice[point], np.ones(point.sum())])
    centred = a - a.mean(axis=0)
    turned = centred[:, :2] @ np.array([[np.cos(p[6]), np.sin(p[6])], [-np.sin(p[6]), np.cos(p[6])]])
    slope = (turned * (exact[point] - exact[point].mean(axis=0))).sum() / (turned**2).sum()
    behind, length = p[3] / (1 - slope), p[2]
    if len(p) > 7:
        where = exact[point].mean(axis=0)  # the image itself lies near the middle of the microlenses that see it
        behind -= p[8] * (where @ where)
    return 1 / (1 / p[0] - 1 / (behind + length)) - p[1]


several = corners[times >= 6]
truth = np.array([-world[number == n][0, 2] for n in several])
radius = np.hypot(*of_corners(exact)[times >= 6].T)
figure, ax = plt.subplots(figsize=(6.8, 4), layout="constrained")
for title in list(rest)[:2]:
    off = np.array([measured_depth(rest[title][1], number == n) for n in several]) - truth
    ax.plot(radius, off, ".", label=f"{title}: {off.std():.2f} mm RMS", alpha=0.6)
    print(f"{title}: depth off by {off.mean():+.2f} mm in the mean, {off.std():.2f} mm RMS")
ax.axhline(0, color="0.3", linewidth=0.8)
ax.set(
    xlabel="distance of the corner from the axis, on the sensor / mm",
    ylabel="measured minus true / mm",
    title="Depth by the fitted models",
)
ax.legend()
ax.grid(alpha=0.3)
figure.savefig(output / "depth.png", dpi=120)

# %%
# More corners, or a better model?
# --------------------------------
#
# Noise falls with the root of the number of corners; what the model lacks stays. Eight calibrations each, with fewer
# and with more of the places: where the lines leave the slope, more boards buy nothing.

counts = [n for n in (20, 80, 320, 1280, 5120) if n <= len(exact)]
errors = {"pinholes": [], "and distortion, curved field": []}
for count in counts:
    for title, more in (("pinholes", 0), ("and distortion, curved field", 2)):
        off = []
        for _ in range(2 if SMALL else 8):
            rows = random.choice(len(exact), count, replace=False)
            noisy = exact[rows] + NOISE * random.normal(size=(count, 2))
            p, *_ = fitted(np.concatenate([found, np.zeros(more)]), world[rows], lattice[rows], noisy)
            off.append(modelled(p, world, lattice) - exact)
        errors[title].append(np.sqrt(np.mean(np.square(off))) / design.sensor.pixel_pitch)
figure, ax = plt.subplots(figsize=(6.4, 4), layout="constrained")
for title, line in errors.items():
    ax.loglog(counts, line, "o-", label=title)
ax.loglog(
    counts, errors["pinholes"][0] * np.sqrt(counts[0] / np.array(counts)), ":", color="0.5", label="noise alone: -1/2"
)
for axis in (ax.xaxis, ax.yaxis):
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter("{x:g}" if axis is ax.yaxis else "")
ax.set(xlabel="places of corners", ylabel="RMS error of the calibrated model / pixel", title="Noise, and what stays")
ax.legend()
ax.grid(alpha=0.3, which="both")
figure.savefig(output / "noise_and_model.png", dpi=120)

# %%
# The same numbers for other programs: ``pl.package.calibration_points`` makes the table of all corners in all micro
# images, which ``pl.package.write(..., targets=boards)`` puts beside the raw image.

print(pl.package.calibration_points(camera, boards[:1]))
print("written:", *sorted(path for path in output.iterdir()), sep="\n  ")
