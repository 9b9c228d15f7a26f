"""Storage of the sums of unfinished tiles: in memory, or in a checkpoint file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from plenoptic.core.values import Floats
from plenoptic.rendering.schedule.progress import Progress
from plenoptic.rendering.tile import TileResult

if TYPE_CHECKING:
    from plenoptic.core.files.record_log import Entry


class Sums(Protocol):
    """Storage of the sums of unfinished tiles."""

    def keep(self, i: int, result: TileResult, progress: Progress, entry: Entry | None) -> None:
        """Store the result of a tile; `entry` is its record in a file, if any."""

    def of(self, i: int) -> Floats | None:
        """Latest stored sums of a tile; None without any."""


class SumsInMemory:
    """Sums of unfinished tiles in memory."""

    def __init__(self) -> None:
        self._sums: dict[int, Floats] = {}

    def keep(self, i: int, result: TileResult, progress: Progress, entry: Entry | None) -> None:
        """See `Sums`."""
        if progress.goes_on(i):
            self._sums[i] = result.sums
        else:
            self.drop(i)

    def drop(self, i: int) -> None:
        """Discard the sums of a tile."""
        self._sums.pop(i, None)

    def of(self, i: int) -> Floats | None:
        """See `Sums`."""
        return self._sums.get(i)
