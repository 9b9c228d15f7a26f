"""Points on the outlines of stops."""

from __future__ import annotations

import numpy as np

from plenoptic.core.values import Floats


def divided(corners: Floats, n: int) -> Floats:
    """The corners (k, 2) of a polygon, and points that divide its edges evenly: at least n in all, not closed."""
    per_edge = -(-n // len(corners))
    share = np.arange(per_edge) / per_edge
    after = np.roll(corners, -1, axis=0)
    return np.asarray((corners[:, None] + share[:, None] * (after - corners)[:, None]).reshape(-1, 2))
