"""Rendering: what users call."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.checks import check_scene_and_camera
from plenoptic.camera.plausibility import warn_where_implausible
from plenoptic.errors import InvalidValueError
from plenoptic.rendering.exposure import Exposure
from plenoptic.rendering.plan.stages import Subject
from plenoptic.rendering.schedule.budget import checked_budget
from plenoptic.rendering.schedule.scheduler import RenderOptions, run
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

    It ends with `samples`, after `time_limit` or at `target_error`, whichever comes first; at least one is needed.
    Ctrl-C (or a notebook's interrupt) ends it too once it has begun, and what is there is returned, marked
    `interrupted`; a second one raises KeyboardInterrupt.

    Parameters
    ----------
    scene : Scene
    camera : PlenopticCamera
    samples : int, optional
        Paths per pixel. Powers of 2 times `replicates` use the sampling points best.
    time_limit : float, optional
        Seconds from the call on. What is compiled for the first time takes its time too.
    target_error : float, optional
        Wanted `Exposure.relative_error`, such as 0.02: the root mean square of the relative standard errors of lit
        pixels. Tiles end when their own lit pixels are as good, mostly after two or three steps; which
        pixels go on is decided by the errors of others, so that stopping does not bias the image. Needs at least 2
        replicates and two pixels. Where light is too rare to know the error (`Exposure.rare_light`), the render goes
        on to `samples` or `time_limit`, with neither to 4096 samples.
    region : (slice, slice), optional
        Rows and columns of the sensor, such as ``np.s_[256:384, 192:320]``; the same bits as in the whole image.
    seed : int
        Of the random numbers, at least 0.
    replicates : int
        Independent scramblings of the sampling points among which the samples are divided; the standard
        error comes from their spread, with fewer than 8 pooled over 8 x 8 pixels (those of the sensor, so that the
        rest of a block that a `region` cuts is rendered too), and is None with fewer than 2. With 8 and more, the error
        of dark pixels in a block that is cut is that of the part of it that is rendered. At equal error 2
        replicates cost up to 1.4 times the time of one, 8 up to 2.8 times (docs/standard_error.md).
    sampler : Sampler
        ``Sampler.RANDOM`` makes all samples independent, to compare with.
    max_bounces : int
        How often a path may be scattered, reflected or refracted; 0 shows only what emits. Light that is scattered more
        often is missing.
    caustics : Caustics
        ``Caustics.EXCLUDE``: light that mirrors, polished glass or panes throw onto rough surfaces does not count. It
        is noisy, since paths find it by chance only; the difference of the variances with and without it is its share
        of the noise.
    clamp : float, optional
        Paths that bring more radiance than this are scaled down to it. It takes away noise and light:
        `shot.stats.clamped` is the share that is missing. None: nothing is taken away.
    truth : Truth
        What of the ground truth of every pixel is found too, such as ``Truth.DEPTH | Truth.NORMAL``; what is not asked
        for is neither computed nor kept. See `GroundTruth`.
    conditioning : int, optional
        Of how many paths, such as 1024 (at most 1048576), `shot.stats.conditioning` tells how much each surface of the
        lens magnifies rounding errors, and how many steps aspheres took. See `Conditioning`.
    checkpoint : path-like, optional
        A file to which is added what tiles bring. Called again, the render goes on from there, also with more samples
        or a lower target, and gives the same bits as without a break (with a `time_limit` it goes on for that long
        again). Sums of tiles that go on are in the file and not in memory. Files of other renders are refused and stay
        as they are; what is damaged in one is rendered again, with a warning. On another kind of processor it goes on
        too, with a warning, since bits depend on instructions: `shot.stats.processors` names the kinds.
    checkpoint_interval : float
        Seconds between two times that the file is flushed to the disk: what is lost at most when the machine goes down.
        Where only the program is killed the tiles in work are lost.
    threads : int, optional
        None: one for each processor, at most NUMBA_NUM_THREADS. The image does not depend on it, unless there is a
        time limit.
    client : distributed.Client, optional
        Of a dask cluster (extra `cluster`), on whose workers tiles are rendered; None: on threads of this process. The
        bits are the same, unless there is a time limit or processors are of other kinds, of which there is a warning.
        Workers with other versions are refused, and lost ones survived: see docs/how_to/cluster_dask.md.
    tile_side : int, optional
        Pixels along a tile; None: chosen by the number of samples. The image does not depend on it, unless there is a
        time limit or a target error: what ends is a tile, of 64 x 64 pixels if not told otherwise.
    progress : bool
        Whether to show a progress bar, with the time left and the error reached.

    Returns
    -------
    Exposure
        C = 1 where everything in the scene is grey, otherwise 3. Where pixels ended with different numbers of samples
        these are in `sample_counts`; pixels that had none are 0 with an infinite standard error.

    Raises
    ------
    InvalidValueError
        Where an argument is impossible; nothing has been rendered then.
    FileError
        Where the checkpoint is that of another render, is none, or cannot be written.

    Warns
    -----
    BlackImageWarning, UnseenSceneWarning, ImplausibleCameraWarning, BudgetWarning
        Once each, with the cause: which light faces away, or which number of the camera is hardly what was meant. See
        `errors.PlenopticWarning`.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> camera = pl.PlenopticCamera(lens=pl.load_lens("double-gauss-100mm-f2"),
    ...     microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)),
    ...     sensor=pl.Sensor(shape=(512, 512), pixel_pitch=0.01),
    ...     stop_to_microlenses=123.3, microlenses_to_sensor=1.7)
    >>> scene, region = pl.shapes.white_plane(), np.s_[250:260, 250:270]
    >>> pl.render(scene, camera, samples=16, region=region, progress=False).image.shape
    (10, 20, 1)
    """
    from plenoptic.scene.scene import Scene

    if not isinstance(scene, Scene):
        hint = "; `render_white` needs none" if scene is None else ""
        raise InvalidValueError(f"scene is a {type(scene).__name__}; it must be a Scene{hint}")
    check_scene_and_camera(scene, camera)
    warn_where_implausible(camera)
    budget = checked_budget(samples, time_limit, target_error, replicates)
    settings = RenderSettings(max_bounces, caustics, clamp, sampler)
    subject = Subject(scene, camera, budget.max_samples, budget.replicates, truth, settings)
    work = RenderOptions(
        region, seed, threads, tile_side, progress, conditioning, checkpoint, checkpoint_interval, client
    )
    return run(subject, budget, work)


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
    """Render the image of a scene of radiance 1 everywhere; `shot.image / white.image` is then radiance.

    There is no scene: nothing is intersected or shaded, and where it pays (`plan(None, camera)` says so), light that
    surely passes the lens is added without being traced: a sample takes some four times as long as another, and as few
    are needed. Statistics are those of the paths that are traced. They are not those of a scene with the same seed; a
    `Scene` of nothing but `background=1.0` has these. Parameters are those of `render`.

    Returns
    -------
    Exposure
        C = 1, without ground truth. The value of a pixel is the projected solid angle from which light reaches
        it, averaged over its area.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=5.0))
    >>> camera = pl.PlenopticCamera(lens=lens,
    ...     microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)),
    ...     sensor=pl.Sensor(shape=(512, 512), pixel_pitch=0.01),
    ...     stop_to_microlenses=123.3, microlenses_to_sensor=1.7)
    >>> white = pl.render_white(camera, samples=64, region=np.s_[256:257, 256:257], progress=False)
    >>> f"{white.image[0, 0, 0]:.4f}"
    '0.0140'
    """
    check_scene_and_camera(None, camera)
    warn_where_implausible(camera)
    budget, settings = checked_budget(samples, time_limit, target_error, replicates), RenderSettings(0, sampler=sampler)
    subject = Subject(None, camera, budget.max_samples, budget.replicates, Truth.NONE, settings)
    work = RenderOptions(
        region, seed, threads, tile_side, progress, conditioning, checkpoint, checkpoint_interval, client
    )
    return run(subject, budget, work)
