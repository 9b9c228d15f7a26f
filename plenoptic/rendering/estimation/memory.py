"""Memory of this process."""

from __future__ import annotations

import os
import sys
from contextlib import suppress


def resident_bytes() -> int:
    """Memory that the process holds now; where a system does not tell, the most it has held, and 0 on Windows."""
    with suppress(OSError, ValueError), open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    with suppress(ImportError):
        import resource

        most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return most if sys.platform == "darwin" else 1024 * most
    return 0
