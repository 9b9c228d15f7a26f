"""Replaying: one path of an exposure traced again, with all that it meets."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
