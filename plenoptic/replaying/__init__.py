"""Replaying: one path of an exposure traced again, with all that it meets."""
