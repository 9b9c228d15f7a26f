"""What the simulator can be trusted with: studies that print a table. ``python -m plenoptic.study`` runs them."""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.rendering.exposure import Exposure
    from plenoptic.scene.scene import Scene
    from plenoptic.study.cost.costs import cost_of as cost_of
    from plenoptic.study.cost.table import CostRow as CostRow
    from plenoptic.study.cost.table import CostTable as CostTable
    from plenoptic.study.error_time.recommending import Recommendation as Recommendation
    from plenoptic.study.error_time.rows import ErrorRow as ErrorRow
    from plenoptic.study.error_time.table import ErrorTable as ErrorTable
    from plenoptic.study.error_time.variants import Variant as Variant
    from plenoptic.study.error_time.variants import default_variants as default_variants
    from plenoptic.study.rounding.table import StabilityTable

__all__ = [
    "CostRow",
    "CostTable",
    "ErrorRow",
    "ErrorTable",
    "Recommendation",
    "Variant",
    "cost_of",
    "default_variants",
    "error_against_time",
    "stability",
]

_HOMES = {
    "CostRow": "cost.table",
    "CostTable": "cost.table",
    "cost_of": "cost.costs",
    "ErrorRow": "error_time.rows",
    "ErrorTable": "error_time.table",
    "Recommendation": "error_time.recommending",
    "Variant": "error_time.variants",
    "default_variants": "error_time.variants",
}
"""Where names live that are loaded on first use."""

QUICK = 40
"""Rays of a case that show that all works."""

THOROUGH = 1000
"""Rays of a case, unless told otherwise."""


def error_against_time(
    scene: Scene | None,
    camera: PlenopticCamera,
    variants: Mapping[str, Variant] | None = None,
    *,
    samples: Sequence[int] = (16, 32, 64, 128, 256),
    region: tuple[slice, slice] | None = None,
    seeds: int = 8,
    seed: int = 0,
    repeats: int = 1,
    reference: Variant | Exposure | None = None,
    reference_samples: int | None = None,
    threads: int = 1,
    title: str | None = None,
    progress: bool = True,
) -> ErrorTable:
    """What an error costs: variants of a rendering, timed, and compared with a converged reference.

    Each variant is rendered with several numbers of samples and several seeds. What seeds differ by is variance; what
    their mean is off from the reference, beyond what noise explains, is bias. The reference's own squared error is
    known from its standard errors and subtracted. Errors are relative root mean squares over lit pixels: those above
    0.1 of the reference's 99th percentile, in the mean over the channels.

    Parameters
    ----------
    scene : Scene or None
        None: the white image.
    camera : PlenopticCamera
    variants : mapping of str to Variant, optional
        By their names; None: `default_variants`, of which the first is the camera as it is.
    samples : sequence of int, optional
        Paths per pixel, rising.
    region : (slice, slice), optional
        Rows and columns of the sensor; None: the central 64 x 64 pixels.
    seeds : int, optional
        Renderings of each row, at least 2.
    seed : int, optional
        The first seed.
    repeats : int, optional
        How often each rendering is timed; times are medians over seeds and repeats.
    reference : Variant or Exposure, optional
        How the reference is rendered; None: as ``Variant()``. Or one that has been rendered already, of the same
        region, with another seed and with standard errors.
    reference_samples : int, optional
        Paths per pixel of the reference; None: 16 times the largest number in `samples`.
    threads : int, optional
        Of the renderings that are timed.
    title : str, optional
        Of the table.
    progress : bool, optional
        Whether to show a progress bar.

    Returns
    -------
    ErrorTable
        `print` shows it; `plot()`, `recommend(target_error)`, `slope(variant)`, `bias_floor(variant)`, `pareto()`,
        `to_csv()`, `to_markdown()`.

    Raises
    ------
    InvalidValueError
        If an argument is impossible, or the reference is black or does not fit.

    Notes
    -----
    Setting up is timed by calls that render one path, once everything is compiled, and pupils and the scene's tree are
    known from a call before.
    Errors are relative to the reference, so that a poor one makes them too large, by some three times its own squared
    error, and biases that all pixels share by more. Its error should be below the smallest that is studied.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> camera = pl.PlenopticCamera(lens=pl.load_lens("double-gauss-100mm-f2"),
    ...     sensor=pl.Sensor(shape=(16, 16), pixel_pitch=1.0), stop_to_microlenses=130.0)
    >>> table = pl.study.error_against_time(None, camera, samples=(64, 256), seeds=3, progress=False)
    >>> table.variants
    ('EXACT lens', 'PARAXIAL lens', 'THIN lens', 'RANDOM sampler', '1 replicate')
    >>> table.bias_floor("EXACT lens"), table.bias_floor("PARAXIAL lens") > 0.02
    (0.0, True)
    >>> table.recommend(0.02).variant
    '1 replicate'
    """
    from plenoptic.study.error_time.study import study_of

    return study_of(
        scene,
        camera,
        variants,
        samples=samples,
        region=region,
        seeds=seeds,
        seed=seed,
        repeats=repeats,
        reference=reference,
        reference_samples=reference_samples,
        threads=threads,
        title=title,
        progress=progress,
    )


def stability(*, rays: int = THOROUGH, seed: int = 0, only: Sequence[str] | None = None) -> StabilityTable:
    """Rounding errors of ray tracing, against a trace with 50 digits and other formulas.

    The cases are ordinary lenses and what is hard for floating-point numbers: very large and very small radii, distant
    origins, grazing rays, tangents, total reflection, indices that are almost the same, strong aspheres, numbers that
    are not finite. Every ray is held to a bound of its own; see `plenoptic.study.rounding.bounds`.

    Parameters
    ----------
    rays : int, optional
        For each case. A thousand take about a minute, most of it with many digits.
    seed : int, optional
        Of the random rays.
    only : sequence of str, optional
        Beginnings of the names of the cases wanted.

    Returns
    -------
    StabilityTable
        `print` shows it; `to_markdown()`, and `rows` with the numbers.

    Raises
    ------
    PlenopticError
        If mpmath is not installed; an InvalidValueError if `rays` is below 1 or no case is left.

    Examples
    --------
    >>> import plenoptic as pl
    >>> table = pl.study.stability(rays=10, only=["radius 50"])
    >>> table.holds, [row.case for row in table.rows][:2]
    (True, ['radius 50', 'radius 50, in reverse'])
    """
    from plenoptic.study.rounding.table import stability_table

    return stability_table(rays=rays, seed=seed, only=only)


if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        if name not in _HOMES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        found = getattr(importlib.import_module(f"plenoptic.study.{_HOMES[name]}"), name)
        globals()[name] = found
        return found

    def __dir__() -> list[str]:
        return sorted({*globals(), *_HOMES})
