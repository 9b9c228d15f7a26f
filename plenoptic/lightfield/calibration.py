"""What matching mistakes, measured on planes at known depth that the camera itself renders."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.report.optics import lateral_magnification, object_plane
from plenoptic.core.parallel import thread_count
from plenoptic.core.values import Floats, check_kind, result, seed_number, whole
from plenoptic.errors import InvalidValueError
from plenoptic.lightfield.estimation import depth_sign, estimated, focused_array
from plenoptic.lightfield.planes import raw_planes
from plenoptic.rendering.exposure import Exposure
from plenoptic.scene.materials.emissive import Emissive
from plenoptic.scene.scene import Scene
from plenoptic.scene.shapes.procedural import quad
from plenoptic.scene.textures.texture import Texture
from plenoptic.truth.channels import Truth

_PLANES = 6
_NEAREST, _FARTHEST = 2.2, 14.0
"""Virtual depths of the planes: beyond them microlens images overlap too little, or move too little."""
_RADII = np.array([0.0, 0.15, 0.25, 0.35, 0.45])
_LENSES = 5.0
"""Pitches from the middle of the sensor within which microlenses are rendered, and one less within which they count."""
_TEXELS = 512
_CONTRAST = 0.2
_LIGHT = 0.1
_LEAST, _MOST = 1.8, 25.0
"""Virtual depths that are looked for."""
_RING = 0.075
"""Pitches around the radii of the table within which pixels count."""


@result
class DepthCalibration:
    """Disparities that matching finds, of planes whose disparities are known. See `calibrate_depth`, which makes it.

    Attributes
    ----------
    found : (types, radii, planes) array
        Disparity that matching finds in microlenses of a type, at a distance from the middle of their images: the
        median, in pixels; rising along planes.
    known : (types, radii, planes) array
        The chord's disparity there.
    radii : (radii,) array
        These distances over the pitch.
    """

    found: Floats
    known: Floats
    radii: Floats

    def factor(self, disparity: Floats, types: Floats, radius: Floats) -> Floats:
        """What disparities (k, n, n) of microlenses of types (k,) are to be multiplied by, interpolated linearly.

        `radius` (k, n, n) is the distance from the middle of the image over the pitch. Beyond the planes and radii of
        the table its last values hold.
        """
        ratio = self.known / self.found
        place = np.interp(radius, self.radii, np.arange(len(self.radii)))
        low = np.minimum(place.astype(np.int64), len(self.radii) - 2)
        share, factor = place - low, np.ones_like(disparity)
        for kind in range(len(self.found)):
            mine = types == kind
            for k in range(len(self.radii)):
                weight = np.where(low[mine] == k, 1.0 - share[mine], 0.0) + np.where(
                    low[mine] == k - 1, share[mine], 0.0
                )
                here = np.interp(disparity[mine], self.found[kind, k], ratio[kind, k])
                factor[mine] += weight * (here - 1.0)
        return factor


def calibrate_depth(
    camera: PlenopticCamera, *, radius: int = 2, samples: int = 64, seed: int = 0, threads: int | None = None
) -> DepthCalibration:
    """Measure what `depth` mistakes in the images of a camera, on six textured planes that are rendered for it.

    Where a point is out of focus, its light falls to the side that is lit of a microlens: vignetting displaces its
    image, the more the farther it is from the middle of the microlens image.

    Parameters
    ----------
    camera : PlenopticCamera
        Focused, with microlenses on a lattice.
    radius : int, optional
        As in `depth`.
    samples : int, optional
        Of each pixel.
    seed : int, optional
        Of the texture and of the noise.
    threads : int, optional
        As in `render`.

    Returns
    -------
    DepthCalibration
        Of microlenses in the middle of the sensor: where vignetting differs much beyond, its corners do.

    Raises
    ------
    InvalidValueError
        As in `depth`, or where the sensor holds too few microlens images or no plane lies before the lens.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.PlenopticCamera(
    ...     lens=pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=5.0)),
    ...     microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)),
    ...     sensor=pl.Sensor(shape=(512, 512), pixel_pitch=0.01), stop_to_microlenses=123.3, microlenses_to_sensor=1.7)
    >>> calibration = pl.lightfield.calibrate_depth(camera, samples=16)
    >>> calibration.found.shape
    (1, 5, 6)
    """
    from plenoptic.rendering.render import render, render_white

    check_kind(camera, "camera", PlenopticCamera, "pl.PlenopticCamera(...)")
    array, workers = focused_array(camera), thread_count(threads)
    radius, samples = whole(radius, "radius", at_least=1, at_most=8), whole(samples, "samples", at_least=4)
    seed = seed_number(seed)
    plain = dataclasses.replace(camera, pose=None)
    region = _middle(plain, max(array.pitches))
    options = {"samples": samples, "region": region, "threads": threads, "progress": False}
    white = render_white(plain, seed=seed + 1, **options)
    tables = []
    for number, v in enumerate(depth_sign(plain) * np.geomspace(_FARTHEST, _NEAREST, _PLANES)):
        z = object_plane(camera.lens, camera.stop_to_microlenses + v * camera.microlenses_to_sensor, camera.wavelength)
        if not (math.isfinite(z) and z < min(0.0, float(camera.lens.vertices[0]))):
            continue
        scene = _textured(plain, z, v, seed + number)
        shot = render(scene, plain, seed=seed, truth=Truth.CHORD_DISPARITY, **options)
        tables.append(_table(shot, white, radius, workers))
    if len(tables) < 2:
        raise InvalidValueError(
            "fewer than two planes of the virtual depths lie in front of the lens; focus the camera"
        )
    found, known = (np.stack(part, axis=-1) for part in zip(*tables, strict=True))
    order = np.argsort(found[0, 0])
    return DepthCalibration(found[..., order], known[..., order], _RADII.copy())


def _middle(camera: PlenopticCamera, pitch: float) -> tuple[slice, slice]:
    """The rows and columns that are rendered."""
    half = math.ceil(_LENSES * pitch / camera.sensor.pixel_pitch)
    rows, columns = (
        slice(max(0, length // 2 - half), min(length, length // 2 + half)) for length in camera.sensor.shape
    )
    return rows, columns


def _textured(camera: PlenopticCamera, z: float, v: float, seed: int) -> Scene:
    """A plane across the axis with noise of all frequencies that its image can hold, which glows."""
    rng = np.random.default_rng(seed)
    frequency = np.hypot(*np.meshgrid(*[np.fft.fftfreq(_TEXELS)] * 2))
    frequency[0, 0] = 1.0
    noise = np.fft.ifft2(np.fft.fft2(rng.normal(size=(_TEXELS, _TEXELS))) / frequency).real
    noise = 0.5 + _CONTRAST * (noise - noise.mean()) / noise.std()
    # A texel is as large as a pixel, seen through microlens and lens.
    texel = abs(v * camera.sensor.pixel_pitch / lateral_magnification(camera.lens, z, camera.wavelength))
    side = texel * _TEXELS
    texture = Texture(np.clip(noise, 0.02, 1.0)[..., None].astype(np.float32))
    return Scene([quad((-side / 2, -side / 2, z), (side, 0, 0), (0, side, 0), material=Emissive(texture))])


def _table(shot: Exposure, white: Exposure, radius: int, threads: int) -> tuple[Floats, Floats]:
    """Medians of the disparities that are found and known, (types, radii), of microlenses amid others."""
    assert shot.camera is not None and shot.truth is not None and shot.truth.chord_disparity is not None
    array = focused_array(shot.camera)
    lenses, disparity, _ = estimated(shot.camera, raw_planes(shot, white, _LIGHT), (_LEAST, _MOST), radius, threads)
    rows, columns = lenses.rows_and_columns()
    size = np.array(shot.image.shape[:2])
    amid = (np.abs(lenses.centre - 0.5 * (size - 1)) <= 0.5 * size - 2.0 * lenses.pitch).all(axis=1)
    truth = np.full(disparity.shape, np.nan)
    seen = lenses.images.known > 0
    lens, y, x = np.nonzero(seen)
    truth[lens, y, x] = shot.truth.chord_disparity[rows[lens, y, 0], columns[lens, 0, x]]
    both = np.isfinite(truth) & np.isfinite(disparity) & amid[:, None, None]
    ring = np.abs(lenses.radius()[None] - _RADII[:, None, None, None]) <= _RING
    shape = (len(array.focal_lengths), len(_RADII))
    found, known = np.empty(shape), np.empty(shape)
    for kind, k in np.ndindex(shape):
        mine = both & ring[k] & (lenses.type == kind)[:, None, None]
        if not mine.any():
            raise InvalidValueError("the sensor holds too few microlens images to calibrate with; take a larger one")
        found[kind, k], known[kind, k] = np.median(disparity[mine]), np.median(truth[mine])
    return found, known
