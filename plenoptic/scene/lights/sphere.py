"""Spheres that light a scene."""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.values import LARGEST_LENGTH, Floats, Given, checked_field, length_in_mm, value
from plenoptic.errors import SceneError
from plenoptic.scene.geometry.mesh import Mesh
from plenoptic.scene.lights.fields import channel_mean, place_in_mm
from plenoptic.scene.materials.emissive import Emissive
from plenoptic.scene.textures.color import Colour, as_colour

_SUBDIVISIONS = 3
_SMALLEST = 1e-9


@value
class SphereLight:
    """A sphere that emits the same radiance outwards, from every point in all directions.

    It is rendered as a body of 1280 triangles whose total area is that of the sphere: so all the light it
    emits, 4 pi^2 radius^2 radiance, is the sphere's. Its corners lie 0.24 % of the radius outside the sphere and the
    middles of its facets up to 0.22 % inside. It is seen by the camera like any surface.

    Parameters
    ----------
    center : (3,) array
        mm.
    radius : float
        mm, above 0 and at least 1e-9 of the largest coordinate of the centre.
    radiance : float or (float, float, float)
        Emitted radiance in scene units, 0 or more: one number, or (red, green, blue).

    Raises
    ------
    InvalidValueError
        Of another shape, a radius that is not above 0, or a radiance that is not finite.
    SceneError
        Coordinates that are not finite or beyond 1e15 mm, a radius that vanishes beside them, a negative radiance.

    Examples
    --------
    >>> import plenoptic as pl
    >>> bulb = pl.lights.SphereLight((0, 100, -400), radius=15, radiance=20.0)
    >>> bulb
    SphereLight(center=[0.0, 100.0, -400.0], radius=15.0, radiance=20.0)
    >>> len(bulb.mesh().faces)
    1280
    """

    center: Given[Floats, ArrayLike] = checked_field(place_in_mm)
    radius: float = checked_field(length_in_mm)
    radiance: Colour = checked_field(as_colour, default=1.0)

    def __post_init__(self) -> None:
        radius, farthest = self.radius, float(np.abs(self.center).max())
        if radius < _SMALLEST * farthest:
            raise SceneError(
                f"radius is {radius:g} mm; around center {self.center.tolist()} mm it must be at least "
                f"{_SMALLEST * farthest:g} mm, so move the scene to the origin or give a PointLight"
            )
        if not farthest + 1.01 * radius <= LARGEST_LENGTH:
            raise SceneError(
                f"radius is {radius:g} mm; around center {self.center.tolist()} mm the sphere must stay within "
                f"{LARGEST_LENGTH:g} mm, so reduce it"
            )

    @property
    def area(self) -> float:
        """Area of the sphere and of its mesh, mm^2.

        Examples
        --------
        >>> import plenoptic as pl
        >>> round(pl.lights.SphereLight((0, 0, 0), radius=0.5).area, 6)
        3.141593
        """
        return 4 * math.pi * self.radius**2

    @property
    def power(self) -> float:
        """All the light it emits, the mean of its channels, radiance mm^2 sr: pi radiance area.

        Examples
        --------
        >>> import plenoptic as pl
        >>> round(pl.lights.SphereLight((0, 0, 0), radius=0.5, radiance=(1, 2, 3)).power, 6)
        19.739209
        """
        return math.pi * self.area * channel_mean(self.radiance)

    def moved(self, matrix: Floats, scale: float) -> SphereLight:
        """The light where a (4, 4) similarity of that scale puts it; its radiance stays."""
        center = matrix[:3, :3] @ self.center + matrix[:3, 3]
        return dataclasses.replace(self, center=center, radius=scale * self.radius)

    def mesh(self) -> Mesh:
        """The light as 1280 emissive triangles, an icosahedron subdivided three times, that face outwards.

        Examples
        --------
        >>> import plenoptic as pl
        >>> pl.lights.SphereLight((0, 0, 0), radius=2.0).mesh()
        Mesh('light', 642 vertices, 1280 triangles, Emissive())
        """
        vertices, faces = _body()
        return Mesh(self.center + self.radius * vertices, faces, Emissive(self.radiance), name="light")


@functools.cache
def _body() -> tuple[Floats, NDArray[np.int64]]:
    """Vertices (642, 3) and faces (1280, 3) of a nearly round body around the origin with the area 4 pi."""
    vertices, faces = _icosahedron()
    for _ in range(_SUBDIVISIONS):
        vertices, faces = _subdivide(vertices, faces)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    area = 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
    return vertices * math.sqrt(4 * math.pi / area), faces


def _icosahedron() -> tuple[Floats, NDArray[np.int64]]:
    """Two poles on z and two rings of five between them, at the height 1/sqrt(5), one turned by half a step."""
    angle = 2 * math.pi / 10 * np.arange(10)
    height = np.where(np.arange(10) % 2 == 0, 1.0, -1.0) / math.sqrt(5)
    ring = np.stack([2 / math.sqrt(5) * np.cos(angle), 2 / math.sqrt(5) * np.sin(angle), height], axis=1)
    k = np.arange(10)
    upper, lower = k[::2], k[1::2]
    faces = [
        np.stack([upper, (upper + 1) % 10, (upper + 2) % 10], axis=1),
        np.stack([lower, (lower + 2) % 10, (lower + 1) % 10], axis=1),
        np.stack([upper, (upper + 2) % 10, np.full(5, 10)], axis=1),
        np.stack([lower, np.full(5, 11), (lower + 2) % 10], axis=1),
    ]
    return np.concatenate([ring, [[0, 0, 1.0], [0, 0, -1.0]]]), np.concatenate(faces)


def _subdivide(vertices: Floats, faces: NDArray[np.int64]) -> tuple[Floats, NDArray[np.int64]]:
    """Four triangles for each one, with the middles of its edges moved out to the unit sphere."""
    sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    edges, numbers = np.unique(sides, axis=0, return_inverse=True)
    middles = vertices[edges].sum(axis=1)
    middles /= np.linalg.norm(middles, axis=1, keepdims=True)
    a, b, c = faces.T
    ab, bc, ca = numbers.reshape(3, -1) + len(vertices)
    quarters = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
    return np.concatenate([vertices, middles]), np.concatenate([np.stack(q, axis=1) for q in quarters])
