"""Images of points as waves make them: from the main lens through microlenses to pixels."""

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
from plenoptic.wave.field import OUTERMOST, Pixels, on_pixels, outermost, plane_waves, power, through_array, to_sensor
from plenoptic.wave.grid import DENSER, grid_for, lit_box
from plenoptic.wave.microlenses import microlenses_around
from plenoptic.wave.spread import Sampling, WaveSpread


def point_spread(
    camera: PlenopticCamera,
    point: ArrayLike,
    *,
    wavelengths: float | Sequence[float] | None = None,
    weights: ArrayLike | None = None,
) -> WaveSpread:
    """The image of a point, with diffraction at the main lens and the microlenses and interference between these.

    The counterpart of `plenoptic.point_spread`, which follows rays, in the same units. The point sends out light of
    each wavelength by itself; their arriving light is added.

    Parameters
    ----------
    camera : PlenopticCamera
        Its sensor parallel to the array. Dust, walls between microlenses and pixels' responses to directions are not
        known here.
    point : (3,) array
        World position in mm, in front of the lens.
    wavelengths : float or sequence of float, optional
        In vacuum, nm; None: that of the camera.
    weights : (w,) array, optional
        Light of each; all alike if it is left out. Their sum does not matter.

    Returns
    -------
    WaveSpread
        With a `Sampling` for each wavelength, whose `error` says how far numbers can be trusted. All zero where no
        light passes the lens.

    Raises
    ------
    InvalidValueError
        For a camera that is not supported here, with microlenses without extent (PINHOLE), a point that is not in front
        of the lens, light that is nearly parallel behind it, or that needs more than 67 million samples.

    Notes
    -----
    Plane waves behind the main lens get their phases and amplitudes from rays (see `plenoptic.wave.beam`). Their sum on
    the plane of the array is multiplied by the factor of each microlens: its opening, and its phase as a thin element,
    the microlens where it really stands. All of it goes on to the sensor at once, by a band-limited angular spectrum.
    Light is then shared among pixels by area.

    THIN microlenses and ideal main lenses are ideal for rays: they shear slopes. Their waves are paraxial, and go where
    the library's rays go at any aperture. Plates (SPHERICAL, FLAT_HIGH_INDEX) are thin elements with the phase of their
    sag, in exact waves.

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
    given = positions(point, name="point", shape=(3,))
    waves = checked_wavelengths(camera.wavelength if wavelengths is None else wavelengths)
    light = np.ones(len(waves)) if weights is None else numbers(weights, "weights")
    if light.shape != (len(waves),) or not (np.isfinite(light) & (light >= 0)).all() or not light.any():
        raise InvalidValueError(f"weights must be {len(waves)} numbers, not negative and not all 0")
    parts = [_of_wavelength(dataclasses.replace(camera, wavelength=wave), given, DENSER) for wave in waves]
    return _added(camera, given, np.array(waves), light / light.sum(), parts)


class _Part(NamedTuple):
    """Pattern of one wavelength."""

    pixels: Pixels
    light: float
    sampling: Sampling


def _check_camera(camera: PlenopticCamera) -> None:
    check_kind(camera, "camera", PlenopticCamera, "pl.PlenopticCamera(...)")
    array = camera.microlenses
    if array is not None and array.model.rules.to_sensor is None:
        raise InvalidValueError(
            f"the microlenses have the model {array.model.name}, and no light passes a hole without extent; choose THIN"
        )
    unknown = {
        "a sensor tilted against the array (sensor_placement)": assembly(camera).tilt is not None,
        "walls between microlenses": array is not None and array.walls is not Walls.NONE,
        "an angular response of pixels": camera.sensor.angular_response is not None,
        "blemishes": bool(camera.blemishes),
    }
    for what, there in unknown.items():
        if there:
            raise InvalidValueError(f"the camera has {what}, which waves do not know here; leave it out")


def _of_wavelength(camera: PlenopticCamera, point: Floats, denser: float) -> _Part | None:
    """The image of a point at the camera's wavelength; None without light."""
    beam = beam_of(camera, point)
    if beam is None:
        return None
    lenses, distance = None, 0.0
    if camera.microlenses is not None:
        lenses, distance = microlenses_around(beam.record, *lit_box(beam)), beam.record.array.parts.distance
    grid = grid_for(beam, lenses, distance, denser)
    made = plane_waves(beam, grid)
    waves, area, lost = made.waves, float(grid.spacing.prod()), 0.0
    met = passed = power(waves)
    if lenses is not None:
        waves, met, passed = through_array(waves, beam, grid, lenses)
    # Behind edges the light of steep directions falls with their square.
    steep = outermost(waves) * (1.0 - OUTERMOST) / OUTERMOST
    if lenses is not None:
        lost = to_sensor(waves, beam, grid)
    arriving = power(waves)
    pixels, seen = on_pixels(waves, grid, camera.sensor)
    sampling = Sampling(
        wavelength=camera.wavelength,
        spacing=grid.spacing,
        shape=np.array(grid.shape),
        denser=denser,
        directions=made.directions,
        phase_error=beam.phase_error,
        beside=max(0.0, 1.0 - met / made.power),
        stopped=1.0 - passed / met,
        steep=steep / passed,
        lost=lost / passed + max(0.0, 1.0 - seen / (arriving * area)),
    )
    return _Part(pixels, made.light, sampling)


def _added(
    camera: PlenopticCamera, point: Floats, wavelengths: Floats, weights: Floats, parts: list[_Part | None]
) -> WaveSpread:
    """Images of wavelengths on the pixels of all of them."""
    passing = [(weight, part) for weight, part in zip(weights.tolist(), parts, strict=True) if part]
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
        samplings=tuple(part.sampling for part in parts if part),
        sensor=camera.sensor,
    )
