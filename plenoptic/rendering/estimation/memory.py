"""Memory of this process."""

from __future__ import annotations

import os
import sys
from contextlib import suppress


def resident_bytes() -> int:
    """Resident memory of the process; its maximum if the system does not report it, and 0 on Windows."""
    with suppress(OSError, ValueError), open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    with suppress(ImportError):
        import resource

        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return peak if sys.platform == "darwin" else 1024 * peak
    return 0
