"""Bundled cases of the error study: the reference camera and its scenes, and one that is smooth."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.design.example import example_camera
from plenoptic.rendering.settings import Sampler
from plenoptic.scene.shapes.procedural import check_scene, objects_scene
from plenoptic.study.cameras import smooth_camera
from plenoptic.study.error_time.study import SIDE, error_against_time
from plenoptic.study.error_time.table import ErrorTable
from plenoptic.study.error_time.variants import Variant
from plenoptic.study.exposures import central_region

if TYPE_CHECKING:
    from plenoptic.scene.scene import Scene

QUICK_SAMPLES, QUICK_SEEDS, QUICK_SIDE, QUICK_FACTOR = (8, 16, 32), 3, 32, 8
SEEDS = 8


class ErrorCase(NamedTuple):
    """A scene and a camera, and how thoroughly they are studied."""

    name: str
    what: str
    """Sentences on it."""
    scene: Callable[[], Scene | None]
    """Makes it; None is the white image."""
    camera: Callable[[], PlenopticCamera]
    samples: tuple[int, ...]
    reference: Variant
    reference_samples: int
    variants: Callable[[], dict[str, Variant]] = dict
    """Makes them; none: the default ones."""


def _samplers() -> dict[str, Variant]:
    return {
        "2 replicates": Variant(),
        "1 replicate": Variant(replicates=1),
        "RANDOM sampler": Variant(sampler=Sampler.RANDOM),
    }


_MANY = (16, 32, 64, 128, 256, 512, 1024)

_CASES = (
    ErrorCase(
        "white",
        "The reference camera in mode 2.0, a world of radiance 1 and no scene: what is left is the camera.",
        lambda: None,
        example_camera,
        _MANY,
        Variant(),
        1 << 15,
    ),
    ErrorCase(
        "smooth",
        "White again, behind one microlens between walls, and with the lens wide open: nothing cuts the light of a "
        "pixel, and what is left to integrate is smooth. Models of the lens make no difference here.",
        lambda: None,
        smooth_camera,
        _MANY,
        Variant(),
        1 << 14,
        _samplers,
    ),
    ErrorCase(
        "check",
        "Mode 2.0 and a plane of squares of 1 mm that shine or are black, in focus; nothing scatters.",
        check_scene,
        example_camera,
        _MANY,
        Variant(),
        1 << 15,
    ),
    ErrorCase(
        "objects",
        "Mode 2.0; a matt cube, a ball of metal and one of glass before a checkerboard, under a lamp: several bounces, "
        "and caustics that paths find by chance only. The reference follows 32 bounces, the variants 8 unless they say "
        "otherwise.",
        objects_scene,
        example_camera,
        (8, 16, 32, 64, 128, 256),
        Variant(max_bounces=32),
        1 << 13,
    ),
)


ERROR_CASES = {case.name: case for case in _CASES}
"""The bundled cases by their names."""


def case_table(case: ErrorCase, *, quick: bool, threads: int = 1, progress: bool = False) -> ErrorTable:
    """Study a bundled case on the central pixels; quick: with 32 x 32 pixels, 3 seeds and few samples."""
    camera, side = case.camera(), QUICK_SIDE if quick else SIDE
    return error_against_time(
        case.scene(),
        camera,
        case.variants() or None,
        samples=QUICK_SAMPLES if quick else case.samples,
        region=central_region(camera.sensor.shape, side),
        seeds=QUICK_SEEDS if quick else SEEDS,
        reference=case.reference,
        reference_samples=QUICK_FACTOR * QUICK_SAMPLES[-1] if quick else case.reference_samples,
        threads=threads,
        title=case.name,
        progress=progress,
    )
