"""NPZ files of NumPy: named arrays, compressed."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.files.atomic_file import write_file
from plenoptic.core.files.file_limits import FileLimits, allowed_memory, read_file
from plenoptic.errors import FileError


def write_npz(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write arrays to an NPZ file, as a whole or not at all."""
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    write_file(path, file.getvalue())


def read_npz(path: Path, limits: FileLimits) -> Mapping[str, NDArray[Any]]:
    """The arrays of an NPZ file, which may claim to be of any size; FileError if it cannot be read."""
    content = read_file(path, limits)
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            memory = sum(entry.file_size for entry in archive.infolist())
        if memory > allowed_memory(len(content), limits):
            raise ValueError(f"it would take {memory} bytes; give limits=pl.images.FileLimits(memory={memory})")
        with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except (ValueError, OSError, EOFError, MemoryError, KeyError, zipfile.BadZipFile, RuntimeError) as error:
        raise FileError(f"{str(path)!r} cannot be read: {error}; restore it from its origin") from None
