"""Light fields: decoding raw images into sub-aperture views, refocusing, views of focused cameras and depth."""

from plenoptic.lightfield.decode import decode
from plenoptic.lightfield.depth_map import DepthMap, depth
from plenoptic.lightfield.focused.view import View
from plenoptic.lightfield.focused.view_rendering import render_view, render_views
from plenoptic.lightfield.matching.image_stack import ImageStack, Matches
from plenoptic.lightfield.matching.match import plane_sweep, refine, semi_global
from plenoptic.lightfield.reading import read_eslf, read_hci, read_lftoolbox, read_views
from plenoptic.lightfield.refocus import refocus
from plenoptic.lightfield.scores import DisparityScores, disparity_edges, disparity_scores
from plenoptic.lightfield.views import LightField

__all__ = [
    "DepthMap",
    "DisparityScores",
    "ImageStack",
    "LightField",
    "Matches",
    "View",
    "decode",
    "depth",
    "disparity_edges",
    "disparity_scores",
    "plane_sweep",
    "read_eslf",
    "read_hci",
    "read_lftoolbox",
    "read_views",
    "refine",
    "refocus",
    "render_view",
    "render_views",
    "semi_global",
]
