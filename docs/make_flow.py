"""Draw docs/images/flow.png: the way of a ray through the rooms of the package. Run it after a stage has moved."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

STAGES = (
    ("describe", "the user's objects:\nfrozen dataclasses", "optics/ scene/ camera/"),
    ("compile", "read-only records;\nNone for absent features", "*_record.py\nscene/scene_record.py"),
    ("decide", "which stages run, and why", "rendering/plan/"),
    ("bound", "aperture region\nof each pixel", "camera/sampling/"),
    ("sample", "points on pixel and array,\na wavelength", "camera/sampling/kernels/"),
    ("microlens", "a ray to the lens, and its\nprojected solid angle", "optics/microlens/kernels/"),
    ("transmit", "surfaces and stops;\na status for lost rays", "optics/lens/kernels/"),
    ("intersect", "Embree's triangle,\nthe point in float64", "scene/geometry/"),
    ("shade", "emission, sampled lights,\nthe next ray", "rendering/integrator/\nscene/*/kernels/"),
    ("accumulate", "sums per pixel, replicate\nand channel; their error", "rendering/film.py"),
)
COLUMNS = 5
WIDTH, HEIGHT, GAP_X, GAP_Y = 3.0, 1.6, 0.5, 0.7


def corner(number: int) -> tuple[float, float]:
    """Lower left corner of a box: the first row runs to the right, the second one back."""
    row, column = divmod(number, COLUMNS)
    if row % 2:
        column = COLUMNS - 1 - column
    return column * (WIDTH + GAP_X), -row * (HEIGHT + GAP_Y)


def arrow(axes: plt.Axes, begin: tuple[float, float], end: tuple[float, float], **style: object) -> None:
    axes.add_patch(FancyArrowPatch(begin, end, arrowstyle="-|>", mutation_scale=14, color="0.25", **style))


def main() -> None:
    figure, axes = plt.subplots(figsize=(12, 3.9))
    for number, (name, what, where) in enumerate(STAGES):
        x, y = corner(number)
        hot = number >= 3
        face = "#fdf0dc" if hot else "#e4eef8"
        axes.add_patch(FancyBboxPatch((x, y), WIDTH, HEIGHT, boxstyle="round,pad=0.04", fc=face, ec="0.35"))
        axes.text(x + WIDTH / 2, y + HEIGHT - 0.07, name, ha="center", va="top", weight="bold", fontsize=10.5)
        axes.text(x + WIDTH / 2, y + 0.9, what, ha="center", va="center", fontsize=8)
        axes.text(x + WIDTH / 2, y + 0.05, where, ha="center", va="bottom", fontsize=7, family="monospace", color="0.3")
        if number + 1 < len(STAGES):
            nx, ny = corner(number + 1)
            if ny == y:
                ahead = 1 if nx > x else -1
                begin = x + (WIDTH if ahead > 0 else 0) + 0.06 * ahead
                arrow(axes, (begin, y + HEIGHT / 2), (begin + (GAP_X - 0.12) * ahead, y + HEIGHT / 2))
            else:
                arrow(axes, (x + WIDTH / 2, y - 0.06), (x + WIDTH / 2, ny + HEIGHT + 0.06))
    # Scattered rays are intersected again.
    (x8, y8), (x7, _) = corner(8), corner(7)
    loop = {"connectionstyle": "arc3,rad=0.3", "linestyle": "--"}
    arrow(axes, (x8 + WIDTH / 2, y8 - 0.06), (x7 + WIDTH / 2, y8 - 0.06), **loop)
    axes.text((x7 + x8 + WIDTH) / 2, y8 - 0.72, "the next bounce", ha="center", va="top", fontsize=8, color="0.3")
    left, right = -0.2, COLUMNS * WIDTH + (COLUMNS - 1) * GAP_X + 0.2
    axes.text(left + 0.2, HEIGHT + 0.2, "once per render", fontsize=9, color="#2c5d8f")
    x3, _ = corner(3)
    axes.text(
        x3, HEIGHT + 0.2, "for each tile, then for each bundle of 16384 paths", fontsize=9, color="#9a5b00", ha="left"
    )
    axes.set(xlim=(left, right + 0.5), ylim=(y8 - 1.0, HEIGHT + 0.5), aspect="equal")
    axes.axis("off")
    figure.savefig(Path(__file__).with_name("images") / "flow.png", dpi=110, bbox_inches="tight")


if __name__ == "__main__":
    main()
