# %% [markdown]
# # How many samples are enough?
#
# A rendering can be told when to end: after so many samples, after so much time, or when its error is small enough.
# Here the objects of the reference scene are rendered to a target error. Tiles of pixels end one by one, a converged
# image says whether the error that was reported is the true one, and the path that brought most noise is traced again.

# %%
import os
from pathlib import Path

import matplotlib

matplotlib.use("Agg")  # pictures go to files; leave this out in a notebook
import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
SIDE = 64 if SMALL else 192  # pixels
TARGET = 0.2 if SMALL else 0.1
CONVERGED = 256 if SMALL else 2048  # samples

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

# %% [markdown]
# ## To a target error
#
# `relative_error` is the root mean square of error over value of the pixels that are lit.

# %%
shot = pl.render(scene, camera, target_error=TARGET, region=region, progress=False)
converged = pl.render(scene, camera, samples=CONVERGED, region=region, seed=1, truth=pl.Truth.NONE, progress=False)
lit = pl.lit_pixels(converged.image)
off = (shot.image - converged.image)[lit].astype(float)
bright = converged.image[lit].mean(axis=1, dtype=float)
true_error = np.sqrt(np.mean(np.mean(off**2, axis=1) / bright**2) - converged.relative_error**2)
print(shot)
print(f"wanted {100 * TARGET:.1f} %, reported {100 * shot.relative_error:.2f} %, true {100 * true_error:.2f} %")
print(shot.stats)

figure, axes = plt.subplots(1, 2, figsize=(9, 4.2), constrained_layout=True)
axes[0].imshow(np.clip(shot.image / np.percentile(shot.image, 99), 0, 1) ** (1 / 2.2))
axes[0].set(title="Raw image", xlabel="column", ylabel="row")
counts = shot.sample_counts if shot.sample_counts is not None else np.full(shot.image.shape[:2], shot.samples)
shown = axes[1].imshow(counts, cmap="viridis")
axes[1].set(title=f"Samples for an error of {100 * TARGET:.0f} %", xlabel="column", ylabel="row")
figure.colorbar(shown, ax=axes[1], label="samples per pixel")
figure.savefig(output / "samples.png", dpi=120)

# %% [markdown]
# ## To a time limit, and from a checkpoint
#
# A rendering that is interrupted gives what it has. One that keeps its state goes on from there, to the same bits.

# %%
quick = pl.render(scene, camera, time_limit=1.0, region=region, progress=False)
print(quick, quick.stats.stopped_by.name)

state = output / "state.part"
state.unlink(missing_ok=True)
first = pl.render(scene, camera, samples=64, region=region, checkpoint=state, progress=False)
again = pl.render(scene, camera, samples=64, region=region, checkpoint=state, progress=False)
print("the same bits from the file:", np.array_equal(first.image, again.image))

# %% [markdown]
# ## The path that brought most noise
#
# Of the pixel with the largest error all paths are traced again; the brightest of them says where the noise comes from.

# %%
error = np.where(lit, first.standard_error.mean(axis=2) / np.maximum(first.image.mean(axis=2), 1e-9), 0.0)
row, column = (int(k) + middle.start for k in np.unravel_index(np.argmax(error), error.shape))
paths = pl.replay_all(first, scene, [(row, column, sample) for sample in range(64)])
brightest = max(paths, key=lambda path: float(path.contribution.sum()))
share = brightest.contribution.sum() / sum(path.contribution.sum() for path in paths)
print(f"pixel ({row}, {column}): one path of 64 brings {100 * share:.0f} % of its light\n\n{brightest}")

# %% [markdown]
# ## What is cheapest for an error?

# %%
square = (slice(240, 240 + SIDE // 4), slice(240, 240 + SIDE // 4))
samples = (16, 32, 64) if SMALL else (16, 32, 64, 128, 256)
table = pl.study.error_against_time(
    None, camera, samples=samples, region=square, seeds=3 if SMALL else 6, progress=False
)
print(table)
print(table.recommend(0.03))
table.plot().figure.savefig(output / "error_against_time.png", dpi=120)

state.unlink()
print("written:", *sorted(str(path) for path in output.iterdir()), sep="\n  ")
