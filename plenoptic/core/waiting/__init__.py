"""Progress of calls that take long: share done, and kernels that are compiled first."""
