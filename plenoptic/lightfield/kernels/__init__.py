"""Kernels of light fields."""
