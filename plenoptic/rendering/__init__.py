"""Rendering: tiles of samples through all stages, until a budget ends it; the state of it in a file."""
