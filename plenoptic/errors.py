"""What goes wrong and can be put right by the caller.

Every message names the value, the limit and the remedy.
"""


class PlenopticError(Exception):
    """Anything this package raises on purpose."""


class InvalidValueError(PlenopticError, ValueError):
    """A number, shape or choice that no camera, lens, scene or rendering can have."""


class PrescriptionError(InvalidValueError):
    """A lens that cannot be built, or a lens file that cannot be understood."""


class SceneError(InvalidValueError):
    """A mesh, texture, material or light that cannot be rendered."""


class FileError(PlenopticError, OSError):
    """A file or folder that is missing, unreadable, unwritable or not what it claims to be."""
