"""What all rooms share: values, rays, random numbers, compilation, files."""
