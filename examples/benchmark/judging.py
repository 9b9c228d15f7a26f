"""How good disparities are: `pl.lightfield.disparity_scores` against the truth, and the tables of it."""

import math
from typing import NamedTuple

import numpy as np
from algorithms import is_focused, views

import plenoptic as pl

INSIDE = 0.35  # pitches from the middle of a micro image, within which its pixels count
BORDER = 1.5  # pitches from the border of the picture
VIEW_BORDER = 3  # pixels of a view


class Reference(NamedTuple):
    """The truth about a package: disparities, types of the microlenses where they matter, and which pixels count."""

    disparity: np.ndarray
    types: np.ndarray | None
    where: np.ndarray
    edges: np.ndarray  # where it steps


def reference(package, scene):
    return raw_reference(package) if is_focused(package.camera) else view_reference(package, scene)


def raw_reference(package):
    """Of the pixels in the middle of micro images, by the chord between chief rays."""
    truth, camera = package.exposure.truth, package.camera
    pitch = camera.microlenses.pitch / camera.sensor.pixel_pitch
    rows, columns = np.indices(truth.shape)
    inside = np.zeros(truth.shape, dtype=bool)
    for row, column in package.centres[pl.CentreMethod.CHIEF_RAY].pixel:
        inside |= np.hypot(rows - row, columns - column) < INSIDE * pitch
    edge = int(np.ceil(BORDER * pitch))
    where = np.zeros(truth.shape, dtype=bool)
    where[edge:-edge, edge:-edge] = inside[edge:-edge, edge:-edge]
    edges = pl.lightfield.disparity_edges(truth.chord_disparity)
    return Reference(truth.chord_disparity, truth.microlens_type, where, edges)


def view_reference(package, scene):
    """Of the central view: the depth that its own rays meet, as the disparity of a plane there."""
    field = views(package)
    depth = field.truth(scene, truth=pl.Truth.DEPTH).depth
    planes = np.geomspace(100.0, 2000.0, 2000)
    disparity = np.interp(depth, planes, [field.disparity_at(-z)[0] for z in planes])
    where = np.zeros(depth.shape, dtype=bool)
    where[VIEW_BORDER:-VIEW_BORDER, VIEW_BORDER:-VIEW_BORDER] = True
    disparity = np.where(np.isfinite(depth), disparity, np.nan)
    return Reference(disparity, None, where, pl.lightfield.disparity_edges(disparity))


def on_scale(estimate, truth):
    """The estimate by the straight line that brings it nearest to the truth."""
    both = truth.where & np.isfinite(estimate) & np.isfinite(truth.disparity)
    if not both.any():
        return estimate
    return np.polyval(np.polyfit(estimate[both], truth.disparity[both], 1), estimate)


def scores(estimate, truth):
    """Of all pixels that count, of those away from edges, and of those at them."""
    return [
        pl.lightfield.disparity_scores(estimate, truth.disparity, where=where, types=truth.types)
        for where in (truth.where, truth.where & ~truth.edges, truth.where & truth.edges)
    ]


class Row(NamedTuple):
    """One line of a table; scores are None where the algorithm is not there."""

    scene: str
    algorithm: str
    scores: pl.lightfield.DisparityScores | None
    flat: pl.lightfield.DisparityScores | None
    edges: pl.lightfield.DisparityScores | None
    seconds: float
    error: float


COMMON = ("scene", "error %", "algorithm", "kept %")
IN_PIXELS = ("MSE", "Bad 0.07", "Bad 0.03", "Bad 0.01", "Q25")
REGIONS = ("Planes", "Discont.")
RELATIVE = ("Rel7", "Rel3", "Rel1", "bias %")


def table(camera, rows):
    """Scores of one camera as Markdown."""
    focused, types = is_focused(camera), len(camera.microlenses.focal_lengths)
    columns = [*COMMON, *((*RELATIVE, *IN_PIXELS, "Rel3 flat") if focused else (*IN_PIXELS, "Bad 0.03 flat")), *REGIONS]
    columns += ["Rel3 of types"] if types > 1 else []
    cells = [[*columns, "s"], *([*_cells(row, columns), f"{row.seconds:.1f}"] for row in rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = [" | ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)) for line in cells]
    lines.insert(1, " | ".join("-" * width for width in widths))
    return "".join(f"| {line} |\n" for line in lines)


def _cells(row, columns):
    known = {"scene": row.scene, "error %": f"{100 * row.error:.1f}", "algorithm": row.algorithm}
    found = row.scores
    if found is None:
        return [known.get(column, "not there" if column == "kept %" else "") for column in columns]
    numbers = [100 * found.kept, *found.relative, 100 * found.bias, found.mse, *found.bad, found.q25]
    known |= zip(("kept %", *RELATIVE, *IN_PIXELS), map(_short, numbers), strict=True)
    known["Rel3 flat"], known["Bad 0.03 flat"] = _short(row.flat.relative[1]), _short(row.flat.bad[1])
    known["Planes"], known["Discont."] = _short(row.flat.bumpiness), _short(row.edges.bad[0])
    known["Rel3 of types"] = ", ".join(_short(alone.relative[1]) for alone in found.of_types)
    return [known[column] for column in columns]


def _short(number):
    """Three digits, of which at most two are decimals."""
    if not math.isfinite(number) or abs(number) < 0.005:
        return f"{abs(number):.0f}"
    return f"{number:.{min(max(2 - math.floor(math.log10(abs(number))), 0), 2)}f}"
