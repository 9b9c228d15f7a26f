"""Numba: the decorators of kernels, their compiler, and the compiled code on disk."""
