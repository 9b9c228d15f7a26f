"""Sampling points: Owen-scrambled Sobol points as a function of seed, pixel, replicate, set and index."""

from plenoptic.core.sampling import sobol_points

__all__ = ["sobol_points"]
