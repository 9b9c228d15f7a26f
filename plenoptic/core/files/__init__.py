"""Files of all rooms: images, values as text, and how files are replaced."""
