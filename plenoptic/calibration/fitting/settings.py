"""Focus settings of one camera: each has a distance from lens to array of its own, and shares all else.

The parameters of several settings are those of the first, then LENS_TO_ARRAY of each further one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.calibration.fitting.geometry import COUNT, Parameter
from plenoptic.core.values import Floats


def distance_columns(count: int) -> NDArray[np.int64]:
    """Columns of LENS_TO_ARRAY of each setting among a number of parameters."""
    return np.append(Parameter.LENS_TO_ARRAY.value, np.arange(COUNT, count))


def parameter_columns(setting: int, count: int) -> NDArray[np.int64]:
    """Columns (COUNT,) of the parameters of one setting among those of all."""
    columns = np.arange(COUNT)
    columns[Parameter.LENS_TO_ARRAY] = distance_columns(count)[setting]
    return columns


def project_settings(
    parameters: Floats, setting: NDArray[np.int64], project: Callable[[Floats, Any], tuple[Floats, ...]]
) -> tuple[Floats, ...]:
    """Projection of rows (n,) that are sorted by setting.

    `project` has the parameters (COUNT,) of a setting and its rows. It returns pixels, their derivatives by these
    parameters, which become derivatives by all, and other arrays of these rows.
    """
    count = len(parameters)
    if count == COUNT:
        return project(parameters, slice(None))
    parts = []
    for k in np.unique(setting).tolist():
        columns = parameter_columns(k, count)
        pixel, slope, *remaining = project(parameters[columns], setting == k)
        wide = np.zeros((*slope.shape[:2], count))
        wide[:, :, columns] = slope
        parts.append((pixel, wide, *remaining))
    return tuple(np.concatenate(arrays) for arrays in zip(*parts, strict=True))
