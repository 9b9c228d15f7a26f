"""Kernels: rays against triangles."""
