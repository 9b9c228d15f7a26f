"""The reference camera: Tronnier's double Gauss, a hexagonal microlens array and 512 x 512 pixels."""

import enum

import numpy as np

import plenoptic as pl


class Mode(enum.Enum):
    """Distance from the microlenses to the sensor and semi-diameter of the stop in mm."""

    FOCUSED = (1.7, 5.0)
    """Plenoptic 2.0: the microlenses look at the plane z = -404."""
    UNFOCUSED = (2.0, 4.25)
    """Plenoptic 1.0: the sensor is in the microlenses' focal plane."""

    @property
    def title(self):
        return "2.0" if self is Mode.FOCUSED else "1.0"


def camera(mode=Mode.FOCUSED, *, sensor=None):
    to_sensor, semi_diameter = mode.value
    return built(sensor or pl.Sensor(shape=(512, 512), pixel_pitch=0.010), b=to_sensor, stop=semi_diameter)


def built(sensor, *, stop=5.0, z=123.3, b=1.7, pitch=0.217, focal_lengths=(2.0,), **array):
    """The same with other parts; a shape in place of the sensor has pixels of 10 um."""
    sensor = sensor if isinstance(sensor, pl.Sensor) else pl.Sensor(shape=sensor, pixel_pitch=0.010)
    lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(stop))
    return pl.PlenopticCamera(lens, sensor, z, pl.MicrolensArray(pitch, focal_lengths, **array), b)


def middle(side, *, of=512):
    """The square region of so many pixels a side in the middle of a sensor."""
    part = slice(of // 2 - side // 2, of // 2 + side // 2)
    return part, part


def exposed(scene, camera, **settings):
    """`render`, or `render_white` where the scene is None, which knows no truth."""
    if scene is None:
        settings.pop("truth", None)
        return pl.render_white(camera, progress=False, **settings)
    return pl.render(scene, camera, progress=False, **settings)


def noise(seed, size, *, sides=(1.0, 1.0), shortest=0.0, power=1.0):
    """(size, size): noise whose amplitudes fall as 1 / frequency (or a power), of mean 0 and standard deviation 1.

    On a rectangle of some height and width; waves shorter than `shortest` are left out.
    """
    down, right = np.meshgrid(*(np.fft.fftfreq(size, side / size) for side in sides), indexing="ij")
    frequency = np.hypot(down, right)
    passed = frequency * shortest < 1.0
    frequency[0, 0] = np.inf
    white = np.fft.fft2(np.random.default_rng(seed).normal(size=(size, size)))
    found = np.fft.ifft2(white / frequency**power * passed).real
    return found / found.std()


def grey(noise, contrast=0.2):
    """Radiance of noise: some 0.5, and not dark."""
    return np.clip(0.5 + contrast * noise, 0.02, 1.0)


def glowing(noise, corner, right, up, *, contrast=0.2):
    """A quad that glows with noise, of one channel or several."""
    texels = grey(noise, contrast).reshape(*noise.shape[:2], -1).astype(np.float32)
    return pl.quad(corner, right, up, material=pl.Emissive(pl.Texture(texels)))
