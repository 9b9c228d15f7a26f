"""The contact sheet: a small picture of frames of all cameras."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from plenoptic.core.files.atomic_file import write_file
from plenoptic.core.files.codes import block_means, codes, white_point
from plenoptic.core.files.zarr_files import CHUNK, translate_zarr_errors, zarr_module
from plenoptic.dataset.contents import CONTACT_SHEET

_SIDE, _GAP, _TEXT = 160, 6, 14
"""Pixels of a picture along its longer side, between pictures, and of a line of text."""
_LABEL, _TITLE = 80, 240
"""Pixels across a picture and a sheet at least, for what is written there."""
_MOST, _ACROSS = 48, 8
"""Pictures of a camera, and those side by side."""


def write_contact_sheet(folder: Path, images: Sequence[Mapping[str, Any]]) -> None:
    """Some images of each camera, evenly chosen and of one brightness, with their numbers and times."""
    of: dict[str, list[Mapping[str, Any]]] = {}
    for image in images:
        of.setdefault(image["camera"], []).append(image)
    rows = [_row(folder, name, shots) for name, shots in of.items()]
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
    draw.text((_GAP, 2), f"{name}: {len(images)} frames, {white:.3g} is white", "black", font)
    for place, (i, picture) in enumerate(zip(chosen, pictures, strict=True)):
        x, y = _GAP + place % across * right, 2 * _TEXT + place // across * down - _GAP
        pixels = np.broadcast_to(codes(picture, scale=white, encoded=True, bits=8), (high, wide, 3))
        sheet.paste(Image.fromarray(np.ascontiguousarray(pixels)), (x, y))
        draw.text((x, y + high), f"{images[i]['frame']}: {images[i]['time']:.4g} s", "black", font)
    return sheet


def _small(store: Path, frame: int) -> NDArray[Any]:
    """Means over blocks of a frame, some rows at a time."""
    with translate_zarr_errors(store, "read"):
        image = zarr_module().open_array(store / "image", mode="r")
        _, rows, columns, _ = image.shape
        block = -(-max(rows, columns) // _SIDE)
        high, end = max(CHUNK // block, 1) * block, max(rows - rows % block, 1)
        parts = [block_means(image[frame, first : first + high], block) for first in range(0, end, high)]
    return np.concatenate(parts)
