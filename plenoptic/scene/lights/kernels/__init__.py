"""Kernels: points and directions of lights, drawn by power."""
