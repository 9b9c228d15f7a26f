"""The golden cases: functions that return arrays by name. Each is small, and together they call every kernel."""

from golden_calculations import CALCULATIONS
from golden_renderings import RENDERINGS

CASES = {case.__name__: case for case in (*RENDERINGS, *CALCULATIONS)}

QUICK = ("traces",)
"""In the normal run."""
