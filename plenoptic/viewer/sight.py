"""Chief rays of a camera as a polynomial, by which a page finds where every microlens sees a point.

A ray that leaves the camera from a pixel through the optical centre of a microlens is a line, whose two places and two
slopes are smooth functions of the microlens's place on the array and of how far the pixel lies from it: a polynomial of
four variables, fitted to rays traced through the real lens. The page meets that line with the depth of a pixel, and
finds where other microlenses see the same point by Newton's method; web/sight.js has the other side.
"""

from __future__ import annotations

import itertools
from typing import Any, NamedTuple

import numpy as np

from plenoptic.camera.assembly import ArrayAxes, array_axes
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.points.centres import MicrolensCentres
from plenoptic.core.parallel import thread_count
from plenoptic.core.rays import RayBundle
from plenoptic.core.values import Floats
from plenoptic.lightfield.outward_rays import chief_rays
from plenoptic.lightfield.pinhole_model import orthogonal_pixels
from plenoptic.optics.microlens.array import MicrolensArray

_RAYS = 12_000
_DEGREES = (3, 5, 7)
_GOOD, ENOUGH = 0.02, 0.25
"""Pixels: an error at which no higher degree is tried, and the largest one with which a page shows anything."""
_HELD_BACK = 4
"""Of so many rays one is for the error."""
_STEP = 1e-3
"""Pixels, for derivatives."""
_FLAT = 1e-12
"""mm^2 that a pixel covers in the scene below which a point is in focus on the array."""
_ROOM = 1.15
"""Beyond the cell, by which images of microlenses may be larger."""


class Sight(NamedTuple):
    """The polynomial: lines of chief rays, by microlens and pixel."""

    degree: int
    middle: Floats
    half: Floats
    """(4,): of the ranges of the variables: place of the microlens on the array, mm, offset of the pixel."""
    series: Floats
    """(k, 4), in the order of `exponents`: x and y at z = 0 of the camera's frame, dx/dz, dy/dz."""
    straight: Floats
    """(3, 2): pixel straight behind the array's origin, and its steps for a mm along x and y of the array."""
    error: float
    """Pixels."""

    def lines(self, on_array: Floats, offset: Floats) -> Floats:
        """(n, 4): of microlenses (n, 2) and pixels (n, 2) beside where they lie straight before the sensor."""
        return _terms((np.hstack([on_array, offset]) - self.middle) / self.half, exponents(self.degree)) @ self.series

    def beside(self, points: Floats, pixel: Floats, on_array: Floats) -> Floats:
        """Displacement from pixels (n, 2) of chief rays of points (n, 3) of the camera frame, by a Newton step."""
        offset = pixel - self.straight[0] - on_array @ self.straight[1:]
        lines = self.lines(on_array, offset)
        slopes = [(self.lines(on_array, offset + _STEP * np.eye(2)[k]) - lines) / _STEP for k in range(2)]
        off = points[:, :2] - _intersect(lines, points[:, 2])
        return _rotate(np.stack([_intersect(slope, points[:, 2]) for slope in slopes], axis=2), off)

    def facts(self) -> dict[str, Any]:
        """For the page."""
        arrays = {"middle": self.middle, "half": self.half, "series": self.series.T, "straight": self.straight}
        return {"degree": self.degree, "error": self.error} | {
            name: array.ravel().tolist() for name, array in arrays.items()
        }


class Samples(NamedTuple):
    """Chief rays of some pixels and microlenses."""

    on_array: Floats
    offset: Floats
    """(n, 2): of the pixel from where the microlens lies straight before the sensor, rows and columns."""
    line: Floats
    """(n, 4): x and y at z = 0 of the camera's frame, and dx/dz, dy/dz there."""


def sight(camera: PlenopticCamera, centres: MicrolensCentres, distances: Floats) -> Sight | None:
    """The polynomial, and its error in pixels where points lie at some distances (-z); None where none is good."""
    array = camera.microlenses
    if array is None or not len(centres) or not len(distances):
        return None
    axes = array_axes(camera)
    samples = _samples(camera, axes, array, centres)
    if len(samples.line) < _RAYS // 10:
        return None
    middle, half = (
        np.concatenate(parts)
        for parts in zip(*(_extent(variables) for variables in (samples.on_array, samples.offset)), strict=True)
    )
    places = (np.hstack([samples.on_array, samples.offset]) - middle) / half
    held = np.arange(len(places)) % _HELD_BACK == 0
    corners = orthogonal_pixels(axes, np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
    straight = np.vstack([corners[0], corners[1:] - corners[0]])
    for degree in _DEGREES:
        series, *_ = np.linalg.lstsq(_terms(places[~held], exponents(degree)), samples.line[~held], rcond=None)
        polynomial = Sight(degree, middle, half, np.asarray(series), straight, 0.0)
        error = _error(polynomial, Samples(*(part[held] for part in samples)), distances)
        if error <= _GOOD:
            break
    return polynomial._replace(error=error) if error <= ENOUGH else None


def exponents(degree: int) -> list[tuple[int, int, int, int]]:
    """Powers of the four variables in their order, of all terms up to a degree."""
    combinations = itertools.product(range(degree + 1), repeat=4)
    return [(a, b, c, d) for a, b, c, d in combinations if a + b + c + d <= degree]


def _samples(camera: PlenopticCamera, axes: ArrayAxes, array: MicrolensArray, centres: MicrolensCentres) -> Samples:
    """Rays that the lens lets pass, spread evenly over microlenses and their images."""
    rng = np.random.default_rng(0)
    which = rng.integers(len(centres), size=_RAYS)
    on_array = centres.on_array[which]
    straight = orthogonal_pixels(axes, on_array)
    angle, radius = rng.uniform(0, 2 * np.pi, _RAYS), np.sqrt(rng.uniform(0, 1, _RAYS))
    reach = _ROOM * array.cell_radius / camera.sensor.pixel_pitch
    offsets = reach * radius[:, None] * np.column_stack([np.sin(angle), np.cos(angle)])
    offset = centres.pixel[which] - straight + offsets
    rays = chief_rays(axes, array, straight + offset, on_array, thread_count(None), clipping=True)
    line = _lines(axes, rays)
    good = (rays.status == 0) & np.isfinite(line).all(axis=1)
    return Samples(on_array[good], offset[good], line[good])


def _lines(axes: ArrayAxes, rays: RayBundle) -> Floats:
    """(n, 4): x, y where z = 0 in the camera's frame, dx/dz, dy/dz."""
    placed = axes.parts.lens_to_camera
    origin = rays.origin if placed is None else placed.points(rays.origin)
    direction = rays.direction if placed is None else placed.directions(rays.direction)
    with np.errstate(invalid="ignore", divide="ignore"):
        slopes = direction[:, :2] / direction[:, 2:]
    return np.hstack([origin[:, :2] - origin[:, 2:] * slopes, slopes])


def _extent(variables: Floats) -> tuple[Floats, Floats]:
    low, high = variables.min(axis=0), variables.max(axis=0)
    return (low + high) / 2, np.maximum((high - low) / 2, 1e-9)


def _terms(places: Floats, powers: list[tuple[int, int, int, int]]) -> Floats:
    """(n, k): products of powers of the variables (n, 4)."""
    degree = max(map(max, powers))
    table = places[:, :, None] ** np.arange(degree + 1)
    a, b, c, d = np.array(powers).T
    return np.asarray(table[:, 0, a] * table[:, 1, b] * table[:, 2, c] * table[:, 3, d])


def _error(sight: Sight, samples: Samples, distances: Floats) -> float:
    """99th percentile of the polynomial's error, in pixels, for points that rays hit at some distances."""
    on_array, offset, line = samples
    pixel = offset + sight.straight[0] + on_array @ sight.straight[1:]
    displacements = []
    for distance in distances.tolist():
        z = np.full(len(line), -distance)
        displacements.append(sight.beside(np.column_stack([_intersect(line, z), z]), pixel, on_array))
    distances_px = np.linalg.norm(np.concatenate(displacements), axis=1)
    distances_px = distances_px[np.isfinite(distances_px)]
    return float(np.percentile(distances_px, 99)) if distances_px.size else np.inf


def _intersect(lines: Floats, z: Floats) -> Floats:
    """Intersections of lines (n, 4) with planes (n,): x and y (n, 2)."""
    return np.asarray(lines[:, :2] + z[:, None] * lines[:, 2:])


def _rotate(jacobian: Floats, off: Floats) -> Floats:
    """(n, 2): solutions of n systems; nan where rays of all pixels meet, for a point that the array has in focus."""
    (a, b), (c, d) = jacobian.transpose(1, 2, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        one = np.where(np.abs(a * d - b * c) > _FLAT, 1.0 / (a * d - b * c), np.nan)
    return np.column_stack([d * off[:, 0] - b * off[:, 1], a * off[:, 1] - c * off[:, 0]]) * one[:, None]
