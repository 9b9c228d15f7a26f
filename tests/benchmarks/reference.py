"""The reference camera: Tronnier's double Gauss, a hexagonal microlens array and 512 x 512 pixels."""

from __future__ import annotations

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
    def title(self) -> str:
        return "2.0" if self is Mode.FOCUSED else "1.0"


def camera(mode: Mode = Mode.FOCUSED, *, sensor: pl.Sensor | None = None) -> pl.PlenopticCamera:
    to_sensor, semi_diameter = mode.value
    return pl.PlenopticCamera(
        lens=pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter)),
        microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)),
        sensor=pl.Sensor(shape=(512, 512), pixel_pitch=0.010) if sensor is None else sensor,
        stop_to_microlenses=123.3,
        microlenses_to_sensor=to_sensor,
    )


def exposed(scene: pl.Scene | None, camera: pl.PlenopticCamera, **settings: object) -> pl.Exposure:
    """`render`, or `render_white` where the scene is None, which knows no truth."""
    if scene is None:
        settings.pop("truth", None)
        return pl.render_white(camera, progress=False, **settings)
    return pl.render(scene, camera, progress=False, **settings)


def noise(seed: int, size: int, *, sides: tuple[float, float] = (1.0, 1.0), shortest: float = 0.0) -> np.ndarray:
    """(size, size): noise whose amplitudes fall as 1 / frequency, of mean 0 and standard deviation 1.

    On a rectangle of some height and width; waves shorter than `shortest` are left out.
    """
    down, right = np.meshgrid(*(np.fft.fftfreq(size, side / size) for side in sides), indexing="ij")
    frequency = np.hypot(down, right)
    passed = frequency * shortest < 1.0
    frequency[0, 0] = np.inf
    found = np.fft.ifft2(np.fft.fft2(np.random.default_rng(seed).normal(size=(size, size))) / frequency * passed).real
    return found / found.std()
