"""
A data set with truth
=====================

For training or judging an algorithm that finds depth: raw images of a focused plenoptic camera, each of another scene,
with the white image, the noise of a sensor, and the exact depth of every pixel. Here are four small ones, made by a
script that makes four thousand in the same way. On the way: how good must a rendering be when a sensor adds its noise
anyway?
"""

# %%
import hashlib
import json
import os
import time
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
SIDE = 120 if SMALL else 300  # pixels
SCENES = 2 if SMALL else 4
SAMPLES = (16, 64) if SMALL else (16, 64, 256)

output = Path("output/data_set")
output.mkdir(parents=True, exist_ok=True)

# %%
# One camera
# ----------
#
# Microlenses of 20 pixels see the plane 404 mm before the iris sharply, at a virtual depth of 5: the main lens's image
# is five times as far from the array as the sensor is. ``design_camera`` finds the iris and the distances that do so.

camera = pl.design_camera(
    pl.load_lens("double-gauss-100mm-f2"),
    sensor=pl.Sensor((SIDE, SIDE), 0.009),
    kind=pl.CameraKind.GALILEAN,
    z=-404.0,
    pitch=0.18,
    focal_length=1.875,
    virtual_depth=5.0,
    image_fill=0.9,
).camera
focus = camera.report().focus[0]
print(f"sharp to one pixel from {-focus.z_near:.0f} mm to {-focus.z_far:.0f} mm; in focus at {-focus.z:.1f} mm")

# %%
# Scenes by number
# ----------------
#
# A scene is a function of its seed, so that the data set can be made again, and in any order. Matching needs texture:
# noise whose amplitude falls as 1 / frequency, as that of natural pictures does. Boards and balls hang before a wall
# between 350 and 440 mm; colours, places, tilts and the lamp differ.


def texture(random, texels=256):
    """Noise with a 1 / f spectrum between a dark and a bright colour."""
    up, across = np.meshgrid(np.fft.fftfreq(texels), np.fft.fftfreq(texels), indexing="ij")
    frequency = np.maximum(np.hypot(across, up), 1 / texels)
    grey = np.fft.ifft2(np.fft.fft2(random.normal(size=(texels, texels))) / frequency).real
    share = np.clip(0.5 + 0.25 * (grey - grey.mean()) / grey.std(), 0, 1)[..., np.newaxis]
    return pl.Texture((1 - share) * random.uniform(0.02, 0.15, 3) + share * random.uniform(0.3, 0.9, 3))


def scene_of(seed):
    """Boards and balls before a wall, under a lamp."""
    random = np.random.default_rng(seed)
    wall = pl.quad((-15, -15, 0), (30, 0, 0), (0, 30, 0), material=pl.Lambertian(texture(random)))
    meshes = [wall.rotated_deg((0, 1, 0), random.uniform(-20, 20)).translated(z=-440)]
    for place in range(6):
        x, y, z = random.uniform((-4, -4, -425), (4, 4, -350))
        material, size = pl.Lambertian(texture(random)), random.uniform(1.0, 1.8)
        if place % 2:
            meshes.append(pl.sphere(size, center=(x, y, z), material=material))
            continue
        board = pl.quad((-size, -size, 0), (2 * size, 0, 0), (0, 2 * size, 0), material=material)
        turned = board.rotated_deg((0, 0, 1), random.uniform(0, 90)).rotated_deg((1, 0, 0), random.uniform(-50, 20))
        meshes.append(turned.translated(x, y, z))
    lamp = pl.QuadLight.facing(random.uniform((-90, 40, -280), (90, 120, -200)), (0, 0, -400), (70, 70), radiance=12.0)
    return pl.Scene(meshes, [lamp], background=0.15)


# %%
# How many samples?
# -----------------
#
# A pixel that collects n electrons has a shot noise of sqrt(n). If the rendering's own error is a third of what the
# sensor adds, it raises the noise of the raw image by 5 %, since sqrt(1 + 1/9) = 1.05; below that, more samples buy
# nothing. This is the one number to choose before a night of rendering. Every rendering reports its error and its time.

WELL = 1000.0  # electrons in the brightest pixels
TRUTH = pl.Truth.DEPTH | pl.Truth.VIRTUAL_DEPTH | pl.Truth.CHORD_DISPARITY | pl.Truth.OBJECT
pl.render(scene_of(0), camera, samples=2, truth=TRUTH, progress=False)  # compiles, if this is the first time
trials = [pl.render(scene_of(0), camera, samples=n, truth=TRUTH, progress=False) for n in SAMPLES]
bright = float(np.percentile(trials[-1].image, 99))
lit = pl.lit_pixels(trials[-1].image)
electrons = WELL * trials[-1].image[lit].mean(axis=1) / bright
shot_noise = float(np.sqrt(np.mean((electrons + 3.0**2) / electrons**2)))
wanted = shot_noise / 3
print(f"relative noise of the sensor: {100 * shot_noise:.1f} %; wanted of renderings: {100 * wanted:.1f} %")
print("samples   error of the rendering   noise of both   CPU s   wall s")
for trial in trials:
    both = np.hypot(trial.relative_error, shot_noise)
    print(
        f"{trial.samples:7d} {100 * trial.relative_error:20.1f} % {100 * both:13.1f} % "
        f"{trial.stats.cpu_seconds:7.1f} {trial.stats.seconds:8.1f}"
    )

figure, ax = plt.subplots(figsize=(6.4, 4), layout="constrained")
seconds = np.array([trial.stats.cpu_seconds for trial in trials])
error = np.array([trial.relative_error for trial in trials])
ax.loglog(seconds, 100 * error, "o-", label="rendering")
ax.loglog(seconds, 100 * np.hypot(error, shot_noise), "s-", label="rendering and sensor")
ax.axhline(100 * shot_noise, color="0.4", linestyle="--", label="sensor alone")
ax.axhline(100 * wanted, color="tab:green", linestyle=":", label="a third of it: enough")
for trial in trials:
    ax.annotate(f" {trial.samples}", (trial.stats.cpu_seconds, 100 * trial.relative_error), va="bottom")
ax.set(
    xlabel="CPU time of a picture / s", ylabel="relative error / %", title="Error against time, by samples per pixel"
)
for axis in (ax.xaxis, ax.yaxis):
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter("{x:g}")
ax.legend()
ax.grid(alpha=0.3, which="both")
figure.savefig(output / "error_and_time.png", dpi=120)

# %%
# The packages
# ------------
#
# ``target_error`` ends each picture when it is good enough, bright scenes sooner than dark ones. The white image is
# the same for all; its error enters every quotient, so it gets a quarter of the error. Each package is one zip file:
# what the sensor reads out as 16-bit TIFF, light and truth as EXR and NPZ, camera, centres of the micro images, and
# a hash of every file. A manifest of our own says which picture is for what: by scene, since two pictures of one scene
# on both sides would make a test worthless.

white = pl.render_white(camera, target_error=wanted / 4, seed=1000, progress=False)
sensor = pl.SensorModel(
    photon_rate=WELL / bright, gain=3900 / (1.5 * WELL), black_level=64, full_well=1.5 * WELL, read_noise=3.0
)
manifest, begin = [], time.perf_counter()
for seed in range(SCENES):
    scene, path = scene_of(seed), output / f"scene_{seed:04d}.zip"
    shot = pl.render(scene, camera, target_error=wanted, samples=1024, truth=TRUTH, seed=seed, progress=False)
    pl.package.write(path, shot, white, sensor=sensor, scene=scene, seed=seed)
    manifest.append(
        {
            "file": path.name,
            "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
            "seed": seed,
            "part": "test" if seed % 4 == 3 else "training",
            "relative_error": round(shot.relative_error, 5),
            "cpu_seconds": round(shot.stats.cpu_seconds, 2),
        }
    )
    print(f"{path.name}: error {100 * shot.relative_error:.1f} %, {shot.stats.cpu_seconds:.1f} CPU s, "
          f"{path.stat().st_size / 1e6:.1f} MB")  # fmt: skip
each = (time.perf_counter() - begin) / SCENES
(output / "manifest.json").write_text(json.dumps(manifest, indent=1))
print(f"{each:.1f} s a picture with its files: a thousand take {1000 * each / 3600:.1f} hours")

# %%
# Read back, and looked at
# ------------------------
#
# A package is refused when a file is not what its hash says. What comes back is what was written, to the last bit.

packages = [pl.package.read(output / entry["file"]) for entry in manifest]
assert packages[-1].exposure == shot and packages[-1].camera == camera


def seen(image, top):
    """Linear light as a picture for the screen."""
    return pl.images.linear_to_srgb(np.clip(image / top, 0, 1))


columns = min(4, SCENES)
figure, axes = plt.subplots(2, columns, figsize=(3.2 * columns, 6.0), layout="constrained", squeeze=False)
for (above, below), package, entry in zip(axes.T, packages, manifest, strict=False):
    counts = np.clip(package.raw.data.astype(float) - sensor.black_level, 0, None)
    above.imshow(seen(counts, np.percentile(counts, 99.5)), interpolation="nearest")
    above.set_title(f"raw image {entry['seed']} ({entry['part']})")
    depth = below.imshow(package.exposure.truth.depth, vmin=350, vmax=450, cmap="viridis", interpolation="nearest")
    below.set_title("its true depth")
    for ax in (above, below):
        ax.set(xlabel="column / pixel", ylabel="row / pixel")
figure.colorbar(depth, ax=axes[1], label="depth / mm", shrink=0.8)
figure.savefig(output / "pictures.png", dpi=120)

# %%
# Is the truth true?
# ------------------
#
# Gaussian optics says where the main lens images a depth, hence its virtual depth. The channel of the truth is found by
# exact rays instead: near the axis both agree, and what is left are the aberrations of the lens.

truth = packages[0].exposure.truth
met = np.isfinite(truth.depth) & np.isfinite(truth.virtual_depth)
depths = np.linspace(345, 460, 60)
behind = np.array([pl.paraxial.image_position(camera.lens, -d) for d in depths]) - camera.stop_to_microlenses
expected = np.interp(truth.depth[met], depths, behind / camera.microlenses_to_sensor)
off = truth.virtual_depth[met] / expected - 1
print(f"virtual depth by rays over that by Gaussian optics: {100 * np.median(off):+.2f} % in the median, "
      f"95 % of pixels within {100 * np.percentile(np.abs(off), 95):.2f} %")  # fmt: skip

figure, ax = plt.subplots(figsize=(6.4, 4), layout="constrained")
ax.plot(truth.depth[met][::7], truth.virtual_depth[met][::7], ",", color="tab:blue")
ax.plot([], [], "o", color="tab:blue", label="pixels, by exact rays")
ax.plot(depths, behind / camera.microlenses_to_sensor, color="tab:orange", linewidth=1, label="Gaussian optics")
ax.axvline(-focus.z, color="0.6", linestyle=":", label="in focus")
ax.set(xlabel="depth / mm", ylabel="virtual depth", title="Depth before the lens, and what the microlenses see of it")
ax.legend()
ax.grid(alpha=0.3)
figure.savefig(output / "virtual_depth.png", dpi=120)

# %%
# A first score
# -------------
#
# ``pl.lightfield.depth`` matches the micro images; a learnt algorithm has to beat it. Disparities are judged by
# ``chord_disparity``, which is what neighbouring micro images really show; depth follows from disparity. Most
# errors stand at edges of depth, where some microlenses see what others do not, and what is near grows into the wall.

scores, found = [], []
for package in packages:
    estimate = pl.lightfield.depth(package.raw.demosaic(pl.DemosaicMethod.MHC), package.white, progress=False)
    found.append(estimate)
    sure = np.where(estimate.confidence > 0.5, estimate.disparity, np.nan)
    scores.append(pl.lightfield.disparity_scores(sure, package.exposure.truth.chord_disparity))
    off = np.abs(estimate.depth - package.exposure.truth.depth)[estimate.confidence > 0.5]
    print(
        f"scene {package.provenance['seed']}: {100 * scores[-1].kept:.0f} % of the pixels kept, of them "
        f"{scores[-1].relative[0]:.0f} % more than 7 % off in disparity; depth off by {np.nanmedian(off):.1f} mm"
    )

best = int(np.argmin([score.relative[0] for score in scores]))
true_depth = packages[best].exposure.truth.depth
sure = np.where(found[best].confidence > 0.5, found[best].depth, np.nan)
figure, axes = plt.subplots(1, 3, figsize=(12, 3.9), layout="constrained", sharex=True, sharey=True)
for ax, depth, title in zip(axes, (true_depth, sure), ("true depth", "found in the noisy raw image"), strict=False):
    shown = ax.imshow(depth, vmin=350, vmax=450, cmap="viridis", interpolation="nearest")
    ax.set(title=title, xlabel="column / pixel")
figure.colorbar(shown, ax=axes[:2], label="depth / mm; white: not known")
shown = axes[2].imshow(sure - true_depth, vmin=-20, vmax=20, cmap="RdBu", interpolation="nearest")
axes[2].set(title="found minus true", xlabel="column / pixel")
axes[0].set_ylabel("row / pixel")
figure.colorbar(shown, ax=axes[2], label="mm")
figure.savefig(output / "first_score.png", dpi=120)

# %%
# For other programs
# ------------------
#
# Exporters write what other programs read, for a focused camera those of the PlenopticToolbox and COMPOTE. The page on
# formats says what each of them holds.

pl.export.plenoptic_toolbox(output / "plenoptic_toolbox", packages[0].exposure)
print(*sorted(path.name for path in (output / "plenoptic_toolbox").iterdir()), sep="\n")
print("written:", *sorted(path for path in output.iterdir()), sep="\n  ")
