"""Settings of a render that affect the expectation of the image or its random numbers."""

from __future__ import annotations

import enum

from plenoptic.core.values import checked_field, choice, positive, value, whole
from plenoptic.optics.coatings.surface_powers import checked_reflectance


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
class Ghosts:
    """Ghosts in an image: light that two surfaces of the lens reflect. See `render`.

    Paths start on the pixels, pass the rear of the lens, and follow a pair of surfaces that is drawn by its share of
    the light. Each surface reflects and transmits unpolarised light; one without coating is bare. The image itself
    loses light only if the lens has coatings, see `coated`. Ground edges, the barrel and particles throw no ghosts.

    Parameters
    ----------
    orders : int, optional
        Number of reflections: 2, and no other. Four bring the square of that light or less: 0.045 % of the image in a
        bare Cooke triplet, where two bring 2.28 %.
    sensor : float, optional
        Reflectance of the sensor of a camera without microlenses, such as `sensor.silicon_reflectance`; None: none.
    array : float, optional
        Reflectance of the face of a microlens array towards the lens, as a plane at its first vertex that is
        perpendicular to the axis: right for flat faces, while curved ones spread the light; None: none.
    samples : int, optional
        Paths of ghosts for each pixel; None: a quarter of those of the image.

    Raises
    ------
    InvalidValueError
        If a number is out of range.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> camera = pl.camera.example_camera(pl.CameraKind.CONVENTIONAL, shape=(32, 32))
    >>> scene, options = pl.shapes.white_plane(), {"samples": 16, "progress": False}
    >>> image, both = (pl.render(scene, camera, ghosts=g, **options).image for g in (None, pl.rendering.Ghosts()))
    >>> bool(0.01 < both.mean() / image.mean() - 1.0 < 0.1)
    True
    """

    orders: int = checked_field(whole, default=2, at_least=2, at_most=2)
    sensor: float | None = checked_field(checked_reflectance, default=None)
    array: float | None = checked_field(checked_reflectance, default=None)
    samples: int | None = checked_field(whole, default=None, at_least=1)


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
    ghosts: Ghosts | None = None
