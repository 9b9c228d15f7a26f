"""Kernels: rays of points, forwards."""
