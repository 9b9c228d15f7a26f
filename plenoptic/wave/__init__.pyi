from .point_image import point_spread as point_spread
from .spread_stack import WaveSpreadStack as WaveSpreadStack
from .spread_stack import point_spread_stack as point_spread_stack
from .wave_spread import Sampling as Sampling
from .wave_spread import WaveSpread as WaveSpread
