"""Positions of world points and of micro images on the sensor."""
