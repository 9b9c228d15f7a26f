"""Environment of a scene, seen by rays that hit no surface."""

from __future__ import annotations

import dataclasses
from os import PathLike
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.files.file_limits import DEFAULT, FileLimits
from plenoptic.core.files.images import read_linear
from plenoptic.core.motions.rotation import rotation_about, rotation_matrix
from plenoptic.core.values import Floats, Given, checked_field, frozen_array, set_field, value
from plenoptic.errors import FileError, SceneError
from plenoptic.scene.geometry import moves
from plenoptic.scene.textures.color import Colour, as_colour
from plenoptic.scene.textures.texture import as_texels, equal_channels

MAX_TEXELS = 2**27
"""The most texels that an environment may have: 16384 columns x 8192 rows; in colour its tables then take 3.5 GiB."""


@value
class ConstantBackground:
    """A world of the same radiance in every direction.

    Parameters
    ----------
    radiance : float or (float, float, float)
        Radiance of the world in scene units, 0 or more: one number, or (red, green, blue).

    Raises
    ------
    InvalidValueError
        Not a number or three of them, or not finite.
    SceneError
        Negative.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.Scene(background=pl.lights.ConstantBackground((0.2, 0.3, 0.5)))
    Scene(no meshes, background (0.2, 0.3, 0.5))
    """

    radiance: Colour = checked_field(as_colour, default=1.0)


@value
class EnvironmentMap:
    """A world at infinity whose radiance is an equirectangular image: 360 degrees wide, 180 degrees high.

    Row 0 is straight up (+y), the last row straight down. The middle of the image lies straight ahead of a camera
    without pose (-z), columns to the right of it towards its right (+x), and the left and right border behind it (+z).
    Texel (row, column) of H x W covers the polar angles from +y between pi row / H and pi (row + 1) / H, and the
    azimuths from -z towards +x between 2 pi column / W - pi and 2 pi (column + 1) / W - pi.

    Radiance is constant in each texel, not interpolated. So directions are drawn by exactly the distribution of
    the light, and texels as large as a pixel of the camera are seen as such.

    Parameters
    ----------
    texels : (rows, columns, 1 or 3) array of float32
        Radiance in scene units, linear, 0 or more. Copied, then read-only. At most 2^27 rows x columns.
    rotation : (3, 3) array or None
        From the image's axes to the world's: world = rotation @ direction. The identity becomes None.

    Raises
    ------
    InvalidValueError
        Of another shape, integers, or a rotation that scales or mirrors.
    SceneError
        Empty, too large, negative or not finite.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> sky = pl.EnvironmentMap(np.array([[[0.3, 0.5, 1.0]], [[0.1, 0.1, 0.1]]]))       # above, and below the horizon
    >>> sky
    EnvironmentMap(texels=<2 x 1 x 3 float32>)
    >>> sky.radiance([[0, 1, 0], [0, -1, -1]]).round(6).tolist()
    [[0.3, 0.5, 1.0], [0.1, 0.1, 0.1]]
    """

    texels: Given[NDArray[np.float32], ArrayLike]
    rotation: Given[Floats | None, ArrayLike | None] = Given(default=None)

    def __post_init__(self) -> None:
        codes = "EnvironmentMap.load for image files"
        set_field(self, "texels", as_texels(self.texels, EnvironmentMap, most=MAX_TEXELS, from_codes=codes))
        if self.rotation is not None:
            remedy = "turn the environment by rotated(axis, angle), mirror its texels by texels[:, ::-1]"
            matrix = rotation_matrix(self.rotation, remedy=remedy)
            set_field(self, "rotation", None if np.array_equal(matrix, np.eye(3)) else matrix)

    @classmethod
    def load(
        cls, path: str | PathLike[str], rotation: ArrayLike | None = None, *, limits: FileLimits = DEFAULT
    ) -> EnvironmentMap:
        """Read an environment from an image file.

        Parameters
        ----------
        path : str or path
            An equirectangular image (HDR, EXR, ...). Floats are linear, codes of 8 and 16 bits sRGB, alpha is dropped.
        rotation : (3, 3) array, optional
            As in `EnvironmentMap`.
        limits : FileLimits
            The size of the file, and of the image.

        Raises
        ------
        FileError
            Missing, not an image, larger than 2^27 pixels, or with values that are negative or not finite.
        InvalidValueError
            A rotation that scales or mirrors.

        Examples
        --------
        >>> import plenoptic as pl
        >>> pl.EnvironmentMap.load("workshop_2k.hdr")  # doctest: +SKIP
        EnvironmentMap(texels=<1024 x 2048 x 3 float32>)
        """
        try:
            return cls(read_linear(path, max_pixels=MAX_TEXELS, limits=limits), rotation)
        except SceneError as error:
            raise FileError(f"{path}: {error}: EnvironmentMap(np.clip(pl.read_linear(path), ...))") from error

    @property
    def is_grey(self) -> bool:
        """True if all its channels are equal, as `Texture.is_grey`."""
        return equal_channels(self.texels)

    def rotated(self, axis: ArrayLike, angle: float) -> EnvironmentMap:
        """The environment turned about an axis of the world, further than it is already.

        Parameters
        ----------
        axis : (3,) array
            Direction of the axis, of any length above 0. A turn about +y moves the part ahead (-z) to the left (-x).
        angle : float
            Radians, counter-clockwise as seen by one whom the axis points at.

        Raises
        ------
        InvalidValueError
            An axis without length, an angle that is not finite.

        Examples
        --------
        >>> import math
        >>> import numpy as np, plenoptic as pl
        >>> world = pl.EnvironmentMap(np.array([[[0.0], [1.0], [2.0], [3.0]]])).rotated((0, 1, 0), math.pi / 4)
        >>> world.radiance([[0, 0, -1], [-1, 0, 0], [0, 0, 1], [1, 0, 0]]).tolist()
        [[2.0], [1.0], [0.0], [3.0]]
        """
        matrix = rotation_about(axis, angle)
        return dataclasses.replace(self, rotation=matrix if self.rotation is None else matrix @ self.rotation)

    rotated_deg = moves.rotated_deg

    def moved(self, matrix: Floats, scale: float) -> EnvironmentMap:
        """The environment turned by a (4, 4) similarity of that scale."""
        # Rotations must be orthonormal to rounding, which a scaled one need not be.
        u, _, v = np.linalg.svd(matrix[:3, :3] / scale)
        turned = u @ v
        return dataclasses.replace(self, rotation=turned if self.rotation is None else turned @ self.rotation)

    def radiance(self, directions: ArrayLike) -> Floats:
        """Radiance that comes from directions, (n, 1 or 3).

        Parameters
        ----------
        directions : (n, 3) array
            In the world, from the scene outwards, of any length above 0.

        Raises
        ------
        InvalidValueError
            Of another shape.
        SceneError
            A direction that is not finite or has no length.

        Examples
        --------
        >>> import numpy as np, plenoptic as pl
        >>> left_and_right = pl.EnvironmentMap(np.array([[[1.0], [2.0]]]))
        >>> left_and_right.radiance([[-1, 0, 0], [1, 0, 0]]).tolist()
        [[1.0], [2.0]]
        """
        vectors = frozen_array(directions, name="directions", shape=("n", 3))
        if not (np.isfinite(vectors).all() and vectors.any(axis=1).all()):
            raise SceneError("directions holds one that is not finite or has no length; leave it out")
        scaled = vectors / np.abs(vectors).max(axis=1, keepdims=True)
        x, y, z = (scaled if self.rotation is None else scaled @ self.rotation).T
        rows, columns = self.texels.shape[:2]
        row = np.arctan2(np.hypot(x, z), y) / np.pi * rows
        column = (np.arctan2(x, -z) / (2 * np.pi) + 0.5) * columns
        chosen = self.texels[np.minimum(row.astype(int), rows - 1), np.minimum(column.astype(int), columns - 1)]
        return np.asarray(chosen, dtype=np.float64)


Background: TypeAlias = ConstantBackground | EnvironmentMap
