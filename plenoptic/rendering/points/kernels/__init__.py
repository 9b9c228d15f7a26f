"""Kernels of images of particles."""
