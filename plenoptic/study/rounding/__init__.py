"""Rounding errors of traced rays."""
