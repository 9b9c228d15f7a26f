"""Results of forward tracing: point-spread functions, and intersections of single rays with the sensor."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats, result, whole
from plenoptic.errors import InvalidValueError
from plenoptic.optics.sensor.sensor import Sensor


@result
class CameraSpread:
    """Point-spread functions of a whole camera; made by `point_spread`.

    Shapes are for one point; for n points, all have n as the first dimension. Images are cropped to the part of the
    sensor that the light of a point reaches, of the same size for all points.

    Attributes
    ----------
    image : (rows, columns) array
        Value of each pixel for a small Lambertian emitter at the point that faces along the camera's axis, per unit of
        radiance and mm^2 of its area: sr/mm^2.
    standard_error : (rows, columns) array or None
        Standard error of each pixel of `image`; None with fewer than two replicates.
    corner : (2,) array of int
        Row and column on the sensor of the first pixel of `image`.
    points : (3,) array
        The points in the world in mm.
    light : float
        Projected solid angle in sr of the light that reaches the sensor: sum of the image times the area of a pixel.
    light_error : float or None
        Standard error of `light`.
    centroid : (2,) array
        Mean x and y on the sensor, in its own axes, of the light that reaches it, mm; NaN if none does.
    centroid_error : (2,) array or None
        Standard error of `centroid` in mm.
    fates : tuple of (str, int or None)
        Possible fates of a ray, and the lens element that stops it: "landed", "beside_sensor", "beside_opening" (on a
        pixel, but outside its sensitive area) or a lower-case name of `RayStatus`.
    fractions : (fates,) array
        Fraction of the rays with each fate. Rays are aimed at a polygon close around the lens's opening. Rays are
        counted, not light: one attenuated by dust or a grey mask has landed.
    sensor : Sensor
    rays : int
        Rays per point.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.camera.example_camera(pl.CameraKind.CONVENTIONAL)
    >>> spread = pl.point_spread(camera, (5.0, 0.0, -404.0))
    >>> spread.whole().shape, bool(abs(spread.image.sum() * 0.01**2 / spread.light - 1) < 1e-12)
    ((512, 512), True)
    >>> x, y = spread.centroid          # upside down on the sensor; images are turned when they are read out
    >>> bool(x < 0)
    True
    """

    image: Floats
    standard_error: Floats | None
    corner: NDArray[np.int64]
    points: Floats
    light: Floats | float
    light_error: Floats | float | None
    centroid: Floats
    centroid_error: Floats | None
    fates: tuple[tuple[str, int | None], ...]
    fractions: Floats
    sensor: Sensor
    rays: int

    @property
    def _is_batch(self) -> bool:
        return self.points.ndim == 2

    @property
    def regions(self) -> tuple[tuple[slice, slice], ...]:
        """Rows and columns of the sensor of each point's image, as for `render`; one entry per point."""
        rows, columns = self.image.shape[-2:]
        return tuple((slice(r, r + rows), slice(c, c + columns)) for r, c in np.atleast_2d(self.corner).tolist())

    @property
    def fraction_by_fate(self) -> dict[str, Floats]:
        """`fractions` by name, summed over all lens elements."""
        fractions: dict[str, Floats] = {}
        for k, (name, _) in enumerate(self.fates):
            fractions[name] = fractions.get(name, 0.0) + self.fractions[..., k]
        return fractions

    def of(self, number: int) -> CameraSpread:
        """Select one of several points.

        Parameters
        ----------
        number : int
            Index of the point, from 0; InvalidValueError if there is no such point.

        Examples
        --------
        >>> import plenoptic as pl
        >>> camera = pl.camera.example_camera(pl.CameraKind.CONVENTIONAL)
        >>> pl.point_spread(camera, [(0, 0, -404), (5, 0, -404)], rays=1024).of(1).points.tolist()
        [5.0, 0.0, -404.0]
        """
        count = len(np.atleast_2d(self.points))
        if whole(number, "number", at_least=0) >= count:
            raise InvalidValueError(f"number is {number}; there are {count} points: use 0 to {count - 1}")
        if not self._is_batch:
            return self

        arrays = {name: array[number] for name, array in vars(self).items() if isinstance(array, np.ndarray)}
        values: dict[str, Any] = {name: each if each.ndim else float(each) for name, each in arrays.items()}
        return dataclasses.replace(self, **values)

    def whole(self) -> Floats:
        """Image on the whole sensor: (rows, columns), or (n, rows, columns) for several points."""
        images = self.image if self._is_batch else self.image[None]
        on_sensor = np.zeros((len(images), *self.sensor.shape))
        for target, image, region in zip(on_sensor, images, self.regions, strict=True):
            target[region] = image
        return on_sensor if self._is_batch else on_sensor[0]

    def __repr__(self) -> str:
        count, (rows, columns) = len(np.atleast_2d(self.points)), self.image.shape[-2:]
        landed = 100 * float(np.mean(self.fraction_by_fate["landed"]))
        return (
            f"<CameraSpread of {count} point{'s' * (count != 1)}: {rows} x {columns} pixels, "
            f"{landed:.3g} % of {self.rays} rays landed>"
        )


@result
class LandingPoints:
    """Intersections with the sensor of single rays from points; made by `landing_points`.

    Attributes
    ----------
    position : (m, 2) array
        x and y on the sensor, in its own axes, of the rays that reach it, mm.
    weight : (m,) array
        Projected solid angle of each ray at the point, sr; with ideal lenses or microlenses that on the sensor, see
        `point_spread`. Reduced by dust, masks, opaque microlenses and the pixel's angular response, down to 0.
    source : (m,) array of int
        Index of the point from which each ray comes.
    microlens : (m, 2) array or None
        Designed centre of the microlens that each ray passes, on the plane of the array, mm; None without microlenses.
    index : (m, 2) array of int or None
        Its lattice indices, those of `MicrolensArray.lenses`; in FREE lattices (number, 0).

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> camera = pl.camera.example_camera()
    >>> landed = pl.camera.landing_points(camera, (0.0, 0.0, -404.0))
    >>> middle = (landed.index == 0).all(axis=1)          # through the microlens on the axis
    >>> bool(np.abs(landed.position[middle]).max() < 0.03)
    True
    """

    position: Floats
    weight: Floats
    source: NDArray[np.int64]
    microlens: Floats | None
    index: NDArray[np.int64] | None

    def __repr__(self) -> str:
        return f"<LandingPoints: {len(self.position)} rays>"
