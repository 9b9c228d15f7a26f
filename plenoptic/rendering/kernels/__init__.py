"""Kernels that add paths to a film."""
