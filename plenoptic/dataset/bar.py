"""Progress bar of a data set."""

from __future__ import annotations

from types import TracebackType
from typing import Any

from plenoptic.core.progress.bar import DELAY, Poller, load_tqdm
from plenoptic.core.progress.compiling import compiling_text


class FrameBar:
    """A bar over all pieces of work, with the time left; nothing where it is not to be shown."""

    def __init__(self, total: int, *, show: bool) -> None:
        self._bar: Any = load_tqdm()(total=total, unit="part") if show else None
        self._watch = Poller(self._look) if show else None

    def __enter__(self) -> FrameBar:
        if self._watch is not None:
            self._watch.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._watch is not None:
            self._watch.__exit__(kind, error, trace)
            self._bar.close()

    def done(self) -> None:
        """One piece more."""
        if self._bar is not None:
            self._bar.update()

    def kept(self) -> None:
        """Count a piece that was present already: the time left is that of pieces to be rendered."""
        if self._bar is not None and not self._bar.disable:  # by the variable TQDM_DISABLE
            self._bar.initial += 1
            self._bar.n += 1

    def _look(self) -> None:
        self._bar.set_postfix_str(compiling_text("scene", after=DELAY))
