"""Triangles, where they stand, and what finds those that rays meet."""
