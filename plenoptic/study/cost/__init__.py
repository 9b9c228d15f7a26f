"""Costs of the parts of a render."""
