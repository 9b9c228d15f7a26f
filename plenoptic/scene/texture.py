"""Images that colour a surface."""

from __future__ import annotations

from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic._values import frozen_array, set_field, value
from plenoptic.errors import FileError, InvalidValueError, SceneError

if TYPE_CHECKING:
    from PIL.Image import Image


@value
class Texture:
    """A linear image that is laid over a mesh by the mesh's `uv` coordinates.

    (u, v) = (0, 0) is the lower left corner of the image and (1, 1) its upper right corner, as in OBJ files:
    v points up while rows count downwards. Beyond [0, 1] the image repeats.

    Parameters
    ----------
    texels : (rows, columns, 1 or 3) array of float32
        Linear, 0 or more; row 0 is the top of the image. Copied, then read-only.

    Raises
    ------
    InvalidValueError
        Of another shape, or integers.
    SceneError
        Empty, negative or not finite.

    Examples
    --------
    >>> import numpy as np
    >>> import plenoptic as pl
    >>> chequer = pl.Texture(np.array([[[0.1], [0.9]], [[0.9], [0.1]]]))
    >>> chequer.texels.shape
    (2, 2, 1)
    >>> pl.Lambertian(chequer)
    Lambertian(albedo=Texture(texels=<2 x 2 x 1 float32>))
    """

    texels: NDArray[np.float32]

    if TYPE_CHECKING:

        def __init__(self, texels: ArrayLike) -> None: ...

    def __post_init__(self) -> None:
        if isinstance(self.texels, np.ndarray) and self.texels.dtype.kind in "iub":
            raise InvalidValueError(
                f"texels are {self.texels.dtype}; they must be linear floats, or use Texture.from_image for image codes"
            )
        with np.errstate(over="ignore"):
            texels = frozen_array(self.texels, name="texels", shape=(None, None, None), dtype=np.float32)
        if texels.shape[2] not in (1, 3):
            raise InvalidValueError(f"texels has {texels.shape[2]} channels; it must have 1 or 3 (drop alpha)")
        if texels.size == 0:
            raise SceneError(f"texels has shape {texels.shape}; a texture must have at least 1 row and 1 column")
        # min and max hand NaN on, so two passes without temporaries see everything.
        low, high = float(texels.min()), float(texels.max())
        if not (low >= 0 and high < np.inf):
            raise SceneError(f"texels lie between {low:g} and {high:g}; they must be finite and 0 or more")
        set_field(self, "texels", texels)

    @property
    def is_grey(self) -> bool:
        """Whether all its channels are equal.

        Examples
        --------
        >>> import numpy as np
        >>> import plenoptic as pl
        >>> pl.Texture(np.ones((4, 4, 3))).is_grey
        True
        """
        first = self.texels[..., 0]
        return all(np.array_equal(first, self.texels[..., k]) for k in range(1, self.texels.shape[2]))

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Texture:
        """Read a texture from an image file.

        Parameters
        ----------
        path : str or path
            An image; codes of 8 and 16 bits are decoded from sRGB, floats are taken as linear, alpha is dropped.

        Raises
        ------
        FileError
            Missing, or not an image.

        Examples
        --------
        >>> import plenoptic as pl
        >>> pl.Texture.load("bark.png")  # doctest: +SKIP
        Texture(texels=<512 x 512 x 3 float32>)
        """
        from plenoptic import images

        return cls(images.read_linear(path))

    @classmethod
    def from_image(cls, image: Image) -> Texture:
        """Make a texture of a Pillow image.

        Parameters
        ----------
        image : PIL.Image.Image
            Of any mode: codes of 8 and 16 bits are decoded from sRGB (IEC 61966-2-1), floats are taken as
            linear, alpha is dropped, grey stays one channel.

        Raises
        ------
        InvalidValueError
            Not a Pillow image.
        FileError
            The image was opened lazily and its file is damaged.

        Examples
        --------
        >>> import PIL.Image
        >>> import plenoptic as pl
        >>> texture = pl.Texture.from_image(PIL.Image.new("RGB", (8, 4), (255, 188, 0)))
        >>> texture.texels.shape, texture.texels[0, 0].round(2).tolist()
        ((4, 8, 3), [1.0, 0.5, 0.0])
        """
        from PIL.Image import Image

        from plenoptic import images

        if not isinstance(image, Image):
            raise InvalidValueError(f"image is {type(image).__name__}; it must be a Pillow image")
        try:
            codes, maximum = _codes(image)
        except Exception as error:  # Pillow raises OSError, SyntaxError, ValueError, ... for damaged data
            raise FileError(f"the image cannot be decoded ({error}); save it again") from None
        if maximum is None:
            return cls(codes)
        linear = images.srgb_to_linear(np.arange(maximum + 1) / maximum).astype(np.float32)
        return cls(linear[np.clip(codes, 0, maximum)])


def _codes(image: Image) -> tuple[NDArray[Any], int | None]:
    """(rows, columns, 1 or 3) codes and the code of white; None where they are linear floats."""
    if image.mode == "F":
        return np.asarray(image)[..., None], None
    if image.mode.startswith("I"):
        # Pillow keeps 16-bit grey in its integer modes.
        return np.asarray(image)[..., None].astype(np.int64), 65535
    grey = image.mode in ("1", "L", "LA", "La")
    codes = np.asarray(image.convert("L" if grey else "RGB"))
    return codes[..., None] if grey else codes, 255
