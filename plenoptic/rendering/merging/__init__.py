"""Merging of exposures: in memory, or row by row into a store."""
