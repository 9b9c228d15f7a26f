"""What holds for all tests: where helpers and larger files lie, that examples have time, and that Ctrl-C interrupts."""

import os
import signal
import sys
from pathlib import Path

from hypothesis import settings

HELPERS = ("benchmarks", "camera", "core", "core/engines", "export", "fuzz", "golden", "hostile", "validation")
HELPERS += ("optics/lens/analysis", "optics/lens/waves", "optics/surfaces", "viewer")
HELPERS += ("rendering", "rendering/integrator", "rendering/schedule")
"""Folders with modules that tests import."""

sys.path += [str(Path(__file__).parent / folder) for folder in HELPERS]
os.environ.setdefault("PLENOPTIC_SHARED", str(Path(__file__).resolve().parents[2] / "shared"))
settings.register_profile("plenoptic", settings(), deadline=None)
settings.load_profile("plenoptic")

# A shell ignores interrupts in what it starts in the background, and so would all processes that tests start.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
