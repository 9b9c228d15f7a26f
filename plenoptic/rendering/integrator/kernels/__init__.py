"""Kernels of light transport: emission, direct light and scattering."""
