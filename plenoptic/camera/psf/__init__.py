"""What light of points leaves on the sensor."""
