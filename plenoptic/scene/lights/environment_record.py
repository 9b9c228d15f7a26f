"""An environment as arrays of numbers, and the distribution by which directions of it are drawn."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.scene.lights.environment import EnvironmentMap


class EnvironmentTables(NamedTuple):
    """What kernels read of an environment of H x W texels. All arrays are C-contiguous and read-only.

    A texel is drawn with a probability proportional to its mean radiance over the channels times its solid angle: first
    its row, then its column, then a direction in it, uniform in solid angle.

    Examples
    --------
    >>> import numpy as np
    >>> import plenoptic as pl
    >>> tables = build_environment(pl.EnvironmentMap(np.array([[[3.0]], [[1.0]]])), channels=1)
    >>> tables.rows_cdf.tolist(), (tables.density * 2 * np.pi).round(12).tolist()
    ([0.75, 1.0], [[0.75], [0.25]])
    """

    texels: NDArray[np.float32]
    """(H, W, C): radiance."""
    rows_cdf: NDArray[np.float64]
    """(H,): cumulative probability of the rows; the last is exactly 1."""
    columns_cdf: NDArray[np.float64]
    """(H, W): that of the columns of each row, the last exactly 1; zeros in black rows."""
    density: NDArray[np.float64]
    """(H, W), 1/sr: probability per solid angle, the same all over a texel; 0 where the map is black."""
    rotation: NDArray[np.float64] | None
    """(9,): the map's rotation, row by row. None where it has the axes of the world."""
    total: float
    """Radiance, the mean of its channels, integrated over all directions."""


def build_environment(environment: EnvironmentMap, channels: int) -> EnvironmentTables | None:
    """Compile an environment map; None where it is black, so that there is nothing to see or draw.

    Parameters
    ----------
    environment : EnvironmentMap
    channels : int
        1 or 3: those of the scene; 1 only for maps whose channels are equal.

    Examples
    --------
    >>> import numpy as np
    >>> import plenoptic as pl
    >>> build_environment(pl.EnvironmentMap(np.zeros((2, 4, 1))), channels=1) is None
    True
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
    density = weight
    density[:, 0] = columns_cdf[:, 0]
    np.subtract(columns_cdf[:, 1:], columns_cdf[:, :-1], out=density[:, 1:])
    density *= (np.diff(rows_cdf, prepend=0.0) / solid_angle)[:, None]
    texels = environment.texels
    if texels.shape[2] != channels:
        texels = texels[..., :1] if channels == 1 else np.repeat(texels, channels, axis=2)
    turned = None if environment.rotation is None else _frozen(environment.rotation.reshape(9))
    return EnvironmentTables(_frozen(texels), _frozen(rows_cdf), _frozen(columns_cdf), _frozen(density), turned, total)


def texel_solid_angles(rows: int, columns: int) -> NDArray[np.float64]:
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
