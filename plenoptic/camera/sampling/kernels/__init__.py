"""Kernels of aperture sampling: aperture regions, and camera samples aimed at them."""
