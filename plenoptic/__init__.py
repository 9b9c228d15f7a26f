"""Plenoptic cameras, simulated physically: rays from sensor pixels through microlenses and a real lens into a scene.

Names are loaded on first use (PEP 562), so that importing the package imports nothing else. They stand in the stub
beside this file, and those of the rooms `camera`, `optics`, `plots`, `rendering`, `replaying`, `scene` and `study` in
stubs there.
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
