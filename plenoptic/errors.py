"""Errors that the caller can correct, and warnings.

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
    """A file or folder that is missing, unreadable, unwritable or of another format than it claims.

    Examples
    --------
    >>> import plenoptic as pl
    >>> issubclass(pl.errors.FileError, OSError)
    True
    """


class PlenopticWarning(UserWarning):
    """Any warning of this package: the request is carried out, but is hardly the intended one.

    Each is given once a call, at the line that called the package.

    Examples
    --------
    >>> import warnings, plenoptic as pl
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("error", pl.errors.BlackImageWarning)              # stop at black images
    ...     warnings.simplefilter("ignore", pl.errors.ImplausibleCameraWarning)      # be silent about odd cameras
    """


class BlackImageWarning(PlenopticWarning):
    """An image without any light, and why. See `PlenopticWarning`."""


class ImplausibleCameraWarning(PlenopticWarning):
    """A camera with a number that no real one has, as from mistaken units. See `PlenopticWarning`."""


class ImplausibleSceneWarning(PlenopticWarning):
    """A scene of another scale than its camera, glass that is inside out or hides particles, an unseen light sheet.

    See `PlenopticWarning`.
    """


class UnseenSceneWarning(PlenopticWarning):
    """A scene that lies outside the camera's view, before a bright background. See `PlenopticWarning`."""


class BudgetWarning(PlenopticWarning):
    """A time limit that was passed, a target error that was not reached, an interruption. See `PlenopticWarning`."""


class FileWarning(PlenopticWarning):
    """Content of a file that is left out or replaced, or a file that was not written. See `PlenopticWarning`."""
