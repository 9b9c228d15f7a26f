"""The image sensor: pixels, what they see of each direction and colour, and the noise they add."""
