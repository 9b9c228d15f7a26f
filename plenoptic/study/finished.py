"""Renderings of studies are whole or do not count."""

from __future__ import annotations

from plenoptic.rendering.exposure import Exposure


def finished(shot: Exposure) -> Exposure:
    """The exposure, or KeyboardInterrupt where it was interrupted: a part of it would be a wrong number.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> from plenoptic.study.finished import finished
    >>> finished(pl.Exposure(np.ones((1, 1, 1)))).image.shape
    (1, 1, 1)
    """
    if shot.interrupted:
        raise KeyboardInterrupt
    return shot
