"""Estimates of time, memory and files of a render, from a few of its pixels."""
