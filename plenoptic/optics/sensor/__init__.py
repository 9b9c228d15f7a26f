"""The image sensor: pixels, their response to direction and colour, and their noise."""
