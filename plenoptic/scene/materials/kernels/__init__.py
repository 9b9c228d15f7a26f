"""Kernels: scattering, transparency and absorption."""
