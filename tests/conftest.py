"""What holds for all tests: where larger files lie, that drawn examples have time, and that Ctrl-C interrupts."""

import os
import signal
from pathlib import Path

from hypothesis import settings

os.environ.setdefault("PLENOPTIC_SHARED", str(Path(__file__).resolve().parents[2] / "shared"))
settings.register_profile("plenoptic", settings(), deadline=None)
settings.load_profile("plenoptic")

# A shell ignores interrupts in what it starts in the background, and so would all processes that tests start.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
