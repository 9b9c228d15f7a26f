"""Memory of this process, of ground truth and of illuminated pupils."""

from __future__ import annotations

import math
import os
import sys
from contextlib import suppress

import numpy as np

from plenoptic.truth.channels import CHANNELS, Truth, channels_of

PUPIL_BYTES = 500
"""Bytes of the illuminated pupil of a pixel."""


def resident_bytes() -> int:
    """Resident memory of the process; its maximum if the system does not report it, and 0 on Windows."""
    with suppress(OSError, ValueError), open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    with suppress(ImportError):
        import resource

        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return peak if sys.platform == "darwin" else 1024 * peak
    return 0


def truth_bytes(truth: Truth) -> int:
    """Bytes of the ground truth of a pixel."""
    return sum(np.dtype(CHANNELS[name].dtype).itemsize * math.prod(CHANNELS[name].shape) for name in channels_of(truth))
