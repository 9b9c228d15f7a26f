"""Wave-optical images of points: from the main lens through microlenses to pixels."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.camera.assembly import assembly
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.core.values import Floats, check_kind, numbers, positions
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.pupil.beam import checked_wavelengths
from plenoptic.optics.microlens.aperture import Walls
from plenoptic.wave.beam import beam_of
from plenoptic.wave.field import (
    OUTERMOST,
    PixelLight,
    on_pixels,
    outermost_power,
    plane_waves,
    power,
    through_array,
    to_sensor,
)
from plenoptic.wave.grid import OVERSAMPLING, grid_for, lit_box
from plenoptic.wave.microlenses import microlenses_around
from plenoptic.wave.wave_spread import Sampling, WaveSpread


def point_spread(
    camera: PlenopticCamera,
    point: ArrayLike,
    *,
    wavelengths: float | Sequence[float] | None = None,
    weights: ArrayLike | None = None,
) -> WaveSpread:
    """Image of a point, with diffraction at the main lens and the microlenses and interference between the latter.

    The counterpart of `plenoptic.point_spread`, which traces rays, in the same units. Wavelengths are incoherent: their
    images are added.

    Parameters
    ----------
    camera : PlenopticCamera
        Its sensor must be parallel to the array. Dust, walls between microlenses and angular responses of pixels are
        not supported.
    point : (3,) array
        World position in mm, in front of the lens.
    wavelengths : float or sequence of float, optional
        In vacuum, nm; None: that of the camera.
    weights : (w,) array, optional
        Relative light of each; equal by default.

    Returns
    -------
    WaveSpread
        With a `Sampling` for each wavelength, whose `error` estimates the accuracy. All zero if no light passes the
        lens.

    Raises
    ------
    InvalidValueError
        If the camera has an unsupported feature or microlenses without extent (PINHOLE), the point is not in front of
        the lens, its light is nearly parallel behind it, or more than 67 million samples are needed.

    Notes
    -----
    Plane waves behind the main lens get their phases and amplitudes from rays (see `plenoptic.wave.beam`). Their sum on
    the plane of the array is multiplied by the transmission of each microlens: its opening, and its phase as a thin
    element, at the position of the microlens. The whole field is propagated to the sensor at once, by a band-limited
    angular spectrum. Light is then integrated over the areas of pixels.

    THIN microlenses and ideal main lenses are ideal for rays: they shear slopes. Their waves are paraxial, and follow
    the rays of the library at any aperture. Plates (SPHERICAL, FLAT_HIGH_INDEX) are thin elements with the phase of
    their sag, in exact waves; with a coating they transmit the light that they transmit along the axis.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.camera.example_camera()
    >>> spread = pl.wave.point_spread(camera, (0.0, 0.0, -404.0))
    >>> f"{1e3 * spread.light:.3f} msr"
    '0.985 msr'
    >>> spread.samplings[0].error < 0.03
    True
    """
    _check_camera(camera)
    world_point = positions(point, name="point", shape=(3,))
    waves = checked_wavelengths(camera.wavelength if wavelengths is None else wavelengths)
    light = np.ones(len(waves)) if weights is None else numbers(weights, "weights")
    if light.shape != (len(waves),) or not (np.isfinite(light) & (light >= 0)).all() or not light.any():
        raise InvalidValueError(f"weights must be {len(waves)} numbers, not negative and not all 0")
    images = [_image_at(dataclasses.replace(camera, wavelength=wave), world_point, OVERSAMPLING) for wave in waves]
    return _add_images(camera, world_point, np.array(waves), light / light.sum(), images)


class _Image(NamedTuple):
    """Image at one wavelength."""

    pixels: PixelLight
    light: float
    sampling: Sampling


def _check_camera(camera: PlenopticCamera) -> None:
    check_kind(camera, "camera", PlenopticCamera, "pl.PlenopticCamera(...)")
    array = camera.microlenses
    if array is not None and not array.model.focuses:
        raise InvalidValueError(
            f"the microlenses have the model {array.model.name}, and no light passes a hole without extent; choose THIN"
        )
    features = {
        "a sensor tilted against the array (sensor_placement)": assembly(camera).tilt is not None,
        "walls between microlenses": array is not None and array.walls is not Walls.NONE,
        "an angular response of pixels": camera.sensor.angular_response is not None,
        "blemishes": bool(camera.blemishes),
    }
    for feature, is_present in features.items():
        if is_present:
            raise InvalidValueError(f"the camera has {feature}, which wave optics does not support; leave it out")


def _image_at(camera: PlenopticCamera, point: Floats, oversampling: float) -> _Image | None:
    """Image of a point at the camera's wavelength; None without light."""
    beam = beam_of(camera, point)
    if beam is None:
        return None
    lenses, distance = None, 0.0
    if camera.microlenses is not None:
        lenses, distance = microlenses_around(beam.record, *lit_box(beam)), beam.record.parts.distance
    grid = grid_for(beam, lenses, distance, oversampling)
    pupil_waves = plane_waves(beam, grid)
    waves, area, lost = pupil_waves.waves, float(grid.spacing.prod()), 0.0
    incident = transmitted = power(waves)
    if lenses is not None:
        waves, incident, transmitted = through_array(waves, beam, grid, lenses)
    # Behind edges the light of steep directions falls with their square.
    steep = outermost_power(waves) * (1.0 - OUTERMOST) / OUTERMOST
    if lenses is not None:
        lost = to_sensor(waves, beam, grid)
    arriving = power(waves)
    pixels, on_sensor = on_pixels(waves, grid, camera.sensor)
    sampling = Sampling(
        wavelength=camera.wavelength,
        spacing=grid.spacing,
        shape=np.array(grid.shape),
        denser=oversampling,
        directions=pupil_waves.directions,
        phase_error=beam.phase_error,
        beside=max(0.0, 1.0 - incident / pupil_waves.power),
        stopped=1.0 - transmitted / incident,
        steep=steep / transmitted,
        lost=lost / transmitted + max(0.0, 1.0 - on_sensor / (arriving * area)),
    )
    return _Image(pixels, pupil_waves.light, sampling)


def _add_images(
    camera: PlenopticCamera, point: Floats, wavelengths: Floats, weights: Floats, images: list[_Image | None]
) -> WaveSpread:
    """Weighted sum of the images at all wavelengths."""
    passing = [(weight, part) for weight, part in zip(weights.tolist(), images, strict=True) if part]
    lit = [(weight, part) for weight, part in passing if part.pixels.light.size]
    corner, last = np.zeros(2, np.int64), np.ones(2, np.int64)
    if lit:
        corner = np.min([part.pixels.corner for _, part in lit], axis=0)
        last = np.max([part.pixels.corner + part.pixels.light.shape for _, part in lit], axis=0)
    image = np.zeros(last - corner)
    for weight, part in lit:
        (row, column), (rows, columns) = part.pixels.corner - corner, part.pixels.light.shape
        image[row : row + rows, column : column + columns] += weight * part.pixels.light
    return WaveSpread(
        image=image / camera.sensor.pixel_pitch**2,
        corner=corner,
        points=point,
        light=sum(weight * part.light for weight, part in passing),
        wavelengths=wavelengths,
        weights=weights,
        samplings=tuple(part.sampling for part in images if part),
        sensor=camera.sensor,
    )
