"""Lenses in files: tables, the package's own JSON, and Zemax prescriptions."""
