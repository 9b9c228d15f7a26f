"""Optional packages that some file formats need, imported on use."""

from __future__ import annotations

import importlib
from types import ModuleType

from plenoptic.errors import PlenopticError


class MissingPackageError(PlenopticError, ImportError):
    """An optional package is not installed."""


def extra_package(name: str, what: str, install: str) -> ModuleType:
    """Import an optional module, or raise an error that says how to install it: "this file needs the package h5py"."""
    try:
        return importlib.import_module(name)
    except ImportError:
        raise MissingPackageError(f"{what} needs the package {name.partition('.')[0]}: pip install {install}") from None
