"""Images of particles, by rays from each one to the sensor."""
