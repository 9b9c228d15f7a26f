"""Images of points on the sensor, a few pixels large, and their landing points."""

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
    """Images of points on the sensor, the point-spread functions of the whole camera; made by `point_spread`.

    Shapes are those for one point; for n points, n comes first in all of them. Only the part of the sensor that the
    light of a point reaches is kept, equally large for all points.

    Attributes
    ----------
    image : (rows, columns) array
        Value of a pixel for a small Lambertian emitter at the point that faces along the camera's axis, for each
        unit of its radiance and each mm^2 of its area: sr/mm^2.
    standard_error : (rows, columns) array or None
        Of `image`; None with fewer than two replicates.
    corner : (2,) array of int
        Row and column on the sensor of the first pixel of `image`.
    points : (3,) array
        The points in the world in mm.
    light : float
        Projected solid angle in sr of the light that lands on the sensor: the sum of the image times the area of a
        pixel.
    light_error : float or None
        Standard error of `light`.
    centroid : (2,) array
        Mean x and y on the sensor, in its own axes, of the light that lands on it, mm; NaN where none does.
    centroid_error : (2,) array or None
        Its standard error.
    fates : tuple of (str, int or None)
        Fates of rays, and the lens element that stops them: "landed", "beside_sensor", "beside_opening" (on a
        pixel, but beside the part of it that sees light) or a lower-case name of `RayStatus`.
    fractions : (fates,) array
        The part of the rays that met each fate. They were aimed closely around the lens's opening, not everywhere. Rays
        are counted, not light: one that lands through dust or a grey mask has landed.
    sensor : Sensor
    rays : int
        Rays of each point.

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
    def _several(self) -> bool:
        return self.points.ndim == 2

    @property
    def regions(self) -> tuple[tuple[slice, slice], ...]:
        """Rows and columns of the sensor that are kept of each point, as `render` takes them; one entry a point."""
        rows, columns = self.image.shape[-2:]
        return tuple((slice(r, r + rows), slice(c, c + columns)) for r, c in np.atleast_2d(self.corner).tolist())

    @property
    def fraction_by_fate(self) -> dict[str, Floats]:
        """`fractions` by name alone, over all lens elements."""
        fractions: dict[str, Floats] = {}
        for k, (name, _) in enumerate(self.fates):
            fractions[name] = fractions.get(name, 0.0) + self.fractions[..., k]
        return fractions

    def of(self, number: int) -> CameraSpread:
        """The spread of one of several points.

        Parameters
        ----------
        number : int
            Which of the points, from 0; an InvalidValueError if there is no such point.

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
        if not self._several:
            return self

        arrays = {name: array[number] for name, array in vars(self).items() if isinstance(array, np.ndarray)}
        of_one: dict[str, Any] = {name: each if each.ndim else float(each) for name, each in arrays.items()}
        return dataclasses.replace(self, **of_one)

    def whole(self) -> Floats:
        """The image on the whole sensor: (rows, columns), or (n, rows, columns) for several points."""
        images = self.image if self._several else self.image[None]
        full = np.zeros((len(images), *self.sensor.shape))
        for target, image, region in zip(full, images, self.regions, strict=True):
            target[region] = image
        return full if self._several else full[0]

    def __repr__(self) -> str:
        count, (rows, columns) = len(np.atleast_2d(self.points)), self.image.shape[-2:]
        landed = 100 * float(np.mean(self.fraction_by_fate["landed"]))
        return (
            f"<CameraSpread of {count} point{'s' * (count != 1)}: {rows} x {columns} pixels, "
            f"{landed:.3g} % of {self.rays} rays landed>"
        )


@result
class LandingPoints:
    """Landing points on the sensor of rays from points; made by `landing_points`.

    Attributes
    ----------
    position : (m, 2) array
        x and y on the sensor, in its own axes, of the rays that land on it, mm.
    weight : (m,) array
        Projected solid angle at the point that each ray stands for, sr; at ideal thin lenses and microlenses as it is
        on the sensor, see `point_spread`. Less where dust, a mask, an opaque microlens or the pixel's response to
        directions takes some of its light: 0 where they take all.
    source : (m,) array of int
        Which of the points each ray comes from.
    microlens : (m, 2) array or None
        Centre of the microlens that each ray passed, as designed, on the plane of the array, mm; None without
        microlenses.
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
