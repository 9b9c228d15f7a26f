from .patterns import point_spread as point_spread
from .spread import Sampling as Sampling
from .spread import WaveSpread as WaveSpread
from .stack import WaveSpreadStack as WaveSpreadStack
from .stack import point_spread_stack as point_spread_stack
