"""Ghosts in exposures: the light of all pairs of reflections is rendered by paths of its own, and added."""

from __future__ import annotations

import dataclasses
import warnings
from typing import TYPE_CHECKING

import numpy as np

from plenoptic.camera.ghosts.ghost_camera import ghost_lens, opening_camera
from plenoptic.core.parallel import thread_count
from plenoptic.core.values import seed_number
from plenoptic.errors import PlenopticWarning
from plenoptic.rendering.exposure import Exposure
from plenoptic.rendering.schedule.budget import Budget
from plenoptic.rendering.schedule.run import RenderOptions, run
from plenoptic.truth.channels import Truth

if TYPE_CHECKING:
    from plenoptic.rendering.plan.stages import Subject

_FRACTION = 4
"""Samples of the image for each of the ghosts, whose light is a small part of it."""
_SEED = (1 << 64) - 1
"""Bits of a seed that ghosts of particles invert."""


def ghost_subject(subject: Subject, samples: int, replicates: int) -> Subject:
    """Subject of the ghosts in an image with a number of samples: light of surfaces and surroundings, not of particles.

    Raises the errors of ghosts that the camera does not have.
    """
    scene, ghosts = subject.scene, subject.settings.ghosts
    assert scene is not None and ghosts is not None
    each = max(samples // _FRACTION // replicates, 1) if ghosts.samples is None else -(-ghosts.samples // replicates)
    return dataclasses.replace(
        subject,
        scene=scene if scene.points is None else dataclasses.replace(scene, points=None),
        camera=opening_camera(subject.camera),
        samples=each * replicates,
        replicates=replicates,
        truth=Truth.NONE,
        ghosts=ghost_lens(subject.camera, ghosts),
    )


def add_ghosts(shot: Exposure, subject: Subject, options: RenderOptions) -> Exposure:
    """Exposure of a scene with the light of the ghosts of its camera's lens; variances add up.

    Their paths have random numbers of their own, which do not depend on those of the image.
    """
    scene, ghosts, samples, replicates = subject.scene, subject.settings.ghosts, shot.samples, shot.replicates
    assert scene is not None and samples is not None and replicates is not None
    if scene.points is not None:
        from plenoptic.rendering.points.points_exposure import add_points, image_of_points

        unlimited, seed = Budget(1, None, None, 1), _SEED ^ seed_number(options.seed)
        threads = thread_count(options.threads)
        shot = add_points(shot, image_of_points(scene, subject.camera, unlimited, seed, threads, ghosts), threads)
        if not scene.has_surfaces_or_light:
            return shot
    of_ghosts = ghost_subject(subject, samples, replicates)
    budget = Budget(of_ghosts.samples, None, None, replicates)
    with warnings.catch_warnings():
        # The image has warned of its own light; ghosts may well be dark.
        warnings.simplefilter("ignore", PlenopticWarning)
        light = run(of_ghosts, budget, options._replace(checkpoint=None, conditioning=None))
    error = shot.standard_error
    if error is not None and light.standard_error is not None:
        error = np.hypot(error, light.standard_error)
    return dataclasses.replace(shot, image=shot.image + light.image, standard_error=error)
