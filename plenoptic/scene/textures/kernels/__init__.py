"""Kernels: what a texture is at a point."""
