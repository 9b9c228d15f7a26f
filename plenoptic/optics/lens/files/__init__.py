"""Lens files, read and written."""
