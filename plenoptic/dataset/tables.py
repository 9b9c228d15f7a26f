"""Files of a data set beside its stores: the manifest, a table of statistics, and a contact sheet."""

from __future__ import annotations

import csv
import io
import platform
from collections.abc import Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from plenoptic import __version__
from plenoptic.core.color.percentile import HighPercentile
from plenoptic.core.files.atomic_file import write_file, write_json
from plenoptic.core.files.codes import block_means, codes, white_point
from plenoptic.core.files.zarr_files import CHUNK, translate_zarr_errors, zarr_module
from plenoptic.dataset.contents import CONTACT_SHEET, FORMAT, MANIFEST, STATISTICS
from plenoptic.dataset.journal import Journal
from plenoptic.dataset.task import FrameOptions, Frames, Task, tasks_of
from plenoptic.rendering.exposure import Exposure

_COLUMNS = (
    *("camera", "frame", "time_s", "first_row", "end_row", "seed", "samples", "relative_error"),
    *("mean", "percentile_99", "maximum", "paths", "paths_through_lens", "nonfinite", "stopped_by"),
    *("seconds", "cpu_seconds", "motion_visible"),
)
_SIDE, _GAP, _TEXT, _SPACE = 160, 6, 14, 4
"""Pixels of a picture along its longer side, between pictures, of a line of text, and between words."""
_LABEL, _TITLE = 80, 240
"""Smallest width of a picture and of a sheet in pixels, for their captions."""
_MOST, _ACROSS = 48, 8
"""Pictures of a camera, and those side by side."""
_PACKAGES = ("numpy", "numba", "llvmlite", "embreex", "zarr")


def versions() -> dict[str, str]:
    """Versions on which bits depend, beside this package and the processor."""
    return {"python": platform.python_version(), **{name: metadata.version(name) for name in _PACKAGES}}


def statistics_of(shot: Exposure) -> dict[str, Any]:
    """Statistics of an image for the table; the same bits give the same numbers, except for times."""
    level, stats = HighPercentile(99.0, max_count=shot.image.size), shot.stats
    for row in shot.image:
        level.add(row[np.isfinite(row)])
    assert stats is not None
    error = shot.relative_error
    return {
        "relative_error": None if error is None or not np.isfinite(error) else error,
        "mean": float(shot.image.mean(dtype=np.float64)),
        "percentile_99": level.value(),
        "maximum": float(shot.image.max()),
        "paths": stats.paths,
        "paths_through_lens": stats.paths_through_lens,
        "nonfinite": stats.nonfinite,
        "stopped_by": stats.stopped_by.name,
        "seconds": round(stats.seconds, 3),
        "cpu_seconds": round(stats.cpu_seconds, 3),
        "processors": list(stats.processors),
    }


def write_statistics(folder: Path, done: Mapping[Task, Mapping[str, Any]]) -> None:
    """A row for each image, or for each band of a large one."""
    text = io.StringIO()
    table = csv.DictWriter(text, _COLUMNS, restval="", extrasaction="ignore", lineterminator="\n")
    table.writeheader()
    for task, facts in sorted(done.items(), key=lambda item: (item[0].frame, item[0].camera, item[0].rows)):
        if task.image:
            moved = done.get(task._replace(image=False), {})
            places = {"time_s": facts["time"], "first_row": task.rows[0], "end_row": task.rows[1]}
            table.writerow({**facts, **places, "motion_visible": moved.get("visible", "")})
    write_file(folder / STATISTICS, text.getvalue().encode())


def write_manifest(
    folder: Path, sequences: Mapping[str, Frames], options: FrameOptions, journal: Journal
) -> dict[str, Any]:
    """Write the manifest: the images, the inputs of each, and the hashes of its arrays."""
    tasks = list(tasks_of(sequences, motion=options.motion))
    of_image: dict[tuple[int, str], list[Task]] = {}
    for task in tasks:
        of_image.setdefault((task.frame, task.camera), []).append(task)
    records, images = journal.done, []
    cameras: dict[str, dict[str, int]] = {name: {} for name in sequences}
    names, made_by = dict[str, int](), dict[str, int]()
    for (frame, camera), parts in of_image.items():
        bands, motions = ([task for task in parts if task.image is image] for image in (True, False))
        if not all(task in records for task in bands):
            continue
        facts = records[bands[0]]
        images.append(
            {
                **{"camera": camera, "frame": frame},
                **{name: facts[name] for name in ("time", "pose", "shutter", "object_to_world", "seed", "replicates")},
                "camera_value": _number(facts["camera_value"], cameras[camera]),
                "object_names": _number(facts["object_names"], names),
                "versions": _number(facts["versions"], made_by),
                "samples": max(records[task]["samples"] for task in bands),
                "motion": bool(motions) and all(task in records for task in motions),
                "inputs": facts["inputs"],
                "processors": sorted({kind for task in bands for kind in records[task]["processors"]}),
                "parts": [
                    {
                        "rows": list(task.rows),
                        "of": "image" if task.image else "motion",
                        "arrays": records[task]["arrays"],
                        "sha256": records[task]["sha256"],
                    }
                    for task in parts
                    if task in records
                ],
            }
        )
    manifest = {
        "format": FORMAT,
        "software": f"plenoptic {__version__}",
        "versions": [journal.values[key] for key in made_by],
        "units": "lengths mm, times s, angles rad; pose: world = rotation @ camera + position, object_to_world 3 x 4",
        "complete": all(task in records for task in tasks),
        "frames": len(next(iter(sequences.values()))),
        "made_with": options.to_tree(),
        "cameras": {name: [journal.values[key] for key in keys] for name, keys in cameras.items()},
        "object_names": [journal.values[key] for key in names],
        "images": images,
    }
    write_json(folder / MANIFEST, manifest)
    return manifest


def _number(key: str, numbers: dict[str, int]) -> int:
    """The number of an item, the next one if it is new."""
    return numbers.setdefault(key, len(numbers))


def write_contact_sheet(folder: Path, images: Sequence[Mapping[str, Any]]) -> None:
    """Some images of each camera, evenly chosen and of one brightness, with their numbers and times."""
    by_camera: dict[str, list[Mapping[str, Any]]] = {}
    for image in images:
        by_camera.setdefault(image["camera"], []).append(image)
    rows = [_row(folder, name, shots) for name, shots in by_camera.items()]
    if not rows:
        return
    width = max(row.width for row in rows)
    sheet = Image.new("RGB", (width, sum(row.height for row in rows)), "white")
    top = 0
    for row in rows:
        sheet.paste(row, (0, top))
        top += row.height
    file = io.BytesIO()
    sheet.save(file, "png", optimize=True)
    write_file(folder / CONTACT_SHEET, file.getvalue())


def _row(folder: Path, name: str, images: Sequence[Mapping[str, Any]]) -> Image.Image:
    """The pictures of a camera."""
    chosen = np.unique(np.linspace(0, len(images) - 1, min(len(images), _MOST)).round().astype(int))
    pictures = [_small(folder / f"{name}.zarr", images[i]["frame"]) for i in chosen]
    white = white_point(np.concatenate([picture.reshape(-1) for picture in pictures]))
    (high, wide), across = pictures[0].shape[:2], min(len(pictures), _ACROSS)
    down, right = high + _TEXT + _GAP, max(wide, _LABEL) + _GAP
    sheet = Image.new(
        "RGB", (max(across * right, _TITLE) + _GAP, -(-len(pictures) // across) * down + 2 * _TEXT), "white"
    )
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(size=_TEXT - 3)
    _write(draw, (_GAP, 2), f"{name}: {len(images)} frames, {white:.3g} is white", font)
    for place, (i, picture) in enumerate(zip(chosen, pictures, strict=True)):
        x, y = _GAP + place % across * right, 2 * _TEXT + place // across * down - _GAP
        pixels = np.broadcast_to(codes(picture, scale=white, encoded=True, bits=8), (high, wide, 3))
        sheet.paste(Image.fromarray(np.ascontiguousarray(pixels)), (x, y))
        _write(draw, (x, y + high), f"{images[i]['frame']}: {images[i]['time']:.4g} s", font)
    return sheet


def _write(draw: ImageDraw.ImageDraw, corner: tuple[int, int], text: str, font: Any) -> None:
    """Draw a line of text word by word: at this size Pillow's font has spaces of a pixel."""
    x, y = corner
    for word in text.split():
        draw.text((x, y), word, "black", font)
        x += round(font.getlength(word)) + _SPACE


def _small(store: Path, frame: int) -> NDArray[Any]:
    """Means over blocks of a frame, some rows at a time."""
    with translate_zarr_errors(store, "read"):
        image = zarr_module().open_array(store / "image", mode="r")
        _, rows, columns, _ = image.shape
        block = -(-max(rows, columns) // _SIDE)
        high, end = max(CHUNK // block, 1) * block, max(rows - rows % block, 1)
        parts = [block_means(image[frame, first : first + high], block) for first in range(0, end, high)]
    return np.concatenate(parts)
