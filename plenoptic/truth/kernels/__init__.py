"""Kernels of ground truth: representative rays, hit points, and their images."""
