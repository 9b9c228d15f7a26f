"""Ghosts in exposures."""
