"""Portable float maps (PFM), the files of depth and disparity of many benchmarks."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.files.atomic_file import write_file
from plenoptic.core.files.file_limits import DEFAULT, FileLimits
from plenoptic.core.files.images import read_linear
from plenoptic.errors import FileError


def read_pfm(path: str | os.PathLike[str], *, limits: FileLimits = DEFAULT) -> NDArray[np.float32]:
    """Read a portable float map of one channel, such as a true depth or disparity.

    Parameters
    ----------
    path : path-like
    limits : FileLimits
        The size of the file, and of the image.

    Returns
    -------
    (H, W) float32 ndarray
        Row 0 at the top, multiplied by the scale of the file's header; inf and nan as stored.

    Raises
    ------
    FileError
        If the file is missing, damaged, or of colours.

    References
    ----------
    P. Debevec's format: https://www.pauldebevec.com/Research/HDR/PFM/

    Examples
    --------
    >>> import pathlib, tempfile, numpy as np, plenoptic as pl
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "depth.pfm"
    ...     _ = path.write_bytes(b"Pf 2 1 -1.0 " + np.array([1.0, 2.0], dtype="<f4").tobytes())
    ...     pl.images.read_pfm(path)
    array([[1., 2.]], dtype=float32)
    """
    image = read_linear(path, limits=limits)
    if image.shape[2] != 1:
        raise FileError(f"{os.fspath(path)!r} has {image.shape[2]} channels; a map has one: use read_linear")
    return image[:, :, 0]


def write_pfm(path: Path, plane: NDArray[np.floating[Any]]) -> None:
    """A plane (H, W) as a portable float map: float32, little-endian, the lowest row first."""
    rows, columns = plane.shape
    head = f"Pf\n{columns} {rows}\n-1\n".encode("ascii")
    write_file(path, head + np.ascontiguousarray(plane[::-1], dtype="<f4").tobytes())
