"""For all tests: folders of helpers and larger files, time for examples, Ctrl-C, types of the arguments of kernels."""

import os
import signal
import sys
from pathlib import Path

from hypothesis import settings

from plenoptic.core.numba.jit import Specialized

HELPERS = ("benchmarks", "calibration", "camera", "core", "core/engines", "export", "fuzz", "golden", "hostile")
HELPERS += ("validation",)
HELPERS += ("optics/lens/analysis", "optics/lens/ghosts", "optics/lens/waves", "optics/surfaces", "viewer")
HELPERS += ("rendering", "rendering/ghosts", "rendering/integrator", "rendering/schedule")
"""Folders with modules that tests import."""

sys.path += [str(Path(__file__).parent / folder) for folder in HELPERS]
os.environ.setdefault("PLENOPTIC_SHARED", str(Path(__file__).resolve().parents[2] / "shared"))
settings.register_profile("plenoptic", settings(), deadline=None)
settings.load_profile("plenoptic")

# A shell ignores interrupts in what it starts in the background, and so would all processes that tests start.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

_run = Specialized.__call__


def _run_checked(self, *arguments):
    """Call a specialized kernel, which does not look at the types of its arguments."""
    from numba._dispatcher import compute_fingerprint

    types = compute_fingerprint(arguments)
    assert vars(self).setdefault("types", types) == types, f"{self._kernel.__name__}: the types of arguments changed"
    return _run(self, *arguments)


Specialized.__call__ = _run_checked
