"""Checks of lenses for implausible properties."""
