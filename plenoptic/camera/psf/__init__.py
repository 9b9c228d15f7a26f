"""Point spread: light of points on the sensor."""
