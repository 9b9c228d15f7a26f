"""Kernels of diffraction."""
