"""What was seen, what is true, what was found, and where it is wrong."""

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from algorithms import is_focused, picture, views

import plenoptic as pl

CROP = 150  # pixels of a raw image that are shown
ROWS = ("seen", "true", "found", "error")


def panels(package, truth, estimate):
    """Seen, true, found and the error in pixels: (H, W, 3) and three (H, W)."""
    focused = is_focused(package.camera)
    seen = picture(package).image if focused else views(package).centre
    side = min(CROP, *seen.shape[:2]) if focused else min(seen.shape[:2])
    middle = tuple(slice((length - side) // 2, (length + side) // 2) for length in seen.shape[:2])
    seen = np.broadcast_to(seen, (*seen.shape[:2], 3))
    error = np.where(truth.where, estimate - truth.disparity, np.nan)
    bright = np.nanpercentile(seen, 99)
    parts = (pl.images.linear_to_srgb(np.clip(np.nan_to_num(seen) / bright, 0, 1)), truth.disparity, estimate, error)
    return [part[middle] for part in parts]


def figure(path, shown, *, largest):
    """A column for each name in `shown`; errors of up to `largest` pixels in colours."""
    drawn, axes = plt.subplots(4, len(shown), figsize=(1.3 * len(shown) + 0.3, 5.2), layout="constrained", squeeze=False)
    low, high = np.nanpercentile(np.concatenate([parts[1].ravel() for parts in shown.values()]), [0.5, 99.5])
    looks = [{}, *2 * [{"vmin": low, "vmax": high}], {"vmin": -largest, "vmax": largest, "cmap": "RdBu"}]
    for column, (name, parts) in zip(axes.T, shown.items(), strict=True):
        for ax, part, look in zip(column, parts, looks, strict=True):
            ax.imshow(part, interpolation="nearest", **look)
            ax.set(xticks=[], yticks=[])
        column[0].set_title(name, fontsize=8)
    for ax, name in zip(axes[:, 0], ROWS, strict=True):
        ax.set_ylabel(name, fontsize=8)
    drawn.savefig(path, dpi=100)
    plt.close(drawn)
