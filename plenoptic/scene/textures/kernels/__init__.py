"""Kernels of texture lookups."""
