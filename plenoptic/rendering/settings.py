"""Settings of a render that affect the expectation of the image or its random numbers."""

from __future__ import annotations

import enum

from plenoptic.core.values import choice, positive, set_field, value, whole


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
    max_bounces, caustics, clamp, sampler
        As for `render`.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.rendering.RenderSettings(max_bounces=2).sampler.name
    'SOBOL'
    """

    max_bounces: int = 8
    caustics: Caustics = Caustics.INCLUDE
    clamp: float | None = None
    sampler: Sampler = Sampler.SOBOL

    def __post_init__(self) -> None:
        set_field(self, "max_bounces", whole(self.max_bounces, "max_bounces", at_least=0))
        set_field(self, "caustics", choice(self.caustics, Caustics, "caustics"))
        set_field(self, "clamp", None if self.clamp is None else positive(self.clamp, "clamp"))
        set_field(self, "sampler", choice(self.sampler, Sampler, "sampler"))
