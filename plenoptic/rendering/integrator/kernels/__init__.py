"""Kernels: emission, direct light, and the next ray."""
