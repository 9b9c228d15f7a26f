"""Foundations shared by all rooms: values, rays, random numbers, compilation, files."""
