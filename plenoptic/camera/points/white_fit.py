"""Comparison of a white image with its camera: the displacement of the lattice of micro images, by Fourier analysis.

The white image is a lattice of micro images, and its Fourier coefficients at the reciprocal lattice are those of a
single one (Poisson summation). A displacement changes their phases, which are compared in patches of some nine micro
images. The model of a micro image is the paraxial pupil; if it does not fit, the light that the lens lets through.
"""

from __future__ import annotations

import dataclasses
import math
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.points.micro_image_models import (
    Complexes,
    paraxial_coefficients,
    paraxial_of_types,
    to_complex,
    to_pixel,
    traced_coefficients,
)
from plenoptic.core.values import Floats, check_has, result
from plenoptic.core.warn import warn
from plenoptic.errors import InvalidValueError
from plenoptic.optics.microlens.aperture import Walls
from plenoptic.optics.microlens.lattice import Lattice

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.camera.points.centres import MicrolensCentres
    from plenoptic.rendering.exposure import Exposure

_TOLERANCE, _SIGNIFICANCE = 0.1, 4.0
"""Displacement above which a white image counts as that of another camera, in pixels and in standard errors."""
_PATCHES, _TRACED_PATCHES, _MIN_PATCHES = 5, 3, 4
"""Patches along each side of the image for the paraxial and the traced model, and least number of all."""
_RADIUS, _MIN_RADIUS = 1.5, 20
"""Half the side of a patch in pitches, and at least in pixels."""
_HIGHEST = 2.05
"""Limit of the compared spatial frequencies, over that of the lattice."""
_MIN_CONTRAST, _MIN_CORRELATION = 0.003, 0.7
"""Amplitude of the lattice over the mean, and correlation with the model, below which a patch is not used."""
_CLEAR_CONTRAST = 0.03
"""The same amplitude of the model from which on any white image shows the lattice."""
_TRIALS, _NEWTON = 12, 4
"""Displacements that are tried along each side of a cell, and steps of refinement."""
_WRAPPED = 0.05
"""Residual in pitches above which patches differ by steps of the lattice."""
_CONVERGED, _ROUNDS = 0.01, 8
"""Change of the displacement in pixels at which iterations end, and their largest number."""
_HUBER, _REWEIGHTINGS = 1.5, 8


class LatticeShift(NamedTuple):
    """Displacement of the micro images of a white image from those of a camera: a similarity.

    Positions are complex: x + iy on the sensor in pixels, from pixel (0, 0). A micro image at z is displaced by
    shift + linear (z - origin).
    """

    origin: complex
    """Centre of the image."""
    shift: complex
    linear: complex
    """Relative change of the pitch + i angle in radians."""
    largest: float
    """Largest displacement in the image, pixels."""
    standard_error: float
    """Its standard error, pixels."""
    residual: float
    """Root mean square of the displacements of patches that remain, pixels."""
    pitch: float
    """Distance of neighbouring micro images, pixels."""
    array_centre: complex
    """Position of the micro image with index (0, 0)."""

    def at(self, z: Complexes | complex) -> Complexes:
        """Displacements of micro images at positions."""
        return np.asarray(self.shift + self.linear * (z - self.origin))

    @property
    def is_significant(self) -> bool:
        """True if the largest displacement exceeds 0.1 pixels and four standard errors."""
        return self.largest > max(_TOLERANCE, _SIGNIFICANCE * self.standard_error)


@result
class CameraFit:
    """A camera whose microlenses stand where a white image shows them. See `PlenopticCamera.fitted_to`.

    Parameters
    ----------
    camera : PlenopticCamera
        The camera with its array shifted, turned and scaled.
    shift : (2,) array
        Displacement of the array along x and y of the camera, mm.
    turn : float
        Rotation of the array from x to y, rad.
    pitch_ratio : float
        Pitch of the fitted array over that of the camera before.
    residual : float
        Root mean square of the displacements that remain, pixels: of means over some nine micro images.
    """

    camera: PlenopticCamera
    shift: Floats
    turn: float
    pitch_ratio: float
    residual: float

    def __repr__(self) -> str:
        x, y = self.shift / self.camera.sensor.pixel_pitch
        return (
            f"CameraFit(shift ({x:.3f}, {y:.3f}) pixels, turn {math.degrees(self.turn):.5f} degrees, pitch ratio "
            f"{self.pitch_ratio:.7g}, residual {self.residual:.2g} pixels)"
        )


def lattice_shift(
    camera: PlenopticCamera, white: Exposure, centres: MicrolensCentres, *, trace: bool = False
) -> LatticeShift | None:
    """Displacement of a white image's micro images from the CHIEF_RAY centres of a camera; None if none is found.

    With `trace`, the light through the lens is traced even if the paraxial model fits. Displacements that differ by
    steps of the lattice are equivalent, except for the types of microlenses, which do not count: it is the least one.
    """
    if not _has_lattice(camera, centres):
        return None
    patches = _patches(camera, white, centres, _PATCHES)
    steps = patches.displacements(patches.coefficients(), paraxial_coefficients(camera, patches.frequencies))
    shift = patches.fit(steps)
    if shift is not None and shift.residual > _WRAPPED * shift.pitch:
        shift = patches.fit(patches.unwrap(steps))
    if len(patches.pixel) < _MIN_PATCHES or (shift is not None and not (trace or shift.is_significant)):
        return shift
    if white.camera is not None and white.camera.lens != camera.lens:
        # White images at other stops of the same camera.
        camera = dataclasses.replace(camera, lens=white.camera.lens)
    patches = _patches(camera, white, centres, _TRACED_PATCHES)
    traced, z = (
        traced_coefficients(camera, patches.frequencies, patches.lens_pixel, patches.on_array),
        to_complex(patches.pixel),
    )
    if shift is None:
        shift = patches.fit(patches.unwrap(patches.displacements(patches.coefficients(), traced)))
    for _ in range(_ROUNDS):
        if shift is None:
            return None
        before = shift.at(z)
        displacement = before + patches.displacements(patches.coefficients(before), traced)
        central = displacement[np.argsort(np.abs(z - shift.origin) + np.abs(0.0 * displacement))[0]]
        shift = patches.fit(displacement + patches.nearest(central) - central)
        if shift is not None and np.abs(shift.at(z) - before).max() < _CONVERGED:
            return shift
    return None


def has_contrast(camera: PlenopticCamera, white: Exposure, centres: MicrolensCentres) -> bool:
    """True if a white image of a camera has enough patches, and by the paraxial model the contrast, to be compared."""
    if not _has_lattice(camera, centres):
        return False
    patches = _patches(camera, white, centres, _PATCHES)
    mean = paraxial_coefficients(camera, np.zeros((1, 2)))
    contrast = np.linalg.norm(paraxial_coefficients(camera, patches.frequencies)) / np.linalg.norm(mean)
    return bool(len(patches.pixel) >= _MIN_PATCHES and contrast > _CLEAR_CONTRAST)


def _has_lattice(camera: PlenopticCamera, centres: MicrolensCentres) -> bool:
    array = camera.microlenses
    if array is None or array.lattice is Lattice.FREE or array.walls is Walls.OPAQUE:
        return False
    return bool(np.linalg.matrix_rank(centres.index - centres.index[:1]) == 2)


def fit_camera(camera: PlenopticCamera, white: Exposure) -> CameraFit:
    """Fit of the array to a white image; see `PlenopticCamera.fitted_to`."""
    from plenoptic.camera.camera import CameraPart  # knows this module
    from plenoptic.camera.points.centres import microlens_centres  # knows this module

    check_has(white, "white", "Exposure", "pl.render_white(camera, samples=64)", "image", "region", "camera")
    fitted, offset, angle, ratio = camera, np.zeros(2), 0.0, 1.0
    for _ in range(_ROUNDS):
        if fitted.microlenses is None:
            raise InvalidValueError("the camera has no microlenses to be fitted; give it a MicrolensArray")
        centres = microlens_centres(fitted, progress=False)
        shift = lattice_shift(fitted, white, centres, trace=True)
        if shift is None:
            break
        if shift.largest < max(_CONVERGED, shift.standard_error):
            steps = [shift._replace(shift=shift.shift + step) for step in _type_steps(fitted, white, centres)]
            nearest = min(steps, key=lambda moved: float(np.hypot(*(offset + array_motion(fitted, moved)[0]))))
            if nearest == shift:
                return CameraFit(fitted, offset, angle, ratio, shift.residual)
            shift = nearest
        step, turn, scale = array_motion(fitted, shift)
        x, y = fitted.microlenses.pitches
        pitch = (x * scale, y * scale) if isinstance(fitted.microlenses.pitch, tuple) else x * scale
        fitted = dataclasses.replace(fitted, microlenses=dataclasses.replace(fitted.microlenses, pitch=pitch))
        fitted = fitted.moved(CameraPart.MICROLENSES, shift=(step[0], step[1], 0.0), tilt=(0.0, 0.0, turn))
        offset, angle, ratio = offset + step, angle + turn, ratio * scale
    raise InvalidValueError(
        "the array cannot be fitted: the white image shows no lattice of micro images near that of the camera; it "
        "needs some ten of them that do not fill their cells evenly, on a lattice and without walls"
    )


def _type_steps(camera: PlenopticCamera, white: Exposure, centres: MicrolensCentres) -> list[complex]:
    """Steps of the lattice in pixels with which the types of microlenses fit an image best; 0 if it shows no types."""
    array = camera.microlenses
    assert array is not None
    if not array.model.focuses or len(set(array.focal_lengths)) == 1:
        return [0j]
    periods, patches = np.array(array.type_pattern.shape), _patches(camera, white, centres, 1)
    # Types change the coefficients between the orders of the lattice, at multiples of 1 / period.
    orders = np.array([(i, j) for i in range(4 * periods[0]) for j in range(-3 * periods[1], 3 * periods[1] + 1)])
    orders = orders[(orders % periods).any(axis=1)] / periods
    to_frequency = np.linalg.inv(patches.basis).T
    lengths, highest = np.hypot(*(orders @ to_frequency).T), _HIGHEST * np.hypot(*to_frequency.T).max()
    patches = patches._replace(orders=orders[lengths < highest])
    cells, steps = (np.array(list(product(*(range(first, n) for n in periods)))) for first in (0, -periods.max()))
    waves = np.exp(-2j * np.pi * (patches.orders @ cells.T))
    model = np.einsum("ck,kc->k", paraxial_of_types(camera, patches.frequencies)[array.type_pattern.ravel()], waves)
    image = patches.of_whole_image()
    match = ((image * model.conj()) @ np.exp(2j * np.pi * (patches.orders @ steps.T))).real
    if not match.max() > _MIN_CORRELATION * np.linalg.norm(image) * np.linalg.norm(model):
        warn(
            "the white image does not show which microlens has which focal length: the fitted array may be off by one "
            "or more microlenses; compare it with an image of a known scene"
        )
        return [0j]
    return list(to_complex(steps[match > (1.0 - 1e-9) * match.max()] @ patches.basis).tolist())


def array_motion(camera: PlenopticCamera, shift: LatticeShift) -> tuple[Floats, float, float]:
    """Motion of the array that displaces its micro images: shift in the camera (2,), mm, turn in rad, pitch ratio."""
    assert camera.microlenses is not None
    z = complex(shift.at(shift.array_centre)) * min(camera.microlenses.pitches) / shift.pitch
    turn = np.eye(2) if camera.sensor_placement is None else np.asarray(camera.sensor_placement.rotation)[:2, :2]
    return turn @ np.array([z.real, z.imag]), float(np.angle(1.0 + shift.linear)), abs(1.0 + shift.linear)


class _Patches(NamedTuple):
    """Square parts of a white image around p microlenses."""

    image: NDArray[np.float32]
    first: NDArray[np.int64]
    """Row and column of the image's first pixel on the sensor."""
    pixel: Floats
    """(p, 2): centres by the camera, means over the deviations of the microlenses of a patch."""
    lens_pixel: Floats
    on_array: Floats
    """(p, 2): centre of the central microlens's image, and its place on the array in mm."""
    basis: Floats
    """(2, 2): rows and columns of the steps from (i, j) to (i + 1, j) and (i, j + 1)."""
    array_centre: complex
    orders: NDArray[np.int64] | Floats
    """(k, 2): orders of the compared spatial frequencies."""
    half: int
    """Half the side in pixels."""

    def coefficients(self, displacement: Complexes | float = 0.0) -> Complexes:
        """Fourier coefficients (p, k) of the lattice over the mean, around displaced centres."""
        pixel = self.pixel + to_pixel(np.broadcast_to(displacement, len(self.pixel)).astype(np.complex128))
        places = np.rint(pixel).astype(np.int64)[:, :, None] + np.arange(-self.half, self.half + 1)
        inside = np.clip(places - self.first[:, None], 0, np.array(self.image.shape[:2])[:, None] - 1)
        light = self.image[inside[:, 0, :, None], inside[:, 1, None, :]].mean(axis=3, dtype=np.float64)
        offset = places - pixel[:, :, None]
        window, light = _hann(offset, self.half), np.nan_to_num(light)
        total = np.einsum("pr,prc,pc->p", window[:, 0], light, window[:, 1], optimize=True)
        mean = total / window.sum(axis=2).prod(axis=1)
        waves = window[:, :, None] * np.exp(-2j * np.pi * self.frequencies.T[:, :, None] * offset[:, :, None])
        across = np.einsum("prc,pkc->prk", light - mean[:, None, None], waves[:, 1])
        return np.asarray(np.einsum("pkr,prk->pk", waves[:, 0], across) / np.maximum(total, 1e-300)[:, None])

    @property
    def frequencies(self) -> Floats:
        """Compared spatial frequencies (k, 2), cycles per row and per column."""
        return np.asarray(self.orders @ np.linalg.inv(self.basis).T)

    def of_whole_image(self) -> Complexes:
        """Fourier coefficients (k,) of the whole image, around the microlens with index (0, 0)."""
        shape, (row, column) = self.image.shape[:2], to_pixel(np.array(self.array_centre)) - self.first
        light = np.nan_to_num(self.image.mean(axis=2, dtype=np.float64))
        windows = [_hann(np.arange(n) - 0.5 * (n - 1), 0.5 * n) for n in shape]
        offsets = np.arange(shape[0]) - row, np.arange(shape[1]) - column
        down, across = (
            w[:, None] * np.exp(-2j * np.pi * np.outer(x, f))
            for w, x, f in zip(windows, offsets, self.frequencies.T, strict=True)
        )
        return np.asarray((down * ((light - light.mean()) @ across)).sum(axis=0))

    def displacements(self, image: Complexes, model: Complexes) -> Complexes:
        """Least displacements (p,) at which coefficients (p, k) correlate best; nan where the correlation is poor."""
        cross, orders = image * model.conj(), self.orders
        trials = np.stack(np.meshgrid(*[np.arange(_TRIALS) / _TRIALS] * 2), axis=-1).reshape(-1, 2)
        waves = np.exp(2j * np.pi * (orders @ trials.T))
        steps = trials[np.einsum("pk,kt->pt", cross, waves).real.argmax(axis=1)]
        products = orders[:, :, None] * orders[:, None]
        for _ in range(_NEWTON):
            phases = cross * np.exp(2j * np.pi * (steps @ orders.T))
            curvature = np.einsum("pk,kij->pij", phases.real, products) + 1e-30 * np.eye(2)
            slope = -(phases.imag @ orders) / (2 * np.pi)
            steps = steps + np.linalg.solve(curvature, slope[..., None])[..., 0]
        power = [(np.abs(part) ** 2).sum(axis=1) for part in (image, model)]
        is_clear = phases.real.sum(axis=1) > _MIN_CORRELATION * np.sqrt(power[0] * power[1])
        is_clear &= power[0] > _MIN_CONTRAST**2
        return np.where(is_clear, self.nearest(to_complex(steps @ self.basis)), np.nan)

    def nearest(self, displacement: Complexes, target: Complexes | float = 0.0) -> Complexes:
        """Displacements plus the steps of the lattice that bring them nearest to a target."""
        excess = to_pixel(np.asarray(displacement - target)) @ np.linalg.inv(self.basis)
        steps = np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)])
        candidates = to_complex(((excess - np.rint(excess))[..., None, :] + steps) @ self.basis)
        best = np.argmin(np.abs(candidates), axis=-1)[..., None]
        return np.asarray(np.take_along_axis(candidates, best, axis=-1)[..., 0] + target)

    def unwrap(self, displacement: Complexes) -> Complexes:
        """Displacements (p,) with the steps of the lattice that make them a similarity, from the centre outwards."""
        z, unwrapped = to_complex(self.pixel), np.full(len(displacement), np.nan, dtype=complex)
        for k in np.argsort(np.abs(z - self.origin)):
            shift, near = self.fit(unwrapped), unwrapped[np.isfinite(unwrapped)]
            target = shift.at(z[[k]]) if shift is not None else near.mean() if len(near) else 0.0
            unwrapped[k] = self.nearest(displacement[[k]], target)[0]
        return unwrapped

    @property
    def origin(self) -> complex:
        """Centre of the image."""
        return complex(to_complex(self.first + (np.array(self.image.shape[:2]) - 1) / 2))

    def fit(self, displacement: Complexes) -> LatticeShift | None:
        """Similarity of displacements (p,), by least squares with Huber's weights; None if too few are finite."""
        finite = np.isfinite(displacement)
        if np.count_nonzero(finite) < _MIN_PATCHES:
            return None
        z, target = to_complex(self.pixel[finite]) - self.origin, displacement[finite]
        design, weight = np.column_stack([np.ones(len(z)), z]), np.ones(len(z))
        for _ in range(_REWEIGHTINGS):
            solution = np.linalg.lstsq(design * weight[:, None], target * weight, rcond=None)[0]
            error = np.abs(target - design @ solution)
            scale = _HUBER * 1.4826 * max(float(np.median(error)), 1e-6)
            weight = np.sqrt(scale / np.maximum(error, scale))
        count = (weight**2).sum()
        variance = (weight * error) @ (weight * error) / max(count - 2.0, 1.0)
        reach = 0.5 * math.hypot(*self.image.shape[:2])
        corners = to_complex(np.array([(i, j) for i in (-0.5, 0.5) for j in (-0.5, 0.5)]) * self.image.shape[:2])
        return LatticeShift(
            self.origin,
            shift=complex(solution[0]),
            linear=complex(solution[1]),
            largest=float(np.abs(solution[0] + solution[1] * corners).max()),
            standard_error=math.sqrt(variance * (1 / count + reach**2 / ((weight * np.abs(z)) ** 2).sum())),
            residual=float(np.sqrt(np.mean(error**2))),
            pitch=float(np.hypot(*self.basis.T).min()),
            array_centre=self.array_centre,
        )


def _hann(offset: Floats, half: float) -> Floats:
    return np.asarray(np.where(np.abs(offset) < half, np.cos(0.5 * np.pi * offset / half) ** 2, 0.0))


def _patches(camera: PlenopticCamera, white: Exposure, centres: MicrolensCentres, count: int) -> _Patches:
    """Patches that lie in the image, around the microlenses nearest to count x count of its points."""
    array, pixel, index = camera.microlenses, centres.pixel, centres.index
    assert array is not None
    *vectors, middle = np.linalg.lstsq(np.column_stack([index, np.ones(len(index))]), pixel, rcond=None)[0]
    basis = np.array(vectors)
    orders = np.array([(i, j) for i in range(4) for j in range(-3, 4) if (i, j) > (0, 0)])
    lengths = np.hypot(*(orders @ np.linalg.inv(basis).T).T)
    orders = orders[lengths < _HIGHEST * lengths[np.abs(orders).sum(axis=1) == 1].max()]
    half = math.ceil(max(_RADIUS * np.hypot(*basis.T).max(), _MIN_RADIUS))
    region = white.region or (0, white.image.shape[0], 0, white.image.shape[1])
    low, high = np.array(region[::2]) + half, np.array(region[1::2]) - 1 - half
    inside = np.flatnonzero(((pixel >= low) & (pixel <= high)).all(axis=1))
    if array.extent is not None and len(inside):
        # Without the dark frame of the array.
        width = half * min(array.pitches) / np.hypot(*basis.T).min()
        limit = array.half_extent - array.cell_radius - width
        inside = inside[(np.abs(centres.on_array[inside]) <= limit).all(axis=1)]
        if len(inside):
            low, high = pixel[inside].min(axis=0), pixel[inside].max(axis=0)
    grid = np.stack(np.meshgrid(*np.linspace(low, high, count).T, indexing="ij"), axis=-1).reshape(-1, 2)
    nearest = [inside[np.hypot(*(pixel[inside] - point).T).argmin()] for point in grid if len(inside)]
    chosen = np.unique(np.array(nearest, dtype=np.int64))
    centre = pixel[chosen].copy()
    for k, lens in enumerate(chosen if array.imperfections is not None else ()):
        weight = _hann(pixel - pixel[lens], half).prod(axis=1)
        centre[k] = weight @ (pixel - (index - index[lens]) @ basis) / weight.sum()
    first, middle = np.array(region[::2]), complex(to_complex(middle))
    return _Patches(white.image, first, centre, pixel[chosen], centres.on_array[chosen], basis, middle, orders, half)
