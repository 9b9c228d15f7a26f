"""Tracing paths of an exposure again."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from plenoptic.camera.checks import check_scene_and_camera
from plenoptic.camera.sampling.sampling_records import Batch
from plenoptic.core.values import Floats, check_kind, whole, wrong_kind
from plenoptic.errors import InvalidValueError, SceneError
from plenoptic.rendering.context import RenderContext, batch_of, render_context
from plenoptic.rendering.exposure import Exposure
from plenoptic.rendering.integrator.path import PathIntegrator
from plenoptic.rendering.kernels.film_sums import Light, clamp_radiance, fill_sums
from plenoptic.rendering.plan.stages import Stage, Subject
from plenoptic.replaying.events import Escape, Event, PathEnding, WorldRay
from plenoptic.replaying.in_camera import CameraPath, trace_camera
from plenoptic.replaying.in_scene import Recorder
from plenoptic.replaying.replay import Replay
from plenoptic.scene.scene import Scene
from plenoptic.truth.channels import Truth


def replay(exposure: Exposure, scene: Scene | None, *, pixel: tuple[int, int], sample: int) -> Replay:
    """Trace one path of an exposure again, with all its intersections.

    Parameters
    ----------
    exposure : Exposure
        From `render` or `render_white`, or loaded from the .exr file to which it was saved.
    scene : Scene or None
        The rendered scene; None for `render_white`.
    pixel : (int, int)
        Row and column on the whole sensor, also where a region was rendered.
    sample : int
        Number of the path in the pixel, from 0: replicate `sample % replicates`, there number `sample // replicates`.

    Returns
    -------
    Replay

    Raises
    ------
    InvalidValueError
        If the exposure does not store its camera, seed or settings, the pixel is outside its region, or it has fewer
        samples there; if a scene is given for a white image, or none for another; if the image has other channels than
        the scene would give.

    Notes
    -----
    The renderer's own kernels trace the path: on the same machine `contribution` is that of the pixel's sum, bit for
    bit (up to rounding with a fill factor below 1, which multiplies the sum of the image, and each path here). With
    diffraction at microlenses, `contribution` is shared by the path's pixel and those around it, and long deflections,
    which have paths of their own, are not among the samples. Of two coincident triangles, which one a path hits may
    depend on the paths traced with it.

    An exposure stores its camera, seed and settings, but not its scene: with another scene, or another version of this
    package, the path is the one that *this* scene would have. The image shows it: the mean of `contribution` over all
    samples of a pixel is its value.

    Examples
    --------
    >>> import dataclasses, numpy as np, plenoptic as pl
    >>> camera = pl.camera.example_camera()
    >>> camera = dataclasses.replace(camera, lens=camera.lens.with_model(pl.LensModel.THIN))
    >>> scene = pl.shapes.white_plane()
    >>> shot = pl.render(scene, camera, samples=16, region=np.s_[256:257, 256:257], progress=False)
    >>> pl.replay(shot, scene, pixel=(256, 256), sample=9)      # doctest: +ELLIPSIS
    sample 9 of pixel (256, 256): replicate 1, point 4
    sensor     from (...) mm
    array      microlens (0, 0), type 0, aimed at (..., 123.3) mm, 0.01... sr
               leaves (..., 123.3) mm towards (...)
    lens        5 circular stop at (...) mm, towards (...)
    lens        5 ideal lens at (...) mm, towards (...)
    world      from (...) mm towards (...)
    bounce 0   object 0, triangle ..., Emissive, after ... mm
               at (..., -404) mm, normal (0, 0, 1)
               emits (1)
    ends       absorbed
    brings     radiance (1), times 0.01... sr
    adds       (0.01...)
    >>> ways = pl.replaying.replay_all(shot, scene, [(256, 256, sample) for sample in range(16)])
    >>> bool(abs(np.mean([way.contribution for way in ways]) / shot.image[0, 0, 0] - 1) < 1e-7)
    True
    """
    return replay_all(exposure, scene, [(*_members(pixel, "pixel", "row", "column"), sample)])[0]


def replay_all(exposure: Exposure, scene: Scene | None, paths: Iterable[tuple[int, int, int]]) -> tuple[Replay, ...]:
    """Trace several paths of an exposure again; scene and camera are compiled once.

    Parameters
    ----------
    exposure, scene
        As for `replay`.
    paths : iterable of (int, int, int)
        Row, column and sample of each, such as `exposure.stats.nonfinite_paths`.

    Returns
    -------
    tuple of Replay

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.PlenopticCamera(pl.no_lens(1.0), pl.Sensor(shape=(4, 4), pixel_pitch=0.1), 10.0)
    >>> sky = pl.Scene(background=1.0)
    >>> shot = pl.render(sky, camera, samples=8, progress=False)
    >>> [way.ending.name for way in pl.replaying.replay_all(shot, sky, [(0, 0, 0), (3, 1, 7)])]
    ['LEFT_SCENE', 'LEFT_SCENE']
    """
    context = _context(exposure, scene)
    if isinstance(paths, str | bytes) or not isinstance(paths, Iterable) or getattr(paths, "ndim", 1) == 0:
        raise wrong_kind(paths, "paths", "sequence of (row, column, sample)", "exposure.stats.nonfinite_paths")
    checked = (_check_path(exposure, *_members(path, "a path", "row", "column", "sample")) for path in paths)
    return tuple(_retrace(context, scene, *path) for path in checked)


def _context(exposure: Exposure, scene: Scene | None) -> RenderContext:
    """Context of the original render; raise InvalidValueError if the exposure does not store it."""
    check_kind(exposure, "exposure", Exposure, "pl.render(scene, camera, samples=64)")
    needed = {name: getattr(exposure, name) for name in ("camera", "settings", "seed", "replicates", "samples")}
    camera, settings, seed, replicates, samples = needed.values()
    if None in needed.values():
        missing = ", ".join(name for name, item in needed.items() if item is None)
        raise InvalidValueError(
            f"the exposure does not know its {missing}; only what `render` made can be replayed, or an .exr file to "
            "which that was saved"
        )
    if isinstance(seed, tuple):
        raise InvalidValueError(
            f"the exposure was merged of the seeds {', '.join(map(str, seed))}; replay one that has a single seed"
        )
    if exposure.white is not None and exposure.white != (scene is None):
        raise InvalidValueError(
            "the exposure is a white image, which has no scene; give None in its place"
            if exposure.white
            else "the exposure is the image of a scene, and only white images have none; give the scene rendered"
        )
    check_scene_and_camera(scene, camera)
    context = render_context(Subject(scene, camera, samples, replicates, Truth.NONE, settings), seed)
    if context.channels != exposure.image.shape[2]:
        raise InvalidValueError(
            f"the image has {exposure.image.shape[2]} channels, and this scene gives {context.channels}; give the "
            "scene that was rendered"
        )
    return context


def _members(given: Any, name: str, *members: str) -> Any:
    """Members of a sequence; raise InvalidValueError unless they are as many as named."""
    given = given.tolist() if isinstance(given, np.ndarray) else given
    if not isinstance(given, tuple | list) or len(given) != len(members):
        raise InvalidValueError(f"{name} is {given!r}; it must be ({', '.join(members)})")
    return given


def _check_path(exposure: Exposure, row: int, column: int, sample: int) -> tuple[tuple[int, int], int]:
    """Pixel and sample of a path; raise InvalidValueError if the exposure has no such path."""
    row, column = whole(row, "row of the pixel", at_least=0), whole(column, "column of the pixel", at_least=0)
    height, width = exposure.image.shape[:2]
    first_row, end_row, first_column, end_column = exposure.region or (0, height, 0, width)
    if not (first_row <= row < end_row and first_column <= column < end_column):
        raise InvalidValueError(
            f"pixel ({row}, {column}) is outside the exposure, which has rows {first_row} to {end_row - 1} and columns "
            f"{first_column} to {end_column - 1} of the sensor"
        )
    counts = exposure.sample_counts
    samples = exposure.samples if counts is None else int(counts[row - first_row, column - first_column])
    sample = whole(sample, "sample", at_least=0)
    if samples is None or sample >= samples:
        raise InvalidValueError(
            f"sample is {sample}, and pixel ({row}, {column}) has {samples} samples; it must be below that"
        )
    return (row, column), sample


def _retrace(context: RenderContext, scene: Scene | None, pixel: tuple[int, int], sample: int) -> Replay:
    camera, replicates = context.camera, context.replicates
    place = (pixel, sample, sample % replicates, sample // replicates)
    batch = batch_of(context, sample, 1)
    path = trace_camera(camera, pixel, batch, with_core=context.plan.runs(Stage.UNVIGNETTED_CORE))
    if path is None:
        nothing = np.zeros(context.channels)
        return Replay(*place, None, (), PathEnding.UNLIT_PIXEL, 0.0, 0.0, nothing, 1.0, nothing, True)
    events, radiance, ending = _through_scene(context, scene, path, batch)
    limit, brightest = context.settings.clamp, 0.0 if radiance is None else float(radiance.max())
    if limit is not None and radiance is not None:
        clamp_radiance(radiance, path.bundle, 1, limit)
    sums, weights, wavelength = np.zeros((1, 2, context.channels)), None, None
    if camera.colour is not None:
        weights = camera.colour.weights
        wavelength = None if path.waves is None else float(camera.colour.wavelengths[path.waves[0]])
    dropped = fill_sums(sums, Light(path.bundle, radiance, path.waves, weights), 0, 1, batch)
    added, fill_factor = sums[0, 0], camera.sensor.fill_factor
    return Replay(
        *place,
        wavelength=wavelength,
        events=path.events + events,
        ending=PathEnding.NOT_FINITE if dropped else ending,
        weight=path.weight,
        certain=path.core_weight,
        radiance=np.ones(1) if radiance is None else radiance[0].copy(),
        clamped=1.0 if limit is None or not brightest > limit else limit / brightest,
        contribution=added if fill_factor == 1 else fill_factor * added,
        finite=not dropped,
    )


def _through_scene(
    context: RenderContext, scene: Scene | None, path: CameraPath, batch: Batch
) -> tuple[tuple[Event, ...], Floats | None, PathEnding]:
    """Trace a path in front of the lens; its radiance is None in a white image."""
    from plenoptic.core.kernels.bundles import fill_world_rays

    camera = context.camera
    if scene is None or context.scene is None:
        rays, lanes = np.empty((1, 6)), np.empty(1, dtype=np.int64)
        if not fill_world_rays(rays, lanes, path.bundle, 1, camera.rotation, camera.position):
            return (), None, PathEnding.LOST
        escape = Escape(rays[0, 3:], np.ones(1))
        return (WorldRay(rays[0, :3], rays[0, 3:], path.weight), escape), None, PathEnding.LEFT_SCENE
    if context.scene.media is not None:
        raise SceneError("replay shows surfaces only, and a medium of this scene scatters; give it scattering=0")
    integrator = PathIntegrator(context, 1)
    recorder = Recorder(scene, integrator, context.plan, context.settings.max_bounces)
    radiance = integrator.radiance(path.bundle, 0, 1, batch, path.pixel.number, path.waves, recorder)
    if recorder.start is None:
        return (), radiance, PathEnding.LOST
    ray = WorldRay(recorder.start[:3], recorder.start[3:], path.weight)
    return (ray, *recorder.events), radiance, recorder.ending
