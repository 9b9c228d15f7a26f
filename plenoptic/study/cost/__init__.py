"""Cost of each part of a render."""
