from .point_spread import point_spread as point_spread
from .spread import Sampling as Sampling
from .spread import WaveSpread as WaveSpread
