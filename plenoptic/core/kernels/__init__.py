"""Device functions that kernels of all rooms share."""
