"""Meshes and scenes made from numbers."""
