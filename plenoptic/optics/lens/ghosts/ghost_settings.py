"""Ghosts in images: the reflections that are traced."""

from __future__ import annotations

from plenoptic.core.values import check_kind, checked_field, value, whole
from plenoptic.optics.coatings.surface_powers import checked_reflectance


@value
class Ghosts:
    """Ghosts in an image: light that two surfaces of the lens reflect. See `render` and `point_spread`.

    Paths start on the pixels, pass the rear of the lens, and follow a pair of surfaces that is drawn by its share of
    the light. Each surface reflects and transmits unpolarised light; one without coating is bare. The image itself
    loses light only if the lens has coatings, see `coated`. Ground edges and the barrel throw no ghosts.
    Points and particles send rays through the surfaces of each pair in the order of the light.

    Parameters
    ----------
    orders : int, optional
        Number of reflections: 2, and no other. Four bring the square of that light or less: 0.045 % of the image in a
        bare Cooke triplet, where two bring 2.28 %.
    sensor : float, optional
        Reflectance of the sensor as a mirror, such as `sensor.silicon_reflectance`, also behind microlenses, which its
        light passes again; None: none.
    array : float, optional
        Reflectance of each face of SPHERICAL microlenses, or of a plane at the first vertex of those of other models;
        None: none.
    samples : int, optional
        Paths of ghosts for each pixel in `render`; None: a quarter of those of the image.

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


def checked_ghosts(ghosts: Ghosts, name: str) -> Ghosts:
    """Check that an argument is of the kind; InvalidValueError otherwise."""
    check_kind(ghosts, name, Ghosts, "pl.rendering.Ghosts()")
    return ghosts
