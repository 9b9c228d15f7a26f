"""BSDF of a material: its distribution over directions, as numbers to look at or to test."""

from plenoptic.scene.materials.bsdf_values import Drawn, Scattered, draw, evaluate

__all__ = ["Drawn", "Scattered", "draw", "evaluate"]
