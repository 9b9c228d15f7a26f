"""Kernels: light that surfaces and glass take from rays."""
