"""Kernels: rays of a whole camera."""
