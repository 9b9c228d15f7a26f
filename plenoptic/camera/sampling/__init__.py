"""Aperture regions, which illuminate each pixel, and camera samples aimed at them."""
