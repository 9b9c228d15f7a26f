"""Kernels that add the light of paths to a film."""
