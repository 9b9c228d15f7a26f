"""BSDF of a material: its distribution over directions, as numbers to look at or to test."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.values import Floats, frozen_array, numbers
from plenoptic.errors import InvalidValueError, SceneError
from plenoptic.scene.materials.build_materials import bsdf_record
from plenoptic.scene.materials.diffuse import Lambertian
from plenoptic.scene.materials.kernels.bsdf import fill_bsdf_samples, fill_bsdf_values
from plenoptic.scene.materials.material_records import Bsdf
from plenoptic.scene.materials.registry import MATERIALS, Material


class Scattered(NamedTuple):
    """Values of a bidirectional distribution. See `evaluate`."""

    value: Floats
    """(n, C), 1/sr: scattered radiance per radiance from the light's direction and solid angle, with the cosine."""
    density: Floats
    """(n,), 1/sr: with which `draw` draws the light's direction; 0 for mirrors, whose direction is no solid angle."""


class Drawn(NamedTuple):
    """Directions sampled by a material's BSDF. See `draw`."""

    to_light: Floats
    """(n, 3), unit length."""
    weight: Floats
    """(n, C): value over density; 0 where the path ends."""
    density: Floats
    """(n,), 1/sr; inf where there is only one direction to choose, or two."""


def evaluate(material: Material, to_viewer: ArrayLike, to_light: ArrayLike, *, front: bool = True) -> Scattered:
    """Evaluate the BSDF of a material for a direction to the viewer and one to the light.

    Parameters
    ----------
    material : Material
        Without textures.
    to_viewer : (n, 3) or (3,) array
        Directions in the frame whose z is the normal on the viewer's side: z above 0. Brought to unit length.
    to_light : (n, 3) or (3,) array
        The same frame; z below 0 is behind the surface.
    front : bool
        Whether the viewer sees the front: glass lies behind the front.

    Returns
    -------
    Scattered
        C = 1 where the material is grey, otherwise 3. Radiance that comes out of another medium is scaled by the square
        of the ratio of the indices.

    Raises
    ------
    InvalidValueError
        Something that is not a material, or directions of another shape, without length, or from behind.
    SceneError
        A textured material.

    Examples
    --------
    >>> import plenoptic as pl
    >>> at_60_degrees = pl.bsdf.evaluate(pl.Lambertian(0.8), (0, 0, 1), (3**0.5, 0, 1))
    >>> at_60_degrees.value.round(6).tolist()             # 0.8 / pi cos 60
    [[0.127324]]
    """
    viewers, lights = _to_viewer(to_viewer), _directions(to_light, "to_light")
    if 1 not in (len(viewers), len(lights)) and len(viewers) != len(lights):
        raise InvalidValueError(f"to_viewer has {len(viewers)} rows and to_light {len(lights)}; give as many, or one")
    viewers, lights = np.broadcast_arrays(viewers, lights)
    record = _record(material)
    scattered = Scattered(np.empty((len(viewers), record.base_color.shape[1])), np.empty(len(viewers)))
    fill_bsdf_values(*scattered, np.ascontiguousarray(viewers), np.ascontiguousarray(lights), bool(front), record)
    return scattered


def draw(material: Material, to_viewer: ArrayLike, points: ArrayLike, *, front: bool = True) -> Drawn:
    """Draw directions to light as paths draw them.

    Parameters
    ----------
    material, to_viewer, front
        As for `evaluate`.
    points : (n, 3) array
        Numbers in [0, 1): two for the direction. Rough glass reflects at its sampled facet where the third is below the
        Fresnel reflectance there, and otherwise refracts; smooth glass compares the first. Other materials ignore the
        third.

    Raises
    ------
    InvalidValueError
        As `evaluate`; numbers outside [0, 1).
    SceneError
        A textured material.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> drawn = pl.bsdf.draw(pl.Conductor(0.9), (0.6, 0, 0.8), np.zeros((1, 3)))
    >>> (drawn.to_light + 0.0).tolist(), drawn.weight.tolist(), drawn.density.tolist()
    ([[-0.6, 0.0, 0.8]], [[0.9]], [inf])
    """
    random_points = frozen_array(points, name="points", shape=(None, 3))
    if not np.all((random_points >= 0) & (random_points < 1)):
        raise InvalidValueError(
            "points has numbers outside [0, 1); take them from a random generator or pl.sobol_points"
        )
    viewers = np.broadcast_to(_to_viewer(to_viewer), (len(random_points), 3))
    record = _record(material)
    drawn = Drawn(
        np.empty((len(random_points), 3)),
        np.empty((len(random_points), record.base_color.shape[1])),
        np.empty(len(random_points)),
    )
    fill_bsdf_samples(*drawn, np.ascontiguousarray(viewers), random_points, bool(front), record)
    return drawn


def _directions(directions: ArrayLike, name: str) -> Floats:
    vectors = frozen_array(directions, name=name, shape=(3,) if numbers(directions, name).ndim == 1 else (None, 3))
    rows = np.atleast_2d(vectors)
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    if not np.all((length > 0) & np.isfinite(length)):
        raise InvalidValueError(f"{name} has directions without length; all must be finite and not 0, 0, 0")
    # What is at unit length to rounding keeps its bits.
    return np.where(np.abs(length - 1) > 1e-15, rows / length, rows)


def _to_viewer(directions: ArrayLike) -> Floats:
    viewers = _directions(directions, "to_viewer")
    if not np.all(viewers[:, 2] > 0):
        raise InvalidValueError("to_viewer has directions with z of 0 or less; z must point to the viewer's side")
    return viewers


def _record(material: Any) -> Bsdf:
    """The record of one material."""
    if type(material) not in MATERIALS:
        raise InvalidValueError(f"material is {material!r}; it must be a material, such as pl.Lambertian(0.5)")
    row = material.row()
    if row.textures:
        raise SceneError(f"{material!r} has textures; give the material at one of their texels")
    channels = 1 if row._replace(emission=0.0).is_grey else 3
    record = bsdf_record([material], channels)
    if record is not None:
        return record
    white = bsdf_record([Lambertian(1.0)], channels)
    assert white is not None
    return white._replace(base_color=np.zeros((1, channels)))
