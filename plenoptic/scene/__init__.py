"""Scenes: meshes, materials, textures, lights and backgrounds, and the records that kernels read."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
