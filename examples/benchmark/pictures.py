"""The scene, what was seen of it, what is true, what was found, and where it is wrong."""

import functools
import io

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from algorithms import is_focused, picture, views
from PIL import Image

import plenoptic as pl

CROP = 150  # pixels of a raw image that are shown
BRIGHT = 97  # percentile of a picture that is shown white
COLOURS = 128  # of a file, which are enough for small pictures
ROWS = ("scene", "seen", "true", "found", "error")


@functools.cache
def overview(make, camera):
    """The scene through the same lens without microlenses, stopped down."""
    sensor = pl.Sensor((CROP, CROP), camera.sensor.pixel_pitch * camera.sensor.shape[0] / CROP)
    lens = camera.lens.with_stop(pl.CircularStop(semi_diameter=1.5))
    eye = pl.PlenopticCamera(lens=lens, sensor=sensor, stop_to_microlenses=camera.stop_to_microlenses)
    return shown(pl.render(make(), eye.focused_at(z=-404.0), samples=128, progress=False).image)


def shown(image):
    """(H, W, 3), as bright as a screen wants it."""
    image = np.broadcast_to(image, (*image.shape[:2], 3))
    return pl.images.linear_to_srgb(np.clip(np.nan_to_num(image) / np.nanpercentile(image, BRIGHT), 0, 1))


def panels(package, truth, estimate):
    """Seen, true, found and the error in pixels: (H, W, 3) and three (H, W)."""
    focused = is_focused(package.camera)
    seen = picture(package).image if focused else views(package).centre
    side = min(CROP, *seen.shape[:2]) if focused else min(seen.shape[:2])
    middle = tuple(slice((length - side) // 2, (length + side) // 2) for length in seen.shape[:2])
    error = np.where(truth.where, estimate - truth.disparity, np.nan)
    return [part[middle] for part in (shown(seen), truth.disparity, estimate, error)]


def figure(path, columns, *, largest):
    """A column for each name; `largest`: the error, in pixels, that has the deepest colour."""
    drawn, axes = plt.subplots(5, len(columns), figsize=(len(columns) + 0.3, 5.2), layout="constrained", squeeze=False)
    low, high = np.nanpercentile(np.concatenate([parts[2].ravel() for parts in columns.values()]), [0.5, 99.5])
    looks = [{}, {}, *2 * [{"vmin": low, "vmax": high}], {"vmin": -largest, "vmax": largest, "cmap": "RdBu"}]
    for column, (name, parts) in zip(axes.T, columns.items(), strict=True):
        for ax, part, look in zip(column, parts, looks, strict=True):
            ax.imshow(part, interpolation="nearest", **look)
            ax.set(xticks=[], yticks=[])
        column[0].set_title(name, fontsize=8)
    for ax, name in zip(axes[:, 0], ROWS, strict=True):
        ax.set_ylabel(name, fontsize=8)
    file = io.BytesIO()
    drawn.savefig(file, dpi=100)
    plt.close(drawn)
    Image.open(file).convert("RGB").quantize(COLOURS).save(path, optimize=True)
