"""Views as JPEG Pleno's light field coders read them (ISO/IEC 21794-2): one PPM file a view."""

from __future__ import annotations

import os

import numpy as np

from plenoptic.core.color.srgb import linear_to_srgb
from plenoptic.core.files.atomic_file import write_file
from plenoptic.core.files.codes import white_point
from plenoptic.core.values import check_kind
from plenoptic.export.pictures import check_no_others, folder_at, write_readme
from plenoptic.lightfield.views import LightField

_LARGEST = 1023
"""10 bits, as the common test conditions have them."""


def jpeg_pleno(folder: str | os.PathLike[str], field: LightField) -> None:
    """Write a light field as views `CCC_RRR.ppm`: column and row of the view from 000, 10 bits, sRGB.

    Parameters
    ----------
    folder : path-like
        Folder, made if it is missing; files of the same name are replaced.
    field : LightField
        From `decode`, `render_views` or a reader.

    Raises
    ------
    FileError
        If a file cannot be written, or the folder holds views of another light field.

    Notes
    -----
    PPM of 16 bits (big-endian) with 1023 as the largest number; one scale for all views, the 99.9th percentile. Pixels
    without light are black.

    Not expressed: errors, truth, the camera; disparity maps of the standard are not written.

    Examples
    --------
    >>> import pathlib, tempfile, plenoptic as pl
    >>> camera = pl.camera.example_camera(pl.CameraKind.PLENOPTIC_1, shape=(110, 154), lattice=pl.Lattice.SQUARE)
    >>> white = pl.render_white(camera, samples=16, progress=False)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     pl.export.jpeg_pleno(folder, pl.lightfield.decode(white, white, views=3))
    ...     sorted(path.name for path in pathlib.Path(folder).iterdir())[:3]
    ['000_000.ppm', '000_001.ppm', '000_002.ppm']
    """
    check_kind(field, "field", LightField, "pl.lightfield.decode(shot, white)")
    target, scale = folder_at(folder), white_point(field.views)
    across, down, rows, columns = field.views.shape[:4]
    check_no_others(target, "*_*.ppm", {f"{u:03d}_{v:03d}.ppm" for u in range(across) for v in range(down)})
    head = f"P6\n{columns} {rows}\n{_LARGEST}\n".encode("ascii")
    for u in range(across):
        for v in range(down):
            encoded = linear_to_srgb(np.clip(np.nan_to_num(field.views[u, v].astype(np.float64)) / scale, 0.0, 1.0))
            view = np.broadcast_to(np.rint(_LARGEST * encoded), (rows, columns, 3))
            write_file(target / f"{u:03d}_{v:03d}.ppm", head + view.astype(">u2").tobytes())
    write_readme(
        target,
        "JPEG Pleno light field coders",
        f"CCC_RRR.ppm: {across} x {down} views of {columns} x {rows} pixels, column and row from the upper left, sRGB.",
        "errors, truth, the camera.",
        {"full code, in the units of the light field": scale},
    )
