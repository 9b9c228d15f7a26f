"""Where points and microlens images lie on the sensor."""
