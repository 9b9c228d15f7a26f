"""Choice of the engine of a call."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from plenoptic.errors import InvalidValueError

if TYPE_CHECKING:
    from plenoptic.core.engines.dask_engine import DaskCluster


def cluster_of(client: Any, threads: int | None) -> DaskCluster | None:
    """The workers of a client passed to a call; None: threads of this process run the jobs."""
    if client is None:
        return None
    if threads is not None:
        raise InvalidValueError(
            f"threads is {threads} and client is given; its workers bring their own threads: leave one of them out"
        )
    from plenoptic.core.engines.dask_engine import DaskCluster

    return DaskCluster(client)
