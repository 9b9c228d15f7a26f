"""Bundled cases of the error study: the reference camera with its scenes, and a smooth one."""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.design.example import example_camera
from plenoptic.optics.lens.files.library import load_lens
from plenoptic.optics.microlens.aperture import Walls
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lattice import Lattice
from plenoptic.optics.sensor.sensor import Sensor
from plenoptic.rendering.settings import Sampler
from plenoptic.scene.scene import Scene
from plenoptic.scene.shapes.procedural import check_scene, objects_scene
from plenoptic.study.error_time.error_study import SIDE, error_against_time
from plenoptic.study.error_time.error_table import ErrorTable
from plenoptic.study.error_time.variants import Variant
from plenoptic.study.exposures import central_region

QUICK_SAMPLES, QUICK_SEEDS, QUICK_SIDE, QUICK_FACTOR = (8, 16, 32), 3, 32, 8
SEEDS = 8


def smooth_camera() -> PlenopticCamera:
    """The reference camera wide open, 20 x 20 pixels behind one square microlens between walls: nothing clips light."""
    array = MicrolensArray(pitch=0.217, focal_lengths=(2.0,), lattice=Lattice.SQUARE, walls=Walls.OPAQUE)
    sensor = Sensor(shape=(20, 20), pixel_pitch=0.010)
    wide_open = load_lens("double-gauss-100mm-f2")
    return dataclasses.replace(example_camera(), lens=wide_open, microlenses=array, sensor=sensor)


class ErrorCase(NamedTuple):
    """A scene and a camera, and the numbers of samples of their study."""

    description: str
    scene: Callable[[], Scene | None]
    """Makes the scene; None is the white image."""
    samples: tuple[int, ...]
    reference_samples: int
    camera: Callable[[], PlenopticCamera] = example_camera
    reference: Variant = Variant()
    variants: dict[str, Variant] | None = None
    """None: the default ones."""


_MANY = (16, 32, 64, 128, 256, 512, 1024)
_SAMPLERS = {
    "2 replicates": Variant(),
    "1 replicate": Variant(replicates=1),
    "RANDOM sampler": Variant(sampler=Sampler.RANDOM),
}

ERROR_CASES = {
    "white": ErrorCase(
        "The reference camera in mode 2.0, a world of radiance 1 and no scene: the noise is that of the camera.",
        lambda: None,
        _MANY,
        1 << 15,
    ),
    "smooth": ErrorCase(
        "White again, behind one microlens between walls, and with the lens wide open: nothing clips the light of a "
        "pixel, and the integrand is smooth. Models of the lens make no difference here.",
        lambda: None,
        _MANY,
        1 << 14,
        smooth_camera,
        variants=_SAMPLERS,
    ),
    "check": ErrorCase(
        "Mode 2.0 and a plane of squares of 1 mm that shine or are black, in focus; nothing scatters.",
        check_scene,
        _MANY,
        1 << 15,
    ),
    "objects": ErrorCase(
        "Mode 2.0; a matt cube, a ball of metal and one of glass before a checkerboard, under a lamp: several bounces, "
        "and caustics that paths find by chance only. The reference follows 32 bounces, the variants 8 unless they say "
        "otherwise.",
        objects_scene,
        (8, 16, 32, 64, 128, 256),
        1 << 13,
        reference=Variant(max_bounces=32),
    ),
}
"""The bundled cases by their names."""


def case_table(name: str, *, quick: bool, threads: int = 1, progress: bool = False) -> ErrorTable:
    """Study a bundled case on the central pixels; quick: with 32 x 32 pixels, 3 seeds and few samples."""
    case = ERROR_CASES[name]
    camera = case.camera()
    return error_against_time(
        case.scene(),
        camera,
        case.variants,
        samples=QUICK_SAMPLES if quick else case.samples,
        region=central_region(camera.sensor.shape, QUICK_SIDE if quick else SIDE),
        seeds=QUICK_SEEDS if quick else SEEDS,
        reference=case.reference,
        reference_samples=QUICK_FACTOR * QUICK_SAMPLES[-1] if quick else case.reference_samples,
        threads=threads,
        title=name,
        progress=progress,
    )
