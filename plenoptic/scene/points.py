"""Particles and point clouds: luminous points, or small spheres, of a scene."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.values import (
    LARGEST_LENGTH,
    Floats,
    Given,
    check_kind,
    finite,
    frozen_array,
    numbers,
    positions,
    set_field,
    value,
)
from plenoptic.errors import InvalidValueError
from plenoptic.scene.geometry.moves import similarity
from plenoptic.scene.lights.sheet import Sheet


@value
class Points:
    """Particles: small luminous spheres, or points, that shine by themselves or scatter the light of a sheet.

    Their image is computed by rays from each particle to the lens; see `point_weights` and `Scene.points`. They light
    no surface and hide nothing. An image of a particle of diameter d is that of a disc of that diameter that faces each
    ray.

    Parameters
    ----------
    positions : (n, 3) array
        Centres in the world, mm.
    intensity : float, (n,) or (n, 3) array, optional
        Radiant intensity, radiance in scene units times mm^2, 0 or more: one for all, of each, or its red, green and
        blue. A sphere of diameter d and radiance L has the intensity L pi d^2 / 4, and so has a `lights.PointLight`.
    diameter : float or (n,) array, optional
        mm, 0 or more. 0: points.
    sheet : lights.Sheet, optional
        Light sheet, in place of `intensity`: the intensity is irradiance times `cross_section` times `phase`.
    cross_section : float or (n,) array, optional
        Scattering cross-section, mm^2. None: pi diameter^2 / 4.
    phase : (k, 2) array, optional
        Phase function of scattering: angles from the direction of the sheet in rad, ascending, and values in 1/sr,
        linear between them, whose integral over all directions is the albedo. The angle is that towards the centre of
        the camera's entrance pupil. None: 1 / (4 pi) in all directions.

    Raises
    ------
    InvalidValueError
        If shapes do not fit, a number is negative or not finite, or there is neither intensity nor sheet, or both.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> rng = np.random.default_rng(1)
    >>> particles = pl.Points(rng.uniform((-5, -5, -409), (5, 5, -399), (100, 3)), intensity=1e-3, diameter=0.02)
    >>> particles
    Points(100 particles)
    >>> shot = pl.render(pl.Scene(points=particles), pl.camera.example_camera(), samples=1, progress=False)
    """

    positions: Given[Floats, ArrayLike]
    _: dataclasses.KW_ONLY
    intensity: Given[Floats | None, ArrayLike | None] = Given(default=None)
    diameter: Given[Floats, ArrayLike] = Given(default=0.0)
    sheet: Sheet | None = None
    cross_section: Given[Floats | None, ArrayLike | None] = Given(default=None)
    phase: Given[Floats | None, ArrayLike | None] = Given(default=None)

    def __post_init__(self) -> None:
        set_field(self, "positions", positions(self.positions, name="positions", shape=("n", 3)))
        if not len(self.positions):
            raise InvalidValueError("positions is empty; give at least one particle (x, y, z) in mm")
        set_field(self, "diameter", self._of_each(self.diameter, "diameter"))
        if (self.intensity is None) == (self.sheet is None):
            sources = "both intensity and sheet are" if self.sheet is not None else "neither intensity nor sheet is"
            raise InvalidValueError(f"{sources} given; particles shine by themselves, or scatter the light of a sheet")
        if self.intensity is not None:
            set_field(self, "intensity", self._of_each(self.intensity, "intensity", coloured=True))
            if self.cross_section is not None or self.phase is not None:
                raise InvalidValueError("cross_section and phase need a sheet, whose light they scatter")
            return
        check_kind(self.sheet, "sheet", Sheet, "pl.lights.Sheet(...)")
        if self.cross_section is not None:
            set_field(self, "cross_section", self._of_each(self.cross_section, "cross_section"))
        if self.phase is not None:
            set_field(self, "phase", _checked_phase(self.phase))

    def _of_each(self, values: ArrayLike, name: str, *, coloured: bool = False) -> Floats:
        """Numbers (n,) of particles, or (n, 3) of colours, which may be one for all."""
        array, n = numbers(values, name), len(self.positions)
        if array.ndim == 0:
            array = np.broadcast_to(array, n)
        array = frozen_array(array, name=name, shape=(n, 3) if coloured and array.ndim == 2 else (n,))
        is_possible = (array >= 0) & (array <= LARGEST_LENGTH)
        if not is_possible.all():
            raise InvalidValueError(f"{name} holds {array[~is_possible][0]:g}; it must be finite and 0 or more")
        return array

    def __len__(self) -> int:
        return len(self.positions)

    def __repr__(self) -> str:
        kind = "" if self.sheet is None else ", in a light sheet"
        return f"Points({len(self)} particle{'s' * (len(self) != 1)}{kind})"

    @property
    def bounds(self) -> Floats:
        """(2, 3), mm: lowest and highest coordinates of the centres."""
        return np.stack([self.positions.min(axis=0), self.positions.max(axis=0)])

    def intensities(self, towards: ArrayLike) -> Floats:
        """Radiant intensity (n,) or (n, 3) of each particle in the direction of a point (3,) of the world.

        Forwards of a sheet for a particle at that point.

        Examples
        --------
        >>> import plenoptic as pl
        >>> sheet = pl.lights.Sheet((0, 0, -404), (1, 0, 0), (0, 0, 1), thickness=1.0, irradiance=4.0)
        >>> pl.Points([(0, 0, -404)], sheet=sheet, cross_section=1e-3).intensities((0, 0, 0)).round(6).tolist()
        [0.000318]
        """
        if self.sheet is None:
            assert self.intensity is not None
            return self.intensity
        section = 0.25 * math.pi * self.diameter**2 if self.cross_section is None else self.cross_section
        scattered = section / (4.0 * math.pi)
        if self.phase is not None:
            direction = numbers(towards, "towards", columns=3) - self.positions
            length = np.linalg.norm(direction, axis=1)
            along = direction @ self.sheet.direction
            cosine = np.divide(along, length, out=np.ones(len(self)), where=length > 0)  # forwards at the point itself
            scattered = section * np.interp(np.arccos(np.clip(cosine, -1.0, 1.0)), *self.phase.T)
        irradiance = self.sheet.irradiance_at(self.positions)
        return np.asarray(irradiance * (scattered if irradiance.ndim == 1 else scattered[:, None]))

    def moved(self, velocity: ArrayLike, dt: float) -> Points:
        """The particles after a time, for the second exposure of a pair; a light sheet stays.

        Parameters
        ----------
        velocity : (3,) or (n, 3) array
            mm/s.
        dt : float
            s.

        Examples
        --------
        >>> import plenoptic as pl
        >>> pl.Points([(0, 0, -404)], intensity=1.0).moved((100, 0, 0), 0.002).positions.tolist()
        [[0.2, 0.0, -404.0]]
        """
        step = numbers(velocity, "velocity", columns=3) * finite(dt, "dt")
        if step.shape not in ((3,), self.positions.shape):
            raise InvalidValueError(f"velocity has shape {step.shape}; it must be (3,) or {self.positions.shape}")
        return dataclasses.replace(self, positions=self.positions + step)

    def under(self, matrix: ArrayLike) -> Points:
        """The particles, and their sheet, where a (4, 4) similarity puts them; radiances stay, as in `Scene`."""
        full, scale = similarity(matrix)
        section = self.cross_section
        return dataclasses.replace(
            self,
            positions=self.positions @ full[:3, :3].T + full[:3, 3],
            diameter=scale * self.diameter,
            intensity=None if self.intensity is None else scale**2 * self.intensity,
            cross_section=None if section is None else scale**2 * section,
            sheet=None if self.sheet is None else self.sheet.moved(full, scale),
        )


def _checked_phase(phase: ArrayLike) -> Floats:
    table = frozen_array(phase, name="phase", shape=("k", 2))
    if not (len(table) and np.isfinite(table).all() and (table[:, 1] >= 0).all() and (np.diff(table[:, 0]) > 0).all()):
        raise InvalidValueError("phase must hold finite, ascending angles in rad, and values of 0 or more in 1/sr")
    return table
