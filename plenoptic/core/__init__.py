"""Common parts of all rooms: values, rays, random numbers, compilation, files."""
