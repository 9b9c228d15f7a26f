from .events import PathEnding as PathEnding
from .replay import Replay as Replay
