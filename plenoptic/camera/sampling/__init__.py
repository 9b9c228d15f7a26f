"""Aperture regions: the part of the microlens plane that illuminates each pixel; and paths that start there."""
