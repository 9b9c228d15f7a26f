"""Poses and rigid motions of objects and cameras."""
