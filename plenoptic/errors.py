"""What goes wrong and can be put right by the caller.

Every message names the value, the limit and the remedy.
"""


class PlenopticError(Exception):
    """Anything this package raises on purpose.

    Examples
    --------
    >>> import plenoptic as pl
    >>> try:
    ...     pl.Sensor(shape=(0, 4), pixel_pitch=0.01)
    ... except pl.PlenopticError as error:
    ...     print(error)
    rows of the sensor is 0; it must be at least 1
    """


class InvalidValueError(PlenopticError, ValueError):
    """A number, shape or choice that no camera, lens, scene or render can have.

    Examples
    --------
    >>> import plenoptic as pl
    >>> issubclass(pl.errors.InvalidValueError, ValueError)
    True
    """


class PrescriptionError(InvalidValueError):
    """A lens that cannot be built, or a lens file that cannot be understood.

    Examples
    --------
    >>> import plenoptic as pl
    >>> try:
    ...     pl.LensStack([pl.CircularStop(semi_diameter=5.0)])
    ... except pl.errors.PrescriptionError:
    ...     print("a lens needs a surface")
    a lens needs a surface
    """


class SceneError(InvalidValueError):
    """A mesh, texture, material or light that cannot be rendered.

    Examples
    --------
    >>> import plenoptic as pl
    >>> try:
    ...     pl.Scene()
    ... except pl.errors.SceneError as error:
    ...     print(error)
    the scene has no mesh, no light and no background; give it at least one of them
    """


class FileError(PlenopticError, OSError):
    """A file or folder that is missing, unreadable, unwritable or not what it claims to be.

    Examples
    --------
    >>> import plenoptic as pl
    >>> issubclass(pl.errors.FileError, OSError)
    True
    """
