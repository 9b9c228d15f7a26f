"""An environment as arrays of numbers, and the distribution by which directions of it are drawn."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats
from plenoptic.scene.lights.environment import EnvironmentMap
from plenoptic.scene.lights.record import Environment


def environment_record(environment: EnvironmentMap, channels: int) -> Environment | None:
    """Compile an environment map; None where it is black, so that there is nothing to see or draw.

    Parameters
    ----------
    environment : EnvironmentMap
    channels : int
        1 or 3: those of the scene; 1 only for maps whose channels are equal.

    Returns
    -------
    Environment or None
        Drawn with a probability of 0; `lights_record` knows better.

    Examples
    --------
    >>> import numpy as np
    >>> import plenoptic as pl
    >>> environment_record(pl.EnvironmentMap(np.zeros((2, 4, 1))), channels=1) is None
    True
    >>> record = environment_record(pl.EnvironmentMap(np.array([[[3.0]], [[1.0]]])), channels=1)
    >>> record.rows_cdf.tolist(), (record.pdf * 2 * np.pi).round(12).tolist()
    ([0.75, 1.0], [[0.75], [0.25]])
    """
    if not environment.texels.any():
        return None
    rows, columns, _ = environment.texels.shape
    solid_angle = texel_solid_angles(rows, columns)
    # Weights in their final place: large maps have few copies of themselves.
    weight = environment.texels.mean(axis=2, dtype=np.float64)
    columns_cdf = np.cumsum(weight, axis=1)
    row_weight = columns_cdf[:, -1] * solid_angle
    lit = row_weight > 0
    np.divide(columns_cdf, columns_cdf[:, -1:].copy(), out=columns_cdf, where=lit[:, None])
    rows_cdf = np.cumsum(row_weight)
    total = float(rows_cdf[-1])
    rows_cdf /= total
    # What is drawn are the steps of the cumulative sums, roundings included.
    pdf = weight
    pdf[:, 0] = columns_cdf[:, 0]
    np.subtract(columns_cdf[:, 1:], columns_cdf[:, :-1], out=pdf[:, 1:])
    pdf *= (np.diff(rows_cdf, prepend=0.0) / solid_angle)[:, None]
    texels = environment.texels
    if texels.shape[2] != channels:
        texels = texels[..., :1] if channels == 1 else np.repeat(texels, channels, axis=2)
    turned = None if environment.rotation is None else _frozen(environment.rotation.reshape(9))
    return Environment(_frozen(texels), _frozen(rows_cdf), _frozen(columns_cdf), _frozen(pdf), turned, 0.0, total)


def texel_solid_angles(rows: int, columns: int) -> Floats:
    """(rows,), sr: solid angle of one texel in each row of an equirectangular image; together they make up 4 pi.

    2 pi / columns times the difference of the cosines of its upper and lower polar angle, as a product.

    Examples
    --------
    >>> import numpy as np
    >>> (texel_solid_angles(2, 4) / np.pi).round(12).tolist()
    [0.5, 0.5]
    """
    middles = np.pi * (np.arange(rows) + 0.5) / rows
    return np.asarray(4 * np.pi / columns * np.sin(0.5 * np.pi / rows) * np.sin(middles))


def _frozen(array: NDArray[Any]) -> NDArray[Any]:
    array = np.ascontiguousarray(array).view()
    array.flags.writeable = False
    return array
