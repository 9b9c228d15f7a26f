"""Kernels: rays through a stack of surfaces and stops."""
