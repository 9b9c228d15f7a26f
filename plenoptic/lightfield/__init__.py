"""Light fields: raw images of plenoptic cameras taken apart into views, and put together again."""

from plenoptic.lightfield.decode import decode
from plenoptic.lightfield.refocus import refocus
from plenoptic.lightfield.views import LightField

__all__ = ["LightField", "decode", "refocus"]
