"""What holds for all tests: where larger files lie, and that drawn examples have time, since kernels compile first."""

import os
from pathlib import Path

from hypothesis import settings

os.environ.setdefault("PLENOPTIC_SHARED", str(Path(__file__).resolve().parents[2] / "shared"))
settings.register_profile("plenoptic", settings(), deadline=None)
settings.load_profile("plenoptic")
