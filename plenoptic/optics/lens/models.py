"""Models of the main lens, and criteria of focus."""

from __future__ import annotations

import enum


class LensModel(enum.IntEnum):
    """Model of the main lens; `LensStack.with_model` chooses it.

    - NONE: the stops alone, without glass.
    - THIN: one plane with the lens's focal length, in its rear principal point, with the iris in it as large as the
      entrance pupil: the same f-number. Both principal planes are one, so that the scene seems farther away or nearer
      by their distance.
    - PARAXIAL: an ideal thick lens: rays meet the front principal plane, leave from the rear one at the same height,
      and pass the paraxial exit pupil. No aberrations, no vignetting by rims or further stops, nothing out of place.
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

    PARAXIAL: where rays close to the axis meet. RMS_SPOT: the least root mean square distance of all rays from their
    centroid. GEOMETRIC_SPOT: the least largest distance, the circle of least confusion.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.FocusCriterion.RMS_SPOT.name
    'RMS_SPOT'
    """

    PARAXIAL = 0
    RMS_SPOT = 1
    GEOMETRIC_SPOT = 2
