"""The public functions of rendering."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.checks import check_scene_and_camera, warn_if_implausible
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.ghosts.ghost_settings import Ghosts
from plenoptic.rendering.exposure import Exposure
from plenoptic.rendering.plan.stages import Subject
from plenoptic.rendering.schedule.budget import checked_budget
from plenoptic.rendering.schedule.run import RenderOptions, run
from plenoptic.rendering.settings import Caustics, RenderSettings, Sampler
from plenoptic.truth.channels import Truth

if TYPE_CHECKING:
    import distributed

    from plenoptic.scene.scene import Scene


def render(  # noqa: PLR0913
    scene: Scene,
    camera: PlenopticCamera,
    *,
    samples: int | None = None,
    time_limit: float | None = None,
    target_error: float | None = None,
    region: tuple[slice, slice] | None = None,
    seed: int = 0,
    replicates: int = 2,
    sampler: Sampler = Sampler.SOBOL,
    max_bounces: int = 8,
    caustics: Caustics = Caustics.INCLUDE,
    clamp: float | None = None,
    ghosts: Ghosts | None = None,
    truth: Truth = Truth.DEPTH,
    conditioning: int | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    checkpoint_interval: float = 30.0,
    threads: int | None = None,
    client: distributed.Client | None = None,
    tile_side: int | None = None,
    progress: bool = True,
) -> Exposure:
    """Render the raw image of a scene, with its standard error and its ground truth.

    The render ends with `samples`, after `time_limit` or at `target_error`, whichever comes first; at least one is
    required. Ctrl-C (or a notebook's interrupt) ends it, too; the unfinished exposure is returned, marked
    `interrupted`. A second Ctrl-C raises KeyboardInterrupt.

    Parameters
    ----------
    scene : Scene
    camera : PlenopticCamera
    samples : int, optional
        Paths per pixel. Powers of 2 times `replicates` use the sampling points best.
    time_limit : float, optional
        Wall time in seconds, including compilation on first use.
    target_error : float, optional
        Target of `Exposure.relative_error`, such as 0.02: the root mean square of the relative standard errors of lit
        pixels. A tile ends when its own lit pixels have reached the target, mostly after two or three steps. The errors
        of other pixels decide whether a pixel gets more samples, so that stopping does not bias the image. Needs at
        least 2 replicates and two pixels. If light is too rare for an error estimate (`Exposure.rare_light`), the
        render continues to `samples` or `time_limit`, with neither to 4096 samples.
    region : (slice, slice), optional
        Rows and columns of the sensor, such as ``np.s_[256:384, 192:320]``; the same bits as in the whole image.
    seed : int
        Seed of the random numbers, at least 0.
    replicates : int
        Independent scramblings of the sampling points among which the samples are divided. The standard error is
        estimated from their variance; it is None with fewer than 2. With fewer than 8, or with diffraction, blocks of
        8 x 8 pixels of the sensor share their estimates, and blocks cut by a `region` are rendered completely.
        Otherwise the error of dark pixels in a cut block is that of its rendered part. At equal error, 2 replicates
        take up to 1.4 times the time of one, 8 up to 2.8 times (docs/standard_error.md).
    sampler : Sampler
        ``Sampler.RANDOM`` makes all samples independent, for comparison.
    max_bounces : int
        Maximum number of scattering events of a path: reflections and refractions included; 0 shows only emission.
        Light that is scattered more often is missing.
    caustics : Caustics
        ``Caustics.EXCLUDE``: light that mirrors, polished glass or panes cast onto rough surfaces is left out. It is
        noisy, since paths sample it by chance only; the difference of the variances with and without it is its part of
        the noise.
    clamp : float, optional
        Maximum radiance of a path; brighter paths are scaled down. It reduces noise and removes light:
        `shot.stats.clamped` is the missing fraction. None: no clamping.
    ghosts : Ghosts, optional
        Adds the light that two surfaces of the lens reflect, and its error. It is rendered after the image, and takes
        no part in a target error, a time limit or a checkpoint. None: no ghosts, at no cost.
    truth : Truth
        Requested channels of the ground truth, such as ``Truth.DEPTH | Truth.NORMAL``; others are neither computed nor
        stored. See `GroundTruth`.
    conditioning : int, optional
        Number of paths, such as 1024 (at most 1048576), for which `shot.stats.conditioning` reports the amplification
        of rounding errors by each lens surface, and the Newton iterations of aspheres. See `Conditioning`.
    checkpoint : path-like, optional
        File to which the results of tiles are appended. Called again, the render resumes from there, also with more
        samples or a lower target, and gives the same bits as without interruption (a `time_limit` starts again). The
        sums of unfinished tiles are in the file, not in memory. Files of other renders are refused and left unchanged.
        Damaged records are rendered again, with a warning. On another kind of processor the render resumes with a
        warning, since bits depend on instructions: `shot.stats.processors` lists the kinds.
    checkpoint_interval : float
        Seconds between flushes of the file to the disk: the most that is lost if the machine crashes. If only the
        program is killed, the unfinished tiles are lost.
    threads : int, optional
        None: one for each processor, at most NUMBA_NUM_THREADS. The image does not depend on it, unless there is a
        time limit.
    client : distributed.Client, optional
        Client of a dask cluster (extra `cluster`), whose workers render the tiles; None: threads of this process. The
        bits are the same, unless there is a time limit, or processors are of other kinds, which causes a warning.
        Workers with other versions are refused, and the loss of workers is tolerated: see docs/how_to/cluster_dask.md.
    tile_side : int, optional
        Side of a tile in pixels; None: chosen from the number of samples. The image does not depend on it, unless there
        is a time limit or a target error, at which whole tiles end, by default of 64 x 64 pixels.
    progress : bool
        Whether to show a progress bar in terminals and notebooks, with the remaining time and the current error.

    Returns
    -------
    Exposure
        C = 1 if everything in the scene is grey, otherwise 3. If the sample numbers of pixels differ, they are in
        `sample_counts`; pixels without samples are 0 with an infinite standard error.

    Raises
    ------
    InvalidValueError
        If an argument is invalid; nothing is rendered then.
    FileError
        If the checkpoint belongs to another render, is no checkpoint, or cannot be written.

    Warns
    -----
    BlackImageWarning, UnseenSceneWarning, ImplausibleCameraWarning, ImplausibleSceneWarning, BudgetWarning
        Once each, with the cause, such as a light that faces away, or an implausible number of the camera. See
        `errors.PlenopticWarning`.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> camera = pl.camera.example_camera()
    >>> scene, region = pl.shapes.white_plane(), np.s_[250:260, 250:270]
    >>> pl.render(scene, camera, samples=16, region=region, progress=False).image.shape
    (10, 20, 1)
    """
    from plenoptic.rendering.plausible_scene import warn_if_scene_implausible
    from plenoptic.scene.scene import Scene

    if not isinstance(scene, Scene):
        hint = "; `render_white` needs none" if scene is None else ""
        raise InvalidValueError(f"scene is a {type(scene).__name__}; it must be a Scene{hint}")
    check_scene_and_camera(scene, camera)
    warn_if_implausible(camera)
    warn_if_scene_implausible(scene, camera)
    budget = checked_budget(samples, time_limit, target_error, replicates)
    settings = RenderSettings(max_bounces, caustics, clamp, sampler, ghosts)
    subject = Subject(scene, camera, budget.max_samples, budget.replicates, truth, settings)
    options = RenderOptions(
        region, seed, threads, tile_side, progress, conditioning, checkpoint, checkpoint_interval, client
    )
    if ghosts is None:
        return run(subject, budget, options)
    from plenoptic.camera.ghosts.ghost_camera import ghost_lens  # few images have ghosts
    from plenoptic.rendering.ghosts.ghosts_exposure import add_ghosts

    ghost_lens(camera, ghosts)  # raises errors before the image is rendered
    return add_ghosts(run(subject, budget, options), subject, options)


def render_white(  # noqa: PLR0913
    camera: PlenopticCamera,
    *,
    samples: int | None = None,
    time_limit: float | None = None,
    target_error: float | None = None,
    region: tuple[slice, slice] | None = None,
    seed: int = 0,
    replicates: int = 2,
    sampler: Sampler = Sampler.SOBOL,
    conditioning: int | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    checkpoint_interval: float = 30.0,
    threads: int | None = None,
    client: distributed.Client | None = None,
    tile_side: int | None = None,
    progress: bool = True,
) -> Exposure:
    """Render the white image: radiance 1 everywhere. Then `shot.image / white.image` is radiance.

    There is no scene: nothing is intersected or shaded. For suitable cameras (see `plan(None, camera)`), unvignetted
    light is added analytically, without tracing. A sample then takes about four times as long, and far fewer are
    needed. Statistics count only the traced paths, and differ from those of a scene with the same seed. For the latter
    render a `Scene` with nothing but `background=1.0`. Parameters are those of `render`.

    Returns
    -------
    Exposure
        C = 1, without ground truth. The value of a pixel is the projected solid angle from which light reaches it,
        averaged over its area.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> camera = pl.camera.example_camera()
    >>> white = pl.render_white(camera, samples=64, region=np.s_[256:257, 256:257], progress=False)
    >>> f"{white.image[0, 0, 0]:.4f}"
    '0.0140'
    """
    check_scene_and_camera(None, camera)
    warn_if_implausible(camera)
    budget, settings = checked_budget(samples, time_limit, target_error, replicates), RenderSettings(0, sampler=sampler)
    subject = Subject(None, camera, budget.max_samples, budget.replicates, Truth.NONE, settings)
    options = RenderOptions(
        region, seed, threads, tile_side, progress, conditioning, checkpoint, checkpoint_interval, client
    )
    return run(subject, budget, options)
