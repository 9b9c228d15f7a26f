"""Engines, which run jobs: threads of this process, or workers of a dask cluster."""
