"""Figures: arrays in, figure out. Matplotlib is imported on first use."""
