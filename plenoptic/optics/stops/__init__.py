"""Stops: thin opaque screens with a hole."""
