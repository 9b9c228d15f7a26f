"""Kernels: random numbers of pixels."""
