"""Plenoptic cameras, simulated physically: rays from sensor pixels through microlenses and a real lens into a scene.

Names are loaded on first use (PEP 562), so that importing the package imports nothing else. They stand in the stub
beside this file, and those of the rooms `camera`, `optics`, `plots`, `rendering`, `replaying`, `scene` and `study` in
stubs there.
"""

import lazy_loader

__version__ = "0.1.0"

_load, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    """Load a public name; an AttributeError names similar ones."""
    try:
        return _load(name)
    except AttributeError:
        if name.startswith("_") or name in __all__:
            raise
        from difflib import get_close_matches

        rooms = ("lights", "materials", "optics", "rendering", "sensor", "scene", "images", "lightfield", "aberrations")
        places = [f"plenoptic.{room}.{name}" for room in rooms if name in dir(_load(room))]
        similar = ", ".join(places or get_close_matches(name, __all__)) or "dir(plenoptic)"
        raise AttributeError(f"plenoptic has no {name}; see {similar}", name=name) from None
