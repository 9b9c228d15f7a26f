"""The figures of this package: in notebooks each is seen once."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure


class ShownOnce(Figure):  # type: ignore[misc]
    """A figure of pyplot that leaves pyplot when a notebook shows it as a cell's result.

    The inline backend shows all of pyplot's figures at the end of a cell, one that was just shown as its result too.
    """

    def _repr_mimebundle_(self, **_: Any) -> dict[str, Any]:
        """Add nothing to IPython's own display of a figure."""
        if "inline" in mpl.get_backend():
            from matplotlib.pyplot import close

            close(self)
        return {}
