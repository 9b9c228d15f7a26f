"""Models of the main lens, and criteria of focus."""

from __future__ import annotations

import enum


class LensModel(enum.IntEnum):
    """Model of the main lens; `LensStack.with_model` chooses it.

    - NONE: the stops alone, without glass.
    - THIN: one plane with the lens's focal lengths, in its rear principal point. It has the iris in it with the size of
      the entrance pupil, hence the same f-number. Both principal planes coincide, which shifts the scene by their
      distance.
    - PARAXIAL: an ideal thick lens. Rays enter at the front principal plane, leave from the rear one at the same
      height, and pass the paraxial exit pupil. No aberrations, no vignetting by rims or further stops, no decentres or
      tilts.
    - EXACT: every surface and stop.

    Gaussian optics, Seidel sums, `check` and `layout` describe the prescription, whatever the model.

    Examples
    --------
    >>> import plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2").with_model(pl.LensModel.PARAXIAL)
    >>> lens.model.name
    'PARAXIAL'
    """

    NONE = 0
    THIN = 1
    PARAXIAL = 2
    EXACT = 3


class FocusCriterion(enum.IntEnum):
    """Criterion of best focus.

    PARAXIAL: the paraxial focus. RMS_SPOT: minimum of the root mean square distance of all rays from their centroid.
    GEOMETRIC_SPOT: minimum of the largest distance, the circle of least confusion.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.FocusCriterion.RMS_SPOT.name
    'RMS_SPOT'
    """

    PARAXIAL = 0
    RMS_SPOT = 1
    GEOMETRIC_SPOT = 2
