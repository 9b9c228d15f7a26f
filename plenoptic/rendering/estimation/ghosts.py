"""Estimate of the time and memory that the ghosts of a lens take, from pilot runs of their own."""

from __future__ import annotations

import dataclasses
import time
import warnings

from plenoptic.errors import PlenopticWarning
from plenoptic.rendering.context import render_context
from plenoptic.rendering.estimation.costs import Costs, Pilots, costs_by_samples
from plenoptic.rendering.estimation.errors import render_error
from plenoptic.rendering.estimation.estimated import Estimate, Estimated
from plenoptic.rendering.estimation.memory import truth_bytes
from plenoptic.rendering.estimation.totals import about, totals
from plenoptic.rendering.ghosts.ghosts_exposure import ghost_subject
from plenoptic.rendering.schedule.budget import Budget

_UNSURE = 0.2
"""Relative uncertainty of the time of the set-up."""


def with_ghosts(estimate: Estimate, image: Pilots, costs: Costs) -> Estimate:
    """Estimate of a render with the ghosts of its camera's lens; `image` and `costs` are those of the image.

    Compiling the pairs of surfaces is a part of it, since each render does so.
    """
    subject, threads = image.subject, image.threads
    scene, ghosts = subject.scene, subject.settings.ghosts
    assert scene is not None and ghosts is not None
    if scene.points is not None:
        from plenoptic.rendering.estimation.particles import with_particles

        estimate = with_particles(estimate, scene, subject.camera, None, threads, ghosts)
        if not scene.has_surfaces_or_light:
            return estimate
    most, seconds = costs.most_samples, 0.0
    for _ in range(2):  # the first compiles kernels
        begin = time.process_time()
        of_ghosts = ghost_subject(subject, round(most.value), subject.replicates)
        context = render_context(of_ghosts, 0)
        seconds = time.process_time() - begin
    budget = Budget(of_ghosts.samples, None, None, of_ghosts.replicates)
    pilots = Pilots(context, of_ghosts, budget, image.region, threads)
    with warnings.catch_warnings():
        # Ghosts may well be dark.
        warnings.simplefilter("ignore", PlenopticWarning)
        own = costs_by_samples(pilots)
        light = totals(pilots, own)
        runs = tuple(image.run_on(run, round(costs.samples.value)) for run in own.runs)
    ratio = Estimated(1.0, most.low / most.value, most.high / most.value)
    part = Estimated(1.0, 1.0, 1.0) if ghosts.samples is not None else ratio
    set_up = about(seconds, _UNSURE)
    exposure_bytes = image.pixels * (8 * image.context.channels + truth_bytes(subject.truth))
    return dataclasses.replace(
        estimate,
        cpu_seconds=_sum(estimate.cpu_seconds, light.cpu_seconds, part, set_up),
        seconds=_sum(estimate.seconds, light.seconds, part, set_up),
        relative_error=None if scene.points is not None else render_error(image.budget, costs._replace(runs=runs), own),
        peak_memory=Estimated(
            *(max(a, b + exposure_bytes) for a, b in zip(estimate.peak_memory, light.peak_memory, strict=True))
        ),
    )


def _sum(image: Estimated, light: Estimated, part: Estimated, set_up: Estimated) -> Estimated:
    return Estimated(*(a + b * c + d for a, b, c, d in zip(image, light, part, set_up, strict=True)))
