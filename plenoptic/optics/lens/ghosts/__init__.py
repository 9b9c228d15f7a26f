"""Ghosts: light that is reflected twice inside a lens."""
