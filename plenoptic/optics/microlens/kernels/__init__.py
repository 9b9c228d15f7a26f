"""Kernels: rays through microlenses, both ways."""
