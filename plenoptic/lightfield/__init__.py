"""Light fields: raw images of plenoptic cameras taken apart into views, and put together again."""

from plenoptic.lightfield.decode import decode
from plenoptic.lightfield.depth_map import DepthMap, depth
from plenoptic.lightfield.reading import read_eslf, read_hci, read_views
from plenoptic.lightfield.refocus import refocus
from plenoptic.lightfield.scores import DisparityScores, disparity_scores
from plenoptic.lightfield.views import LightField

__all__ = [
    "DepthMap",
    "DisparityScores",
    "LightField",
    "decode",
    "depth",
    "disparity_scores",
    "read_eslf",
    "read_hci",
    "read_views",
    "refocus",
]
