"""Parts to be merged: files that are loaded on demand, and stores that are read by rows."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

from numpy.typing import NDArray

from plenoptic.errors import FileError
from plenoptic.rendering.exposure import Exposure
from plenoptic.rendering.exposure_files import metadata_of_store, rows_of_store
from plenoptic.rendering.exposure_metadata import ExposureMetadata, metadata_of, pixels_of

Arrays = Mapping[str, NDArray[Any]]


class FilePart:
    """An exposure that is loaded when its first rows are requested, and released after the last ones."""

    def __init__(self, name: str, metadata: ExposureMetadata, load: Callable[[], Exposure]) -> None:
        self.name, self.metadata = name, metadata
        self._load, self._arrays = load, dict[str, NDArray[Any]]()

    def rows(self, first: int, end: int) -> Arrays:
        """Views of rows, requested from top to bottom; FileError if the file has changed since `metadata` was read."""
        if not self._arrays:
            exposure = self._load()
            if metadata_of(exposure) != self.metadata:
                raise FileError(f"{self.name} has been changed while parts were merged; merge them again")
            self._arrays = pixels_of(exposure)
        rows = {name: array[first:end] for name, array in self._arrays.items()}
        if end == self.metadata.shape[0]:
            self._arrays = {}
        return rows


class StorePart:
    """A zarr store, of which only the requested rows are read."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.name, self.metadata = os.fspath(path), metadata_of_store(path)

    def rows(self, first: int, end: int) -> Arrays:
        """Read rows from the disk."""
        return pixels_of(rows_of_store(self.name, self.metadata, first, end))


Part: TypeAlias = FilePart | StorePart


def memory_part(name: str, exposure: Exposure) -> FilePart:
    """An exposure in memory."""
    return FilePart(name, metadata_of(exposure), lambda: exposure)
