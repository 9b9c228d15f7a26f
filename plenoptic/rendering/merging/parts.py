"""What is merged: exposures in memory, files that are read when their rows are wanted, and stores, row by row."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from typing import Any, Protocol

from numpy.typing import NDArray

from plenoptic.errors import FileError
from plenoptic.rendering.exposure import Exposure
from plenoptic.rendering.exposure_metadata import ExposureMetadata, metadata_of, pixels_of
from plenoptic.rendering.stores import metadata_of_store, rows_of_store

Arrays = Mapping[str, NDArray[Any]]


class Part(Protocol):
    """One exposure of those that are merged, of which rows are asked for from the top down."""

    @property
    def name(self) -> str:
        """How errors call it."""
        ...

    @property
    def head(self) -> ExposureMetadata:
        """All but the pixels."""
        ...

    def rows(self, first: int, end: int) -> Arrays:
        """Its arrays in rows that count from its own first one."""
        ...


class HeldPart:
    """An exposure in memory."""

    def __init__(self, name: str, exposure: Exposure) -> None:
        self.name, self.head = name, metadata_of(exposure)
        self._arrays = pixels_of(exposure)

    def rows(self, first: int, end: int) -> Arrays:
        """Views of its arrays."""
        return {name: array[first:end] for name, array in self._arrays.items()}


class FilePart:
    """A file that is read as a whole: when its first rows are asked for, and let go of after the last ones."""

    def __init__(self, name: str, head: ExposureMetadata, load: Callable[[], Exposure]) -> None:
        self.name, self.head = name, head
        self._load, self._held = load, dict[str, NDArray[Any]]()

    def rows(self, first: int, end: int) -> Arrays:
        """Views of its arrays; a FileError where it is not the file any more that the head is of."""
        if not self._held:
            exposure = self._load()
            if metadata_of(exposure) != self.head:
                raise FileError(f"{self.name} has been changed while parts were merged; merge them again")
            self._held = pixels_of(exposure)
        found = {name: array[first:end] for name, array in self._held.items()}
        if end == self.head.shape[0]:
            self._held = {}
        return found


class StorePart:
    """A zarr store, of which only the rows are read that are asked for."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.name, self.head = os.fspath(path), metadata_of_store(path)

    def rows(self, first: int, end: int) -> Arrays:
        """Read from the disk."""
        return pixels_of(rows_of_store(self.name, self.head, first, end))
