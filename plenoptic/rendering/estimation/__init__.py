"""Estimates of the time and memory of a render, from pilot runs of a few pixels."""
