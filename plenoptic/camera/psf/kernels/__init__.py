"""Kernels of forward tracing from points."""
