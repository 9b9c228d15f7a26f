"""Images that are laid over surfaces: colours, and other numbers that vary along them."""

from __future__ import annotations

import dataclasses
import enum
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.color.srgb import Encoding
from plenoptic.core.files.file_limits import DEFAULT, FileLimits
from plenoptic.core.files.images import read_linear
from plenoptic.core.values import Floats, Given, checked_field, choice, frozen_array, set_field, value
from plenoptic.errors import InvalidValueError, SceneError
from plenoptic.scene.textures.pillow_images import linear_texels

if TYPE_CHECKING:
    from PIL.Image import Image

MAX_TEXELS = 2**28
"""The most texels that a texture may have: 16384 x 16384; with three channels they take 3 GiB."""


class Wrap(enum.IntEnum):
    """Continuation of a texture beyond its border, along one of its axes.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> pl.Texture(np.ones((1, 2, 1)), wrap=(pl.materials.Wrap.REPEAT, pl.materials.Wrap.CLAMP)).wraps
    (<Wrap.REPEAT: 0>, <Wrap.CLAMP: 1>)
    """

    REPEAT = 0
    """The image again."""
    CLAMP = 1
    """The texels at the border."""
    MIRROR = 2
    """The image turned over, then the image again."""


class TextureFilter(enum.IntEnum):
    """Interpolation of a texture between the centres of its texels.

    Examples
    --------
    >>> import plenoptic as pl
    >>> list(pl.materials.TextureFilter)
    [<TextureFilter.NEAREST: 0>, <TextureFilter.BILINEAR: 1>]
    """

    NEAREST = 0
    """Squares of constant value."""
    BILINEAR = 1
    """Interpolated between the four nearest centres."""


@value
class Texture:
    """A linear image that is laid over a mesh by the mesh's `uv` coordinates.

    (u, v) = (0, 0) is the lower left corner of the image and (1, 1) its upper right corner, as in OBJ files:
    v points up while rows count downwards. Texel (row, column) has its centre at ((column + 1/2) / columns,
    1 - (row + 1/2) / rows). Beyond [0, 1] it goes on as `wrap` says.

    There is no pyramid of coarser images: a path sees the texture at a point, and its average over pixel,
    microlens and aperture is the filter. That is free of bias, and its noise is part of the standard error.

    Parameters
    ----------
    texels : (rows, columns, 1 or 3) array of float32
        Linear, 0 or more; row 0 is the top of the image. Copied, then read-only. At most 2^28 rows x columns.
    wrap : Wrap or (Wrap, Wrap)
        Continuation beyond the border; a pair is for (u, v).
    filter : TextureFilter
        Interpolation between the centres of texels.

    Raises
    ------
    InvalidValueError
        Of another shape, integers, or no such wrap or filter.
    SceneError
        Empty, too large, negative or not finite.

    References
    ----------
    The OpenGL Graphics System, version 4.6, sections 8.14.2 and 8.14.3 (REPEAT, CLAMP_TO_EDGE, MIRRORED_REPEAT).

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> chequer = pl.Texture(np.array([[[0.1], [0.9]], [[0.9], [0.1]]]))
    >>> chequer.texels.shape
    (2, 2, 1)
    >>> pl.Lambertian(chequer)
    Lambertian(albedo=Texture(texels=<2 x 2 x 1 float32>))
    """

    texels: Given[NDArray[np.float32], ArrayLike]
    _: dataclasses.KW_ONLY
    wrap: Wrap | tuple[Wrap, Wrap] = Wrap.REPEAT
    filter: TextureFilter = checked_field(choice, kind=TextureFilter, default=TextureFilter.BILINEAR)

    def __post_init__(self) -> None:
        codes = "Texture.from_image for image codes"
        set_field(self, "texels", as_texels(self.texels, Texture, most=MAX_TEXELS, from_codes=codes))
        set_field(self, "wrap", _one_or_two(self.wrap))

    @property
    def wraps(self) -> tuple[Wrap, Wrap]:
        """Continuation beyond the border along u and along v; see `Wrap`."""
        return self.wrap if isinstance(self.wrap, tuple) else (self.wrap, self.wrap)

    @property
    def is_grey(self) -> bool:
        """True if all its channels are equal.

        Examples
        --------
        >>> import numpy as np, plenoptic as pl
        >>> pl.Texture(np.ones((4, 4, 3))).is_grey
        True
        """
        return equal_channels(self.texels)

    def halved(self) -> Texture:
        """The texture with half as many rows and columns, rounded down but at least one; wrap and filter stay.

        Each new texel is the mean of the old ones over its area: of 2 x 2 where sizes are even, of 3 with
        weights along an odd size. So the mean of all texels stays.

        Examples
        --------
        >>> import numpy as np, plenoptic as pl
        >>> pl.Texture(np.arange(8.0).reshape(2, 4, 1)).halved().texels[..., 0].tolist()
        [[2.5, 4.5]]
        """
        fewer_rows = _halved_rows(self.texels)
        texels = _halved_rows(fewer_rows.transpose(1, 0, 2)).transpose(1, 0, 2)
        return dataclasses.replace(self, texels=texels.astype(np.float32))

    @classmethod
    def load(
        cls,
        path: str | PathLike[str],
        *,
        encoding: Encoding = Encoding.SRGB,
        channel: int | None = None,
        wrap: Wrap | tuple[Wrap, Wrap] = Wrap.REPEAT,
        filter: TextureFilter = TextureFilter.BILINEAR,
        limits: FileLimits = DEFAULT,
    ) -> Texture:
        """Read a texture from an image file.

        Parameters
        ----------
        path : str or path
            An image: PNG, TIFF or JPEG with codes of 8 or 16 bits, EXR, HDR, or another format that OpenImageIO reads.
        encoding : Encoding
            Encoding of codes: SRGB for colours, LINEAR for normals, roughness and other data. Floats are linear. It
            counts whatever the file states (a PNG's gAMA, an ICC profile), as for all textures of scene files.
        channel : int, optional
            One channel alone: 0, 1, 2 for red, green, blue (of a grey image, its grey), 3 for opacity, which is
            never sRGB, and 1 where the image has none. By default all but opacity.
        wrap, filter
            As in `Texture`.
        limits : FileLimits
            The size of the file, and of the image.

        Raises
        ------
        FileError
            Missing, not an image, or of more than 2^28 pixels.
        InvalidValueError
            No such encoding, channel, wrap or filter.
        SceneError
            An image of floats that are negative or not finite.

        Examples
        --------
        >>> import plenoptic as pl
        >>> pl.Texture.load("bark.png")  # doctest: +SKIP
        Texture(texels=<512 x 512 x 3 float32>)
        """
        texels = read_linear(path, encoding=encoding, channel=channel, max_pixels=MAX_TEXELS, limits=limits)
        return cls(texels, wrap=wrap, filter=filter)

    @classmethod
    def from_image(
        cls,
        image: Image,
        *,
        encoding: Encoding = Encoding.SRGB,
        channel: int | None = None,
        wrap: Wrap | tuple[Wrap, Wrap] = Wrap.REPEAT,
        filter: TextureFilter = TextureFilter.BILINEAR,
    ) -> Texture:
        """Make a texture of a Pillow image.

        Parameters
        ----------
        image : PIL.Image.Image
            Of any mode; grey stays one channel. Codes of 8 and 16 bits are decoded, floats are linear.
        encoding, channel, wrap, filter
            As in `load`.

        Raises
        ------
        InvalidValueError
            Not a Pillow image, or no such encoding, channel, wrap or filter.
        FileError
            The image was opened lazily and its file is damaged.
        SceneError
            More than 2^28 pixels, or floats that are negative or not finite.

        References
        ----------
        IEC 61966-2-1:1999, section 5.2: sRGB.

        Examples
        --------
        >>> import PIL.Image, plenoptic as pl
        >>> image = PIL.Image.new("RGB", (8, 4), (255, 188, 0))
        >>> texture = pl.Texture.from_image(image)
        >>> texture.texels.shape, texture.texels[0, 0].round(2).tolist()
        ((4, 8, 3), [1.0, 0.5, 0.0])
        """
        from PIL.Image import Image

        if not isinstance(image, Image):
            raise InvalidValueError(f"image is {type(image).__name__}; it must be a Pillow image")
        check_size((image.height, image.width), "the image", MAX_TEXELS)
        return cls(linear_texels(image, encoding=encoding, channel=channel), wrap=wrap, filter=filter)


def as_texels(texels: ArrayLike, owner: type, *, most: int, from_codes: str) -> NDArray[np.float32]:
    """(rows, columns, 1 or 3), read-only, finite and 0 or more; for codes of image files see `from_codes`."""
    if isinstance(texels, str | PathLike):
        raise InvalidValueError(f"texels are {texels!r}; use {owner.__name__}.load for files")
    if isinstance(texels, np.ndarray):
        if texels.dtype.kind in "iub":
            raise InvalidValueError(f"texels are {texels.dtype}; they must be linear floats, or use {from_codes}")
        check_size(texels.shape, "texels", most)  # before they are copied
    with np.errstate(over="ignore"):
        checked = frozen_array(texels, name="texels", shape=("rows", "columns", "channels"), dtype=np.float32)
    if checked.shape[2] not in (1, 3):
        raise InvalidValueError(f"texels has {checked.shape[2]} channels; it must have 1 or 3 (drop alpha)")
    check_size(checked.shape, "texels", most)
    # min and max hand NaN on, so two passes without temporaries see everything.
    low, high = float(checked.min()), float(checked.max())
    if not (low >= 0 and high < np.inf):
        raise SceneError(f"texels lie between {low:g} and {high:g}; they must be finite and 0 or more, so clip them")
    return checked


def check_size(shape: tuple[int, ...], name: str, most: int) -> None:
    """Refuse an image without texels or with too many."""
    if len(shape) >= 2 and not 0 < shape[0] * shape[1] <= most:
        raise SceneError(
            f"{name} has {shape[0]} x {shape[1]} texels; it must have at least 1 row and 1 column of them, and at most "
            f"{most}, so scale it down"
        )


def equal_channels(texels: NDArray[Any]) -> bool:
    """True if all channels of an image are equal."""
    first = texels[..., 0]
    return all(np.array_equal(first, texels[..., k]) for k in range(1, texels.shape[2]))


def _one_or_two(wrap: Any) -> Wrap | tuple[Wrap, Wrap]:
    """One wrap where both axes have the same, so that equal textures compare equal."""
    if not isinstance(wrap, tuple | list):
        return choice(wrap, Wrap, "wrap")
    if len(wrap) != 2:
        raise InvalidValueError(f"wrap has {len(wrap)} entries; it must be one Wrap, or a pair for (u, v)")
    along_u, along_v = (choice(item, Wrap, "wrap") for item in wrap)
    return along_u if along_u is along_v else (along_u, along_v)


def _halved_rows(texels: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
    """Means over pairs of rows; where their number is odd, 2 m + 1, each new one covers (2 m + 1) / m old ones.

    New row k then reaches from k (2 m + 1) / m = 2 k + k / m to 2 k + 2 + (k + 1) / m, counted in old rows.
    """
    rows = len(texels)
    m = rows // 2
    if m == 0:
        return texels
    first, second = texels[0 : 2 * m : 2], texels[1 : 2 * m : 2]
    if rows % 2 == 0:
        return 0.5 * first.astype(np.float64) + 0.5 * second
    k = np.arange(m, dtype=np.float64)[:, None, None]
    inside: Floats = (m - k) * first + m * second.astype(np.float64) + (k + 1) * texels[2::2]
    return inside / rows
