"""Lights of a scene: one file a light."""
