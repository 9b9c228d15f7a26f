"""Triangles, their poses, and intersectors."""
