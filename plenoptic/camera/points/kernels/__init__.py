"""Kernels of micro images."""
