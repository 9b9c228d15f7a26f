"""Pupils of a real lens: ray aiming, pupil bounds, and sampling of the rays that pass the iris."""
