"""Settings of a render that affect the expectation of the image or its random numbers."""

from __future__ import annotations

import enum

from plenoptic.core.values import checked_field, choice, positive, value, whole
from plenoptic.optics.lens.ghosts.ghost_settings import Ghosts as Ghosts
from plenoptic.optics.lens.ghosts.ghost_settings import checked_ghosts


class Sampler(enum.IntEnum):
    """Sampler of the points on pixel, pupil and scene.

    SOBOL: scrambled Sobol points for each replicate. RANDOM: independent samples, for comparison.

    Examples
    --------
    See `render`.
    """

    SOBOL = 0
    RANDOM = 1


class Caustics(enum.IntEnum):
    """Treatment of caustics: light that mirrors, polished glass or panes cast onto rough surfaces.

    Examples
    --------
    See `render`.
    """

    INCLUDE = 0
    EXCLUDE = 1


@value
class RenderSettings:
    """Settings of `render` other than scene, camera, samples and seed.

    Parameters
    ----------
    max_bounces, caustics, clamp, sampler, ghosts
        As for `render`.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.rendering.RenderSettings(max_bounces=2).sampler.name
    'SOBOL'
    """

    max_bounces: int = checked_field(whole, default=8, at_least=0)
    caustics: Caustics = checked_field(choice, default=Caustics.INCLUDE, kind=Caustics)
    clamp: float | None = checked_field(positive, default=None)
    sampler: Sampler = checked_field(choice, default=Sampler.SOBOL, kind=Sampler)
    ghosts: Ghosts | None = checked_field(checked_ghosts, default=None)
