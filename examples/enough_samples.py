"""
How many samples are enough?
============================

A rendering can be told when to end: after so many samples, after so much time, or when its error is small enough.
Here the objects of the reference scene are rendered to a target error. Tiles of pixels end one by one, a converged
image says whether the error that was reported is the true one, and the path that brought most noise is traced again.
Then five scenes, from a white image to a caustic, show how the error falls with the number of samples.
"""

# sphinx_gallery_thumbnail_number = 2

# %%
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
SIDE = 64 if SMALL else 256  # pixels
TARGET = 0.2 if SMALL else 0.1
CONVERGED = 256 if SMALL else 512  # samples

output = Path("output/enough_samples")
output.mkdir(parents=True, exist_ok=True)

camera = pl.PlenopticCamera(
    lens=pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=5.0)),
    microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)),
    sensor=pl.Sensor(shape=(512, 512), pixel_pitch=0.010),
    stop_to_microlenses=123.3,
    microlenses_to_sensor=1.7,
)
scene = pl.objects_scene()
middle = slice(256 - SIDE // 2, 256 + SIDE // 2)
region = (middle, middle)

# %%
# To a target error
# -----------------
#
# ``relative_error`` is the root mean square of error over value of the pixels that are lit.

shot = pl.render(scene, camera, target_error=TARGET, region=region, progress=False)
converged = pl.render(scene, camera, samples=CONVERGED, region=region, seed=1, truth=pl.Truth.NONE, progress=False)
lit = pl.lit_pixels(converged.image)
off = (shot.image - converged.image)[lit].astype(float)
bright = converged.image[lit].mean(axis=1, dtype=float)
true_error = np.sqrt(np.mean(np.mean(off**2, axis=1) / bright**2) - converged.relative_error**2)
print(shot)
print(f"wanted {100 * TARGET:.1f} %, reported {100 * shot.relative_error:.2f} %, true {100 * true_error:.2f} %")
print(shot.stats)

figure, axes = plt.subplots(1, 2, figsize=(12, 5.4), layout="constrained")
axes[0].imshow(pl.images.linear_to_srgb(np.clip(shot.image / np.percentile(shot.image, 99), 0, 1)))
axes[0].set(title="Raw image", xlabel="column / pixel", ylabel="row / pixel")
counts = shot.sample_counts if shot.sample_counts is not None else np.full(shot.image.shape[:2], shot.samples)
shown = axes[1].imshow(counts, cmap="viridis")
axes[1].set(title=f"Samples for an error of {100 * TARGET:.0f} %", xlabel="column / pixel", ylabel="row / pixel")
figure.colorbar(shown, ax=axes[1], label="samples per pixel")
figure.savefig(output / "samples.png", dpi=100)

# %%
# To a time limit, and from a checkpoint
# --------------------------------------
#
# A rendering that is interrupted gives what it has. One that keeps its state goes on from there, to the same bits.

quick = pl.render(scene, camera, time_limit=1.0, region=region, progress=False)
print(quick, quick.stats.stopped_by.name)

state = output / "state.part"
state.unlink(missing_ok=True)
first = pl.render(scene, camera, samples=64, region=region, checkpoint=state, progress=False)
again = pl.render(scene, camera, samples=64, region=region, checkpoint=state, progress=False)
print("the same bits from the file:", np.array_equal(first.image, again.image))

# %%
# The path that brought most noise
# --------------------------------
#
# Of the pixel with the largest error all paths are traced again; the brightest of them says where the noise comes from.

error = np.where(lit, first.standard_error.mean(axis=2) / np.maximum(first.image.mean(axis=2), 1e-9), 0.0)
row, column = (int(k) + middle.start for k in np.unravel_index(np.argmax(error), error.shape))
paths = pl.replaying.replay_all(first, scene, [(row, column, sample) for sample in range(64)])
brightest = max(paths, key=lambda path: float(path.contribution.sum()))
share = brightest.contribution.sum() / sum(path.contribution.sum() for path in paths)
print(f"pixel ({row}, {column}): one path of 64 brings {100 * share:.0f} % of its light\n\n{brightest}")

# %%
# Error against samples
# ---------------------
#
# How large the error of so many samples is depends on the scene. Five of them, through the same camera: the white
# image; a ball before a chequered wall under a lamp, which is matt, glossy or of glass; and the spot of light that a
# ball of glass throws onto a wall, which paths find by chance only. Each is rendered with several seeds and compared
# with a converged image: the error is the root mean square of error over value of the pixels that are lit.


def ball(material):
    """A ball of 10 mm, seen whole by no microlens, before squares of 2 mm."""
    wall = [mesh.translated(z=-420) for mesh in pl.checkerboard((60, 60), 2.0)]
    lamp = pl.QuadLight.facing((30, 50, -360), (0, 0, -404), (40, 40), radiance=10.0)
    return pl.Scene([*wall, pl.sphere(5.0, center=(0, 0, -409), material=material)], [lamp], background=0.1)


def caustic():
    """The light of a small lamp on the left, through a ball of glass beside what is seen, on a grey wall."""
    wall = pl.quad((-30, -30, -404), (60, 0, 0), (0, 60, 0), material=pl.Lambertian(0.7))
    glass = pl.sphere(4.0, center=(-7, 0, -397), material=pl.Dielectric(1.5))
    lamp = pl.QuadLight.facing((-50, 0, -354), (-7, 0, -397), (6, 6), radiance=100.0)
    return pl.Scene([wall, glass], [lamp], background=0.02)


COUNTS = (4, 16, 64) if SMALL else (4, 16, 64, 256, 1024)
CASES = {
    "white": None,
    "matt": ball(pl.Lambertian((0.7, 0.5, 0.3))),
    "glossy": ball(pl.MetallicRoughness((0.7, 0.5, 0.3), roughness=0.3)),
    "glass": ball(pl.Dielectric(1.5)),
    "caustic": caustic(),
}
WIDE = 16 if SMALL else 32
square = (slice(240, 240 + WIDE), slice(240, 240 + WIDE))
tables = {
    name: pl.study.error_against_time(
        case, camera, {name: pl.study.Variant()}, samples=COUNTS, region=square, seeds=2 if SMALL else 4,
        reference_samples=(4 if SMALL else 8) * COUNTS[-1], threads=2, progress=False,
    )
    for name, case in CASES.items()
}  # fmt: skip

heads = (*(f"{n} samples" for n in COUNTS), "slope", "true over reported", "CPU s a megapixel and sample")
print("| error / %", *heads, sep=" | ", end=" |\n")
print("|---" * (len(COUNTS) + 4) + "|")
for name, table in tables.items():
    rows = table.of(name)
    errors = " | ".join(f"{100 * row.error:.{0 if row.error > 0.1 else 2}f}" for row in rows)
    honest = rows[1].true_over_reported
    cost = 1e6 * (rows[-1].cpu_seconds - rows[-1].setup_cpu_seconds) / table.pixels / rows[-1].samples
    print(f"| {name} | {errors} | {table.slope(name):.2f} | {honest:.2f} | {cost:.2f} |")

# %%
# Four times the samples halve the error where samples are independent: a slope of -1/2. Sobol points do better where
# little is random but the place in pixel and lens, as in the white image. Of a caustic most pixels meet no
# path with few samples, and the few that do are far too bright: its error is hundreds of times that of a matt surface.
# The true error over that which 16 samples report is near 1, as the root mean square over pixels and seeds.

figure, ax = plt.subplots(figsize=(8, 5.5), layout="constrained")
for (name, table), marker in zip(tables.items(), "osD^v", strict=True):
    ax.loglog(COUNTS, [100 * row.error for row in table.of(name)], marker=marker, label=name)
ax.loglog(COUNTS, 60 * (np.array(COUNTS) / COUNTS[0]) ** -0.5, color="0.6", linestyle="--", label="slope -1/2")
ax.set(xlabel="samples per pixel", ylabel="relative error of a pixel / %", title="Error against samples")
ax.set_xticks(COUNTS, [str(n) for n in COUNTS])
ax.grid(alpha=0.3, which="both")
ax.legend()
figure.savefig(output / "error_against_samples.png", dpi=100)

state.unlink()
print("written:", *sorted(str(path) for path in output.iterdir()), sep="\n  ")
