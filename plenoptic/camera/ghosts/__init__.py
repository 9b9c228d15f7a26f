"""Ghosts of cameras: paths of pairs of reflections, in the lens and behind microlenses."""
