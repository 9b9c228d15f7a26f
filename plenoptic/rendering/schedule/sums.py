"""Storage of the sums of unfinished tiles: in memory, or in the file of a checkpoint."""

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
        """Keep the result of a tile; `entry`: its record, where it is stored already."""

    def of(self, i: int) -> Floats | None:
        """The last that were kept of a tile; None where there are none."""


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
        """Let go of those of a tile."""
        self._sums.pop(i, None)

    def of(self, i: int) -> Floats | None:
        """See `Sums`."""
        return self._sums.get(i)
