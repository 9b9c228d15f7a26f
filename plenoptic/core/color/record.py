"""What kernels know of the wavelengths of paths."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.values import Floats


class Wavelengths(NamedTuple):
    """At which wavelengths paths see the colours of a scene; both are None where they see its channels."""

    number: NDArray[np.int64] | None
    """(paths,): number of each path's wavelength."""
    basis: Floats | None
    """(wavelengths, 3): what red, green and blue are at each."""
