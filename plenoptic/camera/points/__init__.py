"""Positions of world points and of microlens images on the sensor."""
