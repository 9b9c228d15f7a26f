from .events import PathEnding as PathEnding
from .replay import Replay as Replay
from .retracing import replay as replay
from .retracing import replay_all as replay_all
