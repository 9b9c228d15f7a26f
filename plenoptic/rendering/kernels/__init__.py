"""Kernels: what paths add to a film."""
